"""ovrtx: a renderer of images that tests give it. See F16 to F20 in README.md."""

import enum
import types

GARBAGE = 7


class Device(enum.Enum):
    CPU = 0
    CUDA = 2


class _Mapped:
    """F17: there is no GPU here, so the memory is the host's. It has the image once it was waited for."""

    def __init__(self, variable, device, sync_stream):
        self._variable = variable
        self._image = variable.image.copy()
        self._memory = self._image.copy()
        if device == Device.CUDA:
            assert sync_stream is not None, "the default synchronises with a stream that nobody reads in"
            self._memory.fill(GARBAGE)

    def wait(self):
        self._memory[...] = self._image

    def __dlpack_device__(self):
        return self._memory.__dlpack_device__()

    def __dlpack__(self, *, stream=None, max_version=None, dl_device=None, copy=None):
        return self._memory.__dlpack__()

    def unmap(self, event=None, stream=None):
        """F18: the renderer's memory is its own again."""
        self._memory.fill(GARBAGE)
        self._variable.mapped = False


class _Variable:
    def __init__(self, image):
        self.image, self.mapped = image, False

    def map(self, device=Device.CPU, sync_stream=None):
        if self.mapped:
            raise RuntimeError("already mapped")
        self.mapped = True
        return _Mapped(self, device, sync_stream)


class Renderer:
    """Draws what `images(frame)` gives: arrays by the path of their variable."""

    FRAMES_UNTIL_ECO = 500

    def __init__(self, product, images, eco_mode=True):
        self._product, self._images, self._eco_mode = product, images, eco_mode
        self.frames, self.time_s = 0, 0.0

    def step(self, render_products, delta_time):
        """F19: its clock goes by `delta_time`. F20: in eco mode it hands out the same image in the end."""
        assert render_products == {self._product}
        shown = min(self.frames, self.FRAMES_UNTIL_ECO) if self._eco_mode else self.frames
        variables = {path: _Variable(image) for path, image in self._images(shown).items()}
        start_s, self.time_s = self.time_s, self.time_s + delta_time
        self.frames += 1
        frame = types.SimpleNamespace(render_vars=variables, start_time=start_s, end_time=self.time_s)
        return {self._product: types.SimpleNamespace(name=self._product, frames=[frame])}
