import os
import pathlib
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from esaac import Array, Packet, SensorModel
from esaac.recordings import Events as Events
from esaac.recordings import load as load
from esaac.recordings import load_dsec as load_dsec

SUFFIXES: tuple[str, ...]
ID_SUFFIXES: tuple[str, ...]
EVT3_SIDE_PX: int
EVT3_END_US: int
HDF5_SPAN_US: int

class EventWriter:
    path: pathlib.Path
    sensor: SensorModel
    def __init__(self, path: str | os.PathLike[str], sensor: SensorModel) -> None: ...
    def write(self, packet: Packet, ids: Array | None = None) -> None: ...
    def close(self, path: str | os.PathLike[str] | None = None) -> None: ...
    @property
    def closed(self) -> bool: ...
    def __len__(self) -> int: ...
    def __enter__(self) -> EventWriter: ...
    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None: ...

def save(
    path: str | os.PathLike[str],
    x: NDArray[np.integer[Any]],
    y: NDArray[np.integer[Any]],
    t_ns: NDArray[np.integer[Any]],
    p: NDArray[np.integer[Any] | np.bool_],
    *,
    ids: NDArray[np.integer[Any]] | None = None,
    sensor: SensorModel,
) -> None: ...
