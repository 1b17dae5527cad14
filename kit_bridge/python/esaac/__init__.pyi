"""Event cameras for renderers: HDR frames and motion vectors in, time-ordered events out, on the GPU.

Arrays are anything that lies in memory and says so: NumPy, torch, Warp, CuPy, JAX, by the buffer protocol,
`__array_interface__`, DLPack or `__cuda_array_interface__`. On the host they may have any strides. On a CUDA
device pixels lie one after the other and rows in order (padded rows and views of some channels are fine), and
nothing of them touches the host.

* `hdr`: `(height, width, 3 or 4)`, or `(height, width)` on the host; float16 or float32 linear, or uint8 sRGB.
* `motion`: `(height, width, 2 to 4)`, float16 or float32, pixels, of which the first two count. It leads back:
  *previous position = position + motion*, x right, y down.
* `depth` is taken and not used, so that a renderer can hand over what it has.

The first frame tells the formats; later ones have the same. Methods may be called from any thread; calls on one
camera wait for each other, and the interpreter is free while the device works. Ctrl-C is raised after the step
under way. A camera made before fork() raises `ForkError` in the child.
"""

from collections.abc import Iterable, Sequence
from types import TracebackType
from typing import Any, Literal, TypedDict, Union

import numpy as np
from numpy.typing import NDArray

from esaac import files as files
from esaac.errors import ArgumentError as ArgumentError
from esaac.errors import ClosedError as ClosedError
from esaac.errors import DeviceError as DeviceError
from esaac.errors import EsaacError as EsaacError
from esaac.errors import ForkError as ForkError
from esaac.errors import FrameError as FrameError
from esaac.errors import RosError as RosError
from esaac.errors import SensorError as SensorError
from esaac.files import EventWriter as EventWriter

__version__: str

Array = Any
"""An array of any library, on the host or on a CUDA device."""

Packets = Literal["host", "cuda"]
"""Where events go: NumPy arrays, or tensors that stay on the CUDA device."""

Profile = Literal["clean", "noisy", "paper"]

class DeviceEntry(TypedDict):
    index: int
    name: str
    kind: str
    uuid: str
    driver: str
    memory_bytes: int
    suitable: bool
    cuda: int | None

class MemoryEntry(TypedDict):
    camera: int | None
    purpose: str
    bytes: int
    on_host: bool

def devices() -> list[DeviceEntry]:
    """Every Vulkan device of this machine, and CUDA's number of it."""

class SensorModel:
    """What an event camera is. Every parameter is an attribute; `SensorModel.parameters()` lists them.

    A sensor does not change: `replace` gives another. Wrong values raise `SensorError`, which names the
    parameter, what was expected and what was given.
    """

    name: str
    width: int
    height: int
    contrast_on: float
    contrast_off: float
    contrast_mismatch: float
    refractory_ns: int
    leak_rate_hz: float
    leak_spread_log: float
    shot_noise_rate_hz: float
    white_level: float
    latency_ns: int
    latency_jitter_ns: int
    timestamp_quantum_ns: int
    intensity: str
    exposure_gain: float
    log_offset: float
    synthesis: str
    taps: str
    transfers: int
    substeps: int
    substep_policy: str
    timestamps: str
    max_events_per_interval: int
    aps_exposure_ns: int
    aps_start_ns: int
    aps_gain: float
    aps_bits: int
    seed: int

    def __init__(
        self,
        sensor: Union[SensorModel, str, None] = None,
        /,
        *,
        profile: Profile | None = None,
        **parameters: Any,
    ) -> None:
        """A preset by name (`"davis346"` by default) or a sensor; then a profile, then parameters over it."""
    @staticmethod
    def from_toml(text: str) -> SensorModel: ...
    def to_toml(self) -> str: ...
    def to_dict(self) -> dict[str, Any]: ...
    def replace(self, *, profile: Profile | None = None, **parameters: Any) -> SensorModel:
        """The same with some parameters changed."""
    @staticmethod
    def presets() -> list[tuple[str, int, int, str]]:
        """Name, width, height, description of each."""
    @staticmethod
    def parameters() -> list[tuple[str, str, str]]:
        """Name, unit, description of each."""

class Tensor:
    """An array on a CUDA device, contiguous, for `torch.from_dlpack`, `cupy.asarray`, `jax.dlpack.from_dlpack`.

    It is written when the call that gave it returns: no stream has to wait. Its memory is the tensor's own for
    as long as anything views it; it is used again only once all work on the device is done.
    """

    @property
    def shape(self) -> tuple[int, ...]: ...
    @property
    def dtype(self) -> np.dtype[Any]: ...
    @property
    def nbytes(self) -> int: ...
    @property
    def device(self) -> str: ...
    @property
    def __cuda_array_interface__(self) -> dict[str, Any]: ...
    def __dlpack__(
        self,
        *,
        stream: Any = None,
        max_version: Any = None,
        dl_device: tuple[int, int] | None = None,
        copy: bool | None = None,
    ) -> Any: ...
    def __dlpack_device__(self) -> tuple[int, int]: ...
    def __len__(self) -> int: ...
    def __getitem__(self, key: int | slice) -> Tensor: ...
    def numpy(self) -> NDArray[Any]:
        """A copy on the host."""

