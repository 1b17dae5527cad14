"""F8: an application that updates. Each update moves the timeline (F12) and draws a frame (F1)."""

from omni.events import Stream


class _App:
    def __init__(self):
        self._stream = Stream()

    def get_update_event_stream(self):
        return self._stream

    async def next_update_async(self):
        self.update()

    def update(self):
        from omni import timeline
        from omni.replicator import core

        timeline.get_timeline_interface().update()
        core.draw()
        self._stream.push()


_APP = _App()


def get_app():
    return _APP
