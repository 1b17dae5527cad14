"""F8: play and stop are events."""

import enum

from omni.events import Stream


class TimelineEventType(enum.IntEnum):
    PLAY = 0
    PAUSE = 1
    STOP = 2


class _Timeline:
    def __init__(self):
        self._stream = Stream()

    def get_timeline_event_stream(self):
        return self._stream

    def play(self):
        self._stream.push(int(TimelineEventType.PLAY))

    def stop(self):
        self._stream.push(int(TimelineEventType.STOP))


_TIMELINE = _Timeline()


def get_timeline_interface():
    return _TIMELINE
