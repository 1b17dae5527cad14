"""F11: a render variable's own image. On a CUDA device a mipmapped array, as the documentation says; without one an
image on the host, which no texture is.
"""

import ctypes
import types

import warp as wp

ACTIVE = set()
faults = types.SimpleNamespace(wrong_size=False, stale=False)
"""What it gets wrong; tests set it."""


class _Descriptor(ctypes.Structure):
    _fields_ = [
        ("width", ctypes.c_size_t),
        ("height", ctypes.c_size_t),
        ("depth", ctypes.c_size_t),
        ("format", ctypes.c_uint),
        ("channels", ctypes.c_uint),
        ("flags", ctypes.c_uint),
    ]


class _Copy(ctypes.Structure):
    _fields_ = [
        (f"{side}{name}", kind)
        for side in ("src", "dst")
        for name, kind in (
            ("XInBytes", ctypes.c_size_t),
            ("Y", ctypes.c_size_t),
            ("MemoryType", ctypes.c_uint),
            ("Host", ctypes.c_void_p),
            ("Device", ctypes.c_uint64),
            ("Array", ctypes.c_void_p),
            ("Pitch", ctypes.c_size_t),
        )
    ] + [("WidthInBytes", ctypes.c_size_t), ("Height", ctypes.c_size_t)]


HOST, ARRAY, HALF = 1, 3, 0x10


class MipmappedArray:
    """Four halves a texel, in the primary context of device 0."""

    def __init__(self, width, height):
        self.size = (width, height)
        self._cuda = ctypes.CDLL("libcuda.so.1")
        context, device = ctypes.c_void_p(), ctypes.c_int()
        self._call("cuInit", 0)
        self._call("cuDeviceGet", ctypes.byref(device), 0)
        self._call("cuDevicePrimaryCtxRetain", ctypes.byref(context), device)
        self._call("cuCtxSetCurrent", context)
        self.handle, self._level = ctypes.c_void_p(), ctypes.c_void_p()
        shape = _Descriptor(width, height, 0, HALF, 4, 0)
        self._call("cuMipmappedArrayCreate", ctypes.byref(self.handle), ctypes.byref(shape), 1)
        self._call("cuMipmappedArrayGetLevel", ctypes.byref(self._level), self.handle, 0)

    def draw(self, pixels):
        row = pixels.shape[1] * 8
        copy = _Copy(
            srcMemoryType=HOST,
            srcHost=pixels.ctypes.data,
            srcPitch=row,
            dstMemoryType=ARRAY,
            dstArray=self._level.value,
            WidthInBytes=row,
            Height=pixels.shape[0],
        )
        self._call("cuMemcpy2D_v2", ctypes.byref(copy))

    def _call(self, name, *arguments):
        result = getattr(self._cuda, name)(*arguments)
        assert result == 0, f"{name}: {result}"


class SyntheticData:
    _textures = {}

    @classmethod
    def Get(cls):
        return cls()

    @staticmethod
    def register_export_rendervar_ptr_templates(_rendervars):
        pass

    def activate_node_template(self, name, _index, paths):
        ACTIVE.update((name, path) for path in paths)

    def get_node_attributes(self, name, names, path):
        from omni.replicator import core as rep

        product = next(product for product in rep._PRODUCTS if product.path == path)
        if (name, path) not in ACTIVE or product.hdr is None or product.hdr.size == 0:
            return {}
        height, width = product.hdr.shape[:2]
        values = {"width": width, "height": height, "bufferSize": 0, "format": 0}
        if wp.is_cuda_available():
            texture = self._textures.setdefault((width, height), None) or MipmappedArray(width, height)
            self._textures[width, height] = texture
            if not (faults.stale and product.drawn > 4):
                texture.draw(product.hdr)
            values |= {"dataPtr": texture.handle.value, "cudaDeviceIndex": 0}
        else:
            values |= {"dataPtr": product.hdr.ctypes.data, "cudaDeviceIndex": -1}
        if faults.wrong_size:
            values["width"] += 1
        return {f"outputs:{key}": value for key, value in values.items() if f"outputs:{key}" in names}
