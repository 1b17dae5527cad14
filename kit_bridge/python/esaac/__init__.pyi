"""Event cameras for renderers. They take HDR frames, and motion vectors or depth and poses, and give time-ordered
events, on the GPU.

Arrays may be of NumPy, torch, Warp, CuPy, JAX, or any library with the buffer protocol, `__array_interface__`, DLPack
or `__cuda_array_interface__`. On the host they may have any strides. On a CUDA device the pixels of a row must be
contiguous and the rows in order; padded rows and views of some channels are allowed. Arrays on a CUDA device never
pass through the host.

* `hdr`: `(height, width, 3 or 4)`, or `(height, width)` on the host; float16 or float32 linear, or uint8 sRGB.
* `motion`: `(height, width, 2 to 4)`, float16 or float32, in pixels; the first two channels count. It points back in
  time: *previous position = position + motion*, x right, y down.
* `depth`: `(height, width)`, float32, metres. Of a pinhole the distance along the optical axis, of a fisheye that
  from the camera's centre (`Intrinsics.ray_lengths` converts one to the other). Infinite or 0: a background at
  infinity. NaN, negative or too small to invert: the pixel has no path, and is counted.
* `ids`: `(height, width)`, uint16 or uint32 (int16 and int32 are read as these): the instance of each pixel. 0 is the
  static world. Without ids everything is the static world.
* `poses`: where the camera and the bodies are, see `Poses`. With depth and poses, synthesis `rigid` follows exact
  paths; motion vectors then serve only pixels whose instance has no poses. If the first frame lacks something for
  that, synthesis `auto` takes `motion` or `linear` and warns with `SynthesisWarning`; `rigid` by name raises.

A step warns with `InputWarning`, once for each camera, if frames on the host move so fast that many events must be
false: without vectors and poses, or with vectors that shake. It looks at the first 16 frames, of a `TiledEventCamera`
those of the first environment; frames on a CUDA device are not looked at.

The first frame whose step succeeds sets the formats; later frames must have the same. Methods may be called from any
thread. Calls on one camera wait for each other, and the interpreter is free while the device works. A camera made
before fork() raises `ForkError` in the child.

Ctrl-C never breaks off a step: it is raised before the step begins or once it is over. In the second case the step's
packet is in `last_packet` (`last_packets` of a `Rig`), though the call has raised `KeyboardInterrupt`.
"""

from collections.abc import Iterable, Iterator, Sequence
from types import TracebackType
from typing import Any, Literal, TypedDict, Union

import numpy as np
from numpy.typing import NDArray

from esaac import files as files
from esaac import still as still
from esaac.errors import ArgumentError as ArgumentError
from esaac.errors import ClosedError as ClosedError
from esaac.errors import DeviceError as DeviceError
from esaac.errors import EsaacError as EsaacError
from esaac.errors import ForkError as ForkError
from esaac.errors import FrameError as FrameError
from esaac.errors import InputWarning as InputWarning
from esaac.errors import LightWarning as LightWarning
from esaac.errors import PoseWarning as PoseWarning
from esaac.errors import RosError as RosError
from esaac.errors import SensorError as SensorError
from esaac.errors import SynthesisWarning as SynthesisWarning
from esaac.files import EventWriter as EventWriter
from esaac.poses import Axes as Axes
from esaac.poses import Intrinsics as Intrinsics
from esaac.poses import Order as Order
from esaac.poses import PoseRecorder as PoseRecorder
from esaac.poses import Poses as Poses

__version__: str

Array = Any
"""An array of any library, on the host or on a CUDA device."""

