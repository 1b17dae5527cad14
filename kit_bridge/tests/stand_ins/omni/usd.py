"""The context has one stage."""


class _Context:
    stage = None

    def new_stage(self):
        """Tests bring their stage."""

    def get_stage(self):
        return self.stage


_CONTEXT = _Context()


def get_context():
    return _CONTEXT
