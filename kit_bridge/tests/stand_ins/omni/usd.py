"""F23: the context has one stage, and tells by an event stream that it closes, before another is there."""

import enum

from omni.events import Stream


class StageEventType(enum.IntEnum):
    OPENED = 2
    CLOSING = 4


class _Context:
    stage = None

    def __init__(self):
        self._stream = Stream()

    def get_stage_event_stream(self):
        return self._stream

    def open(self, stage):
        """For tests: another stage takes the place of this one."""
        self._stream.push(int(StageEventType.CLOSING))
        self.stage = stage
        self._stream.push(int(StageEventType.OPENED))

    def new_stage(self):
        """Tests bring their stage."""

    def get_stage(self):
        return self.stage


_CONTEXT = _Context()


def get_context():
    return _CONTEXT