Packets = Literal["host", "mapped", "cuda"]
"""Where events go.

* `host`: NumPy arrays that own their memory.
* `mapped`: read-only NumPy arrays over the memory that the device writes. Nothing is copied. An array stays as it is
  for as long as you keep it, whatever steps follow and even when the camera is closed. Its memory is written again
  only once nobody keeps a packet or an array of that step.
* `cuda`: tensors that stay on the CUDA device.

With `mapped`, `packet_ring` buffers (2 by default) are written in turn. While a step runs, the packets of the
`packet_ring - 1` steps before it may be kept at no cost. (The camera itself keeps the last one, for `last_packet`.)
For each older one that is kept, a step allocates another buffer, which takes time and memory: copy what you want to
collect. In a child of fork() mapped arrays cannot be read.
"""

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
    """Parameters of an event camera. Each is an attribute; `SensorModel.parameters()` lists them.

    A sensor cannot be changed: `replace` makes another. Wrong values raise `SensorError`, which names the parameter,
    what was expected and what was given.
    """

    name: str
    width: int
    height: int
    pixel: str
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
    psf_sigma_px: float
    vignetting_fov_deg: float
    flicker_depth: float
    flicker_hz: float
    flicker_phase_deg: float
    synthesis: str
    taps: str
    transfers: int
    layers: int
    substeps: int
    substep_policy: str
    substep_error_ns: int
    timestamps: str
    readout: str
    readout_event_ns: float
    readout_row_ns: float
    readout_cap_events: int
    readout_cap_period_ns: int
    max_events_per_interval: int
    aps_exposure_ns: int
    aps_start_ns: int
    aps_gain: float
    aps_bits: int
    lux_per_unit: float
    response_e_per_lux_s: float
    dark_lux: float
    dark_spread_log: float
    temperature_c: float
    photoreceptor_charge_e: float
    second_pole_hz: float
    noise_gain: float
    leak_per_lux_hz: float
    seed: int

    def __init__(
        self,
        sensor: Union[SensorModel, str, None] = None,
        /,
        *,
        profile: Profile | None = None,
        **parameters: Any,
    ) -> None:
        """A preset (`"davis346"` by default) or a sensor, changed by a profile and then by parameters.

        With another `pixel` a sensor of a preset's name takes that preset's numbers of the new pixel, but keeps those
        that somebody has set to something else than the preset's. The pixel comes before the profile and the other
        parameters. A sensor of another name keeps all.
        """
    @staticmethod
    def from_toml(text: str) -> SensorModel: ...
    def to_toml(self) -> str: ...
    def to_dict(self) -> dict[str, Any]: ...
    def replace(self, *, profile: Profile | None = None, **parameters: Any) -> SensorModel:
        """A copy with some parameters changed, as by the constructor. A sensor does not remember its profile:
        `profile="clean"` of a log pixel changes nothing, so give it again with `pixel="physical"`, whose noise is on.
        """
    @staticmethod
    def presets() -> list[tuple[str, int, int, str]]:
        """Name, width, height, description of each."""
    @staticmethod
    def parameters() -> list[tuple[str, str, str]]:
        """Name, unit, description of each."""

