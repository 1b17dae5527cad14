"""F9: settings by path."""


class _Settings(dict):
    def set(self, path, value):
        self[path] = value

    def destroy_item(self, path):
        self.pop(path, None)


_SETTINGS = _Settings()


def get_settings():
    return _SETTINGS
