"""Event cameras for renderers: HDR frames and motion vectors in, time-ordered events out, on the GPU."""

from esaac import files
from esaac._native import Packet, SensorModel, Tensor, __version__, devices
from esaac.cameras import ApsFrame, EventCamera, Rig, TiledEventCamera
from esaac.errors import (
    ArgumentError,
    ClosedError,
    DeviceError,
    EsaacError,
    ForkError,
    FrameError,
    SensorError,
)
from esaac.files import EventWriter

__all__ = [
    "ApsFrame",
    "ArgumentError",
    "ClosedError",
    "DeviceError",
    "EsaacError",
    "EventCamera",
    "EventWriter",
    "ForkError",
    "FrameError",
    "Packet",
    "Rig",
    "SensorError",
    "SensorModel",
    "Tensor",
    "TiledEventCamera",
    "__version__",
    "devices",
    "files",
]