class Tensor:
    """A contiguous array on a CUDA device, for `torch.from_dlpack`, `cupy.asarray` or `jax.dlpack.from_dlpack`.

    Its data are complete when the call returns that gave it, so no stream has to wait. Its memory is reused only when
    nothing views it any more and all work on the device is done.
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
    def __getitem__(self, key: int | slice) -> Tensor:
        """A part of the tensor where it lies. One with a single axis has no parts but slices: a number there raises
        TypeError, and so do `list()` and `np.asarray()`. Copy it with `numpy()` or view it by DLPack."""
    def __iter__(self) -> Iterator[Tensor]: ...
    def numpy(self) -> NDArray[Any]:
        """A copy on the host."""

class CudaTexture:
    """A renderer's image in CUDA's own layout, for `step` as `hdr`. It is copied once, on the device.

    `handle` is a `cudaMipmappedArray_t` or, with `mipmapped=False`, a `cudaArray_t`, of four channels, in the
    device's primary context. Its size and format are checked. Whether the number is such a handle cannot be checked:
    a wrong one ends the process. `stream` is the stream that writes it, by default the default stream.
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

    NumPy arrays are `x`, `y` uint16, `t_ns` int64, `p` uint8 (0 OFF, 1 ON). `t_ns` is made of `t_offset_ns` uint32
    and `base_ns` when you first ask for it. On a CUDA device the columns are tensors, and `x` and `y` are int16,
    which torch can compute with.

    A packet of a `TiledEventCamera` holds one environment's events after the other. Environment i has those from
    `offsets[i]` to `offsets[i + 1]`, and `packet[i]` is its packet, with numbers of its own. Of the whole packet,
    `base_ns` and `watermark_ns` are the earliest, `dropped` is the sum, and `sequence` is the first environment's.
    With `packets="mapped"`, `packet[i]` is in place, and a column of the whole packet is a copy that is made when you
    first ask for it. `offsets` is None for a packet of one camera, and `t_offset_ns` where there is `t_ns` alone.

    Packets on the host, mapped ones too, can be pickled and copied. Those on a CUDA device cannot.
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
    """Setting an attribute that nothing reads, a parameter of the sensor for example, raises `AttributeError`."""

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
    @property
    def pose_warnings(self) -> list[str | None]:
        """For each camera what is wrong, if its depth and poses do not predict its motion vectors: by how much, the
        likely cause, and what follows. A step that finds it warns with `PoseWarning`. Empty before the first
        frame."""
    @property
    def light(self) -> list[dict[str, float] | None]:
        """For each camera with physical pixels the light on its focal plane, in the frames that were looked at:
        `median_lux`, `low_lux` and `high_lux` (nine tenths of the pixels lie between), each up to 5% off,
        `dim_share` (of the pixels below .1 lux), `pixels`, `frames`. None for others, and before the first frame.
        Empty before any."""
    @property
    def light_warnings(self) -> list[list[str]]:
        """For each camera what is wrong with its light: a preset beyond the light that it was fitted for, too few
        sub-steps for a lamp's flicker. A step warns with `LightWarning`, once for each camera and kind. Empty before
        the first frame."""
    def save(self) -> bytes:
        """The state that the next step depends on. In the first intervals of a camera with poses and motion vectors
        the comparison of both begins anew after `restore`, and may find a mistake some intervals later."""
    def restore(self, state: bytes) -> None:
        """Continues from a state that cameras with the same sensors and lenses have saved.

        Raises `ArgumentError` for a state that is damaged, of another version's format, or of other cameras. It names
        the first parameter that differs. The cameras then go on as before."""

def flow(
    depth: Array,
    ids: Array | None = None,
    *,
    intrinsics: Intrinsics | Sequence[float],
    poses: Poses | PoseRecorder,
    from_ns: int,
    to_ns: int,
) -> NDArray[np.float32]:
    """Optical flow by the poses: the displacement until `to_ns` of what each pixel shows at `from_ns`, columns and
    rows [px, y down], float32 `(height, width, 2)`. Both times may be any that the poses reach, so that it fits
    events between them; `to_ns` may be the earlier one.

    `depth` and `ids` are of the image at `from_ns`, `(height, width)` or `(cameras, height, width)`, as for `step`.
    Not a number where there is no path: without depth, or poses of the id, or where the camera does not see the point
    any more. That something comes to lie before it is not looked for. Computed on the host. Wrong types and shapes,
    and poses that do not reach both times, raise `FrameError`."""

def lux_per_unit(
    scene_unit: Literal["luminance", "radiance"],
    f_number: float,
    *,
    transmission: float = 0.9,
    efficacy_lm_per_w: float | None = None,
) -> float:
    """A sensor's `lux_per_unit` behind a lens, for images in cd/m2 (`luminance`) or W/m2/sr (`radiance`). Radiance
    needs the luminous efficacy of its light; white light has 270 lm/W. Divide by `exposure_gain` if it is not 1."""

