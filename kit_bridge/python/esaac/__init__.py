"""Event cameras for renderers. They take HDR frames and motion vectors and give time-ordered events, on the GPU."""

from esaac import files, still
from esaac._native import CudaTexture, Packet, SensorModel, Tensor, __version__, devices, lux_per_unit
from esaac.cameras import ApsFrame, EventCamera, Rig, TiledEventCamera
from esaac.errors import (
    ArgumentError,
    ClosedError,
    DeviceError,
    EsaacError,
    ForkError,
    FrameError,
    InputWarning,
    LightWarning,
    PoseWarning,
    RosError,
    SensorError,
    SynthesisWarning,
)
from esaac.files import EventWriter
from esaac.optical_flow import flow
from esaac.poses import Intrinsics, PoseRecorder, Poses

__all__ = [
    "ApsFrame",
    "ArgumentError",
    "ClosedError",
    "CudaTexture",
    "DeviceError",
    "EsaacError",
    "EventCamera",
    "EventWriter",
    "ForkError",
    "FrameError",
    "InputWarning",
    "Intrinsics",
    "LightWarning",
    "Packet",
    "PoseRecorder",
    "PoseWarning",
    "Poses",
    "Rig",
    "RosError",
    "SensorError",
    "SensorModel",
    "SynthesisWarning",
    "Tensor",
    "TiledEventCamera",
    "__version__",
    "devices",
    "files",
    "flow",
    "lux_per_unit",
    "still",
]
