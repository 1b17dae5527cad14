"""F8: play, pause and stop are events. F12: what is asked of the timeline is done at the next update."""

import enum

from omni.events import Stream

RATE_HZ = 60.0


class TimelineEventType(enum.IntEnum):
    PLAY = 0
    PAUSE = 1
    STOP = 2


class _Timeline:
    def __init__(self):
        self._stream = Stream()
        self.reset()

    def reset(self):
        """As new; subscriptions stay."""
        self._asked, self._state, self._time_s = [], TimelineEventType.STOP, 0.0

    def get_timeline_event_stream(self):
        return self._stream

    def play(self):
        self._asked.append(lambda: self._change(TimelineEventType.PLAY))

    def pause(self):
        self._asked.append(lambda: self._change(TimelineEventType.PAUSE))

    def stop(self):
        self._asked.append(lambda: self._change(TimelineEventType.STOP))

    def set_current_time(self, seconds):
        self._asked.append(lambda: setattr(self, "_time_s", seconds))

    def get_current_time(self):
        return self._time_s

    def is_playing(self):
        return self._state == TimelineEventType.PLAY

    def is_stopped(self):
        return self._state == TimelineEventType.STOP

    def update(self):
        """Does what was asked, then lets the time go on."""
        asked, self._asked = self._asked, []
        for change in asked:
            change()
        if self.is_playing():
            self._time_s += 1 / RATE_HZ

    def _change(self, state):
        if state == self._state:
            return
        self._state = state
        if state == TimelineEventType.STOP:
            self._time_s = 0.0
        self._stream.push(int(state))


_TIMELINE = _Timeline()


def get_timeline_interface():
    return _TIMELINE