class EventCamera(_Cameras):
    """One event camera.

    `intrinsics` is its lens, which depth needs: an `Intrinsics`, or `(fx, fy, cx, cy)` of a pinhole. `device` is a
    number or UUID of `devices()`, or `"cuda:N"`; by default the best device. `stream`, of `step`, is the CUDA stream
    that writes the arrays. It is needed only if the arrays do not tell it themselves, as DLPack's do.
    """

    def __init__(
        self,
        sensor: SensorModel | str | None = None,
        *,
        profile: Profile | None = None,
        intrinsics: Intrinsics | Sequence[float] | None = None,
        device: int | str | None = None,
        packets: Packets = "host",
        packet_ring: int | None = None,
        **parameters: Any,
    ) -> None: ...
    def step(
        self,
        hdr: Array,
        motion: Array | None = None,
        *,
        t_ns: int,
        depth: Array | None = None,
        ids: Array | None = None,
        poses: Poses | PoseRecorder | None = None,
        stream: int | None = None,
    ) -> Packet:
        """The events between the last frame and this one; none for the first.

        `poses` must span that interval; for the first frame, its own time."""
    def submit(
        self,
        hdr: Array,
        motion: Array | None = None,
        *,
        t_ns: int,
        depth: Array | None = None,
        ids: Array | None = None,
        poses: Poses | PoseRecorder | None = None,
        stream: int | None = None,
    ) -> None:
        """Begins a step and returns while it runs. `packet` gives its packet; until then there is no other step.

        Arrays on the host are copied before this returns. Those on a CUDA device may be written again by work that is
        put into their stream afterwards."""
    def packet(self) -> Packet:
        """The packet of the step that was submitted, once it is done."""
    @property
    def synthesis(self) -> str | None:
        """What `synthesis="auto"` has come to, by what the first frame brought; None before. `motion` if depth and
        poses do not predict the motion vectors. `SynthesisWarning` says why depth or poses are left out."""
    @property
    def last_packet(self) -> Packet | None:
        """What the last step returned, for a caller whom an interrupt kept from it. It is the camera's until the
        next step."""
    sensor: SensorModel
    """Any parameter but the size may be changed between two steps."""
    def reset(self) -> None:
        """Begins anew: the next frame is the first."""
    def event_frame(self) -> Array:
        """Number of OFF and ON events of each pixel in the last step: int32 `(2, height, width)`."""
    def voxel_grid(self, bins: int = 5) -> Array:
        """Events of the last step in bins of time: float32 `(bins, height, width)`. Each event adds +1 or -1, split
        between the two nearest bins."""
    def event_ids(self) -> Array:
        """The id of the instance that each event of the last step shows when it is sent: int64 `(events,)`, in the
        order of the packet; -1 where no path tells it. At a silhouette it is that of what is in front. Ids are those
        of `ids` and `poses`; 0 is the static world. Needs synthesis `rigid`, and no reset nor another sensor or state
        since the step; else an `ArgumentError`."""
    @property
    def aps(self) -> ApsFrame | None: ...
    @property
    def statistics(self) -> dict[str, int]:
        """Counts and times of the last step, and the number of copies since the start.

        `gpu_ns` is the device's time, `submit_to_packet_ns` the time from submission to packets on the host,
        `step_ns` all time below Python, and `frames_ns` the part of it until the frames lie where the engine reads
        them.

        Of the frame: `invalid_pixels`, whose colour is NaN, infinite or negative (they keep their last value);
        `invalid_motion`, whose vector is not finite (they are blended); `unarmed_pixels`, which never had a valid
        colour (they send nothing); `skipped_blocks`, blocks of 8x8 pixels in and around which nothing changes (no
        event is lost); `deferred_events`, which a later packet brings; `regrown`, how often the event buffers had
        to grow (no event is lost). The guide's page on input has those of pixels without a path.
        """

