"""F8: an application that updates: each update draws a frame (F1)."""

from omni.events import Stream


class _App:
    def __init__(self):
        self._stream = Stream()

    def get_update_event_stream(self):
        return self._stream

    async def next_update_async(self):
        self.update()

    def update(self):
        from omni.replicator import core

        core.draw()
        self._stream.push()


_APP = _App()


def get_app():
    return _APP