class CudaTexture:
    """A renderer's image in CUDA's own layout, for `step` as `hdr`: one copy on the device, from where it was drawn.

    `handle` is a `cudaMipmappedArray_t` or, with `mipmapped=False`, a `cudaArray_t` of four channels, of the device's
    primary context. Its size and format are checked; that it is such a handle cannot be: a number that is none ends
    the process. `stream`: where it is written; the default stream else.
    """

    def __init__(
        self,
        handle: int,
        width: int,
        height: int,
        *,
        dtype: Literal["float16", "float32", "uint8"] = "float16",
        mipmapped: bool = True,
        stream: int | None = None,
    ) -> None: ...
    @property
    def shape(self) -> tuple[int, ...]: ...

class Packet:
    """Events, sorted by (t, y, x, p) and complete to `watermark_ns`: no later packet has an earlier event.

    With packets on the host the arrays own the engine's memory, without a copy: `x`, `y` uint16, `t_ns` int64
    (made of `t_offset_ns` uint32 and `base_ns` when it is asked for), `p` uint8, 0 OFF and 1 ON. With packets on
    a CUDA device they are tensors; there `x` and `y` are int16, which torch can compute with.

    A packet of several cameras holds one camera's events after the other; camera i has those from `offsets[i]`
    to `offsets[i + 1]`, and `packet[i]` is its packet.
    """

    x: Array
    y: Array
    t_ns: Array
    p: Array
    t_offset_ns: NDArray[np.uint32] | None
    offsets: NDArray[np.int64] | None
    base_ns: int
    watermark_ns: int
    sequence: int
    dropped: int
    width: int
    height: int
    def __len__(self) -> int: ...
    def __getitem__(self, camera: int) -> Packet: ...

class ApsFrame:
    t_ns: int
    bits: int
    pixels: NDArray[np.uint16]

class _Cameras:
    def close(self) -> None: ...
    @property
    def closed(self) -> bool: ...
    def __enter__(self) -> Any: ...
    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None: ...
    @property
    def device(self) -> dict[str, str]: ...
    def memory(self) -> list[MemoryEntry]: ...
    def save(self) -> bytes: ...
    def restore(self, state: bytes) -> None: ...

class EventCamera(_Cameras):
    """One event camera.

    `device`: a number or UUID of `devices()`, or `"cuda:N"`; the best by default. `stream`: the CUDA stream that
    the arrays are written in, where the producer does not say so itself (DLPack's do).
    """

    def __init__(
        self,
        sensor: SensorModel | str | None = None,
        *,
        profile: Profile | None = None,
        device: int | str | None = None,
        packets: Packets = "host",
        **parameters: Any,
    ) -> None: ...
    def step(
        self,
        hdr: Array,
        motion: Array | None = None,
        *,
        t_ns: int,
        depth: Array | None = None,
        stream: int | None = None,
    ) -> Packet:
        """The events between the last frame and this one; none for the first."""
    sensor: SensorModel
    """Any parameter but the size may be changed between two steps."""
    def reset(self) -> None:
        """Forgets what was seen: the next frame is the first."""
    def event_frame(self) -> Array:
        """OFF and ON events a pixel of the last step: int32 `(2, height, width)`."""
    def voxel_grid(self, bins: int = 5) -> Array:
        """Votes of +-1 split between bins of time, of the last step: float32 `(bins, height, width)`."""
    @property
    def aps(self) -> ApsFrame | None: ...
    @property
    def statistics(self) -> dict[str, int]:
        """Counts of the last step, its GPU time, and copies since the start."""

class Rig(_Cameras):
    """Cameras of different sensors that step together."""

    def __init__(
        self,
        sensors: Iterable[SensorModel | str],
        *,
        device: int | str | None = None,
        packets: Packets = "host",
    ) -> None: ...
    def __len__(self) -> int: ...
    def step(
        self,
        frames: Sequence[tuple[Array, Array | None] | Array | None],
        t_ns: int | Sequence[int | None],
        *,
        stream: int | None = None,
    ) -> list[Packet]:
        """Steps the cameras whose frame, `(hdr, motion)` or `hdr`, is not None."""
    @property
    def sensors(self) -> list[SensorModel]: ...
    def set_sensor(self, camera: int, sensor: SensorModel) -> None: ...
    def reset(self, cameras: Iterable[int] | None = None) -> None: ...
    def event_frames(self) -> list[Array]: ...
    def voxel_grids(self, bins: int = 5) -> list[Array]: ...
    @property
    def aps(self) -> list[ApsFrame | None]: ...
    @property
    def statistics(self) -> dict[str, Any]: ...

class TiledEventCamera(_Cameras):
    """Many cameras alike, one for each environment, as a tiled renderer draws them: `(num_envs, height, width, c)`.

    Each has noise of its own. One call steps all; one packet holds all, with `offsets`.
    """

    def __init__(
        self,
        sensor: SensorModel | str | None = None,
        num_envs: int = 1,
        *,
        profile: Profile | None = None,
        device: int | str | None = None,
        packets: Packets = "host",
        **parameters: Any,
    ) -> None: ...
    def __len__(self) -> int: ...
    def step(
        self,
        hdr: Array,
        motion: Array | None = None,
        *,
        t_ns: int | Sequence[int],
        depth: Array | None = None,
        stream: int | None = None,
    ) -> Packet: ...
    @property
    def sensor(self) -> SensorModel: ...
    def reset(self, envs: Any = None) -> None:
        """Chosen environments (a sequence or an array of numbers), or all, begin anew."""
    def event_frames(self) -> Array:
        """int32 `(num_envs, 2, height, width)`."""
    def voxel_grids(self, bins: int = 5) -> Array:
        """float32 `(num_envs, bins, height, width)`."""
    @property
    def aps(self) -> list[ApsFrame | None]: ...
    @property
    def statistics(self) -> dict[str, Any]: ...