class Rig(_Cameras):
    """Cameras of different sensors that step together. `intrinsics` has a lens, or None, for each."""

    def __init__(
        self,
        sensors: Iterable[SensorModel | str],
        *,
        intrinsics: Sequence[Intrinsics | Sequence[float] | None] | None = None,
        device: int | str | None = None,
        packets: Packets = "host",
        packet_ring: int | None = None,
    ) -> None: ...
    def __len__(self) -> int: ...
    def step(
        self,
        frames: Sequence[tuple[Array | None, ...] | Array | None],
        t_ns: int | Sequence[int | None],
        *,
        poses: Sequence[Poses | PoseRecorder | None] | None = None,
        stream: int | None = None,
    ) -> list[Packet]:
        """Steps the cameras whose frame is not None. A frame is `hdr`, or `(hdr, motion, depth, ids)`, of which the
        later ones may be None or left out; more than these raise `FrameError`. Each camera has poses, or a recorder,
        of its own."""
    def submit(
        self,
        frames: Sequence[tuple[Array | None, ...] | Array | None],
        t_ns: int | Sequence[int | None],
        *,
        poses: Sequence[Poses | PoseRecorder | None] | None = None,
        stream: int | None = None,
    ) -> None:
        """As `EventCamera.submit`, for all cameras."""
    def packets(self) -> list[Packet]:
        """The packets of the step that was submitted, once it is done."""
    @property
    def syntheses(self) -> list[str | None]:
        """What `synthesis="auto"` has come to for each camera, as of an `EventCamera`."""
    @property
    def last_packets(self) -> list[Packet]:
        """What the last step returned; empty before the first."""
    @property
    def sensors(self) -> list[SensorModel]: ...
    def set_sensor(self, camera: int, sensor: SensorModel) -> None: ...
    def reset(self, cameras: Any = None) -> None:
        """Lets some cameras begin anew: a number, several, or a mask with a bool for each; None for all."""
    def event_frames(self) -> list[Array]: ...
    def voxel_grids(self, bins: int = 5) -> list[Array]: ...
    def event_ids(self) -> list[Array]:
        """As `EventCamera.event_ids`, of each camera. All must have synthesis `rigid`. Of a camera that was reset, or
        got another sensor, since the step all are -1, as many as its packet of that step has events. If that is so of
        all cameras, `ArgumentError`."""
    @property
    def aps(self) -> list[ApsFrame | None]: ...
    @property
    def statistics(self) -> dict[str, Any]: ...

class TiledEventCamera(_Cameras):
    """Many equal cameras, one for each environment of a tiled renderer, with arrays `(num_envs, height, width, c)`.

    Each has its own noise. One call steps all, and one packet holds the events of all. All share `intrinsics`.
    """

    def __init__(
        self,
        sensor: SensorModel | str | None = None,
        num_envs: int = 1,
        *,
        profile: Profile | None = None,
        intrinsics: Intrinsics | Sequence[float] | None = None,
        device: int | str | None = None,
        packets: Packets = "host",
        packet_ring: int | None = None,
        **parameters: Any,
    ) -> None: ...
    def __len__(self) -> int: ...
    def step(
        self,
        hdr: Array,
        motion: Array | None = None,
        *,
        t_ns: int | Sequence[int | None],
        depth: Array | None = None,
        ids: Array | None = None,
        poses: Poses | PoseRecorder | None = None,
        stream: int | None = None,
    ) -> Packet:
        """Steps all environments, or those whose time is not None. The others wait: their images are not looked at,
        and they have no events in the packet."""
    def submit(
        self,
        hdr: Array,
        motion: Array | None = None,
        *,
        t_ns: int | Sequence[int | None],
        depth: Array | None = None,
        ids: Array | None = None,
        poses: Poses | PoseRecorder | None = None,
        stream: int | None = None,
    ) -> None:
        """As `EventCamera.submit`, for all environments."""
    def packet(self) -> Packet:
        """The packet of the step that was submitted, once it is done."""
    @property
    def synthesis(self) -> str | None:
        """What `synthesis="auto"` has come to, by what the first frame brought; None before. `motion` if depth and
        poses do not predict the motion vectors. `SynthesisWarning` says why depth or poses are left out."""
    @property
    def last_packet(self) -> Packet | None:
        """What the last step returned, for a caller whom an interrupt kept from it."""
    @property
    def sensor(self) -> SensorModel:
        """Of the first environment."""
    @property
    def sensors(self) -> list[SensorModel]:
        """Of each environment."""
    def set_sensor(self, env: int, sensor: SensorModel) -> None:
        """Gives an environment a sensor of its own from its next step on. Any parameter but the size may differ."""
    def reset(self, envs: Any = None) -> None:
        """Lets some environments begin anew: a number, several, or a mask with a bool for each; None for all."""
    def event_frames(self) -> Array:
        """int32 `(num_envs, 2, height, width)`."""
    def voxel_grids(self, bins: int = 5) -> Array:
        """float32 `(num_envs, bins, height, width)`."""
    def event_ids(self) -> Array:
        """As `EventCamera.event_ids`, of the events of all environments in the order of the packet. Those of an
        environment that was reset, or got another sensor, since the step are -1. If that is so of all environments,
        `ArgumentError`."""
    @property
    def aps(self) -> list[ApsFrame | None]: ...
    @property
    def statistics(self) -> dict[str, Any]: ...
