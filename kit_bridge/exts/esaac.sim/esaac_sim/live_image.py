"""The latest events as a picture: ON red, OFF blue, fading to white."""

import numpy as np

FADE = 0.6


class LiveImage:
    """A sink that keeps one camera's picture, RGBA bytes `[row, column]`. It works only while `seen()` is true."""

    name = "live image"

    def __init__(self, width, height, seen):
        self._seen = seen
        self._levels = np.zeros((2, height, width), np.float32)

    def __call__(self, feed, packet):
        if not self._seen():
            return
        counts = feed.camera.event_frame()
        counts = counts.numpy() if hasattr(counts, "numpy") else counts
        self._levels = np.maximum(self._levels * FADE, np.minimum(counts / 2.0, 1.0).astype(np.float32))

    @property
    def rgba(self):
        off, on = self._levels
        white = 1.0 - np.maximum(off, on)
        image = np.stack([np.maximum(white, on), white, np.maximum(white, off), np.ones_like(on)], axis=-1)
        return (image * 255).astype(np.uint8)
