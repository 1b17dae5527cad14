"""Reads HdrColor from the renderer's own texture: one copy on the device instead of two.

Kit hands out a number. No documentation says that it is CUDA's handle of the texture, in the context that all users
of CUDA's runtime share, and a wrong handle ends the process. So this path is used only if a setting asks for it and
the self-test has seen the same events both ways.
"""

import esaac

from .frames import HDR, FrameUnusable

NODE = HDR + "Ptr"
OUTPUTS = tuple(
    f"outputs:{name}" for name in ("dataPtr", "cudaDeviceIndex", "width", "height", "bufferSize", "format")
)
TEXEL_BYTES = 8


class Texture:
    """HdrColor of one render product, for an event camera."""

    def __init__(self, product, camera):
        try:
            from omni.syntheticdata import SyntheticData
        except ImportError as error:
            raise FrameUnusable("omni.syntheticdata is not enabled") from error
        self._product, self._device = product, _cuda_number(camera)
        SyntheticData.register_export_rendervar_ptr_templates([HDR])
        self._data = SyntheticData.Get()
        self._data.activate_node_template(NODE, 0, [product.path])

    def image(self, width, height):
        """The current image, for `EventCamera.step`. It is valid until the writer's `write` returns."""
        told = self._data.get_node_attributes(NODE, list(OUTPUTS), self._product.path) or {}
        pointer, device, columns, rows, size, _ = (int(told.get(name) or 0) for name in OUTPUTS)
        if pointer == 0 or (columns, rows) == (0, 0):
            raise FrameUnusable(f"{NODE} is empty: the renderer has not drawn yet", expected=True)
        if told.get("outputs:cudaDeviceIndex") is None or device < 0:
            raise FrameUnusable(f"{NODE} lies on the host, expected a CUDA device")
        if device != self._device:
            own = "no CUDA device" if self._device is None else f"cuda:{self._device}"
            raise FrameUnusable(
                f"{NODE} lies on cuda:{device}, expected the engine's device, which is {own}; set the extension's "
                f"`device` to cuda:{device}"
            )
        if (columns, rows) != (width, height):
            raise FrameUnusable(f"{NODE} is {columns}x{rows} px, expected {width}x{height}")
        if size == 0:
            return esaac.CudaTexture(pointer, width, height)
        if size != width * height * TEXEL_BYTES:
            raise FrameUnusable(f"{NODE} has {size} bytes, expected {width * height * TEXEL_BYTES}")
        return _Linear(pointer, width, height)


def _cuda_number(camera):
    """CUDA's number of the device that a camera runs on; None if it is not one of CUDA's."""
    uuid = camera.device["uuid"]
    return next((entry["cuda"] for entry in esaac.devices() if entry["uuid"] == uuid), None)


class _Linear:
    """An image in a linear buffer without gaps between rows, which some versions of Kit hand out."""

    def __init__(self, pointer, width, height):
        self.shape = (height, width, 4)
        self.__cuda_array_interface__ = {
            "shape": self.shape,
            "typestr": "<f2",
            "data": (pointer, True),
            "version": 2,
        }
