"""The context has one stage."""


class _Context:
    stage = None

    def get_stage(self):
        return self.stage


_CONTEXT = _Context()


def get_context():
    return _CONTEXT
