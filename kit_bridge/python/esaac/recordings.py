"""Reads recordings: `.npz`, as the command and `files.save` write it, HDF5 in DSEC's layout, EVT3 and AEDAT 4; and
true events, as `esaac render --truth` writes them."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import os
import pathlib
import zipfile
import zlib
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from esaac._native import SensorModel, load_recording
from esaac.checks import LEAST_NS, MOST_NS, ids_column, nanoseconds
from esaac.claims import check_array, check_dataset, check_member
from esaac.columns import check_range, polarities
from esaac.errors import ArgumentError, EsaacError

SUFFIXES = (".npz", ".h5", ".hdf5", ".raw", ".aedat4")

MOST_SIDE_PX = 1 << 16
MOST_US = MOST_NS // 1000

TRUTH = ("events_of_pixel", "dt_ns_low", "dt_ns_high", "p", "sensor")
"""Arrays of true events."""


@dataclasses.dataclass(frozen=True)
class Events:
    """Events of a recording in order of time, as packets have them and `files.save` takes them."""

    x: NDArray[np.uint16]
    y: NDArray[np.uint16]
    t_ns: NDArray[np.int64]
    p: NDArray[np.uint8]
    """0 (OFF) and 1 (ON)."""
    ids: NDArray[np.int64] | None
    """The instance that each event shows; None if the recording has none."""
    sensor: SensorModel | None
    """None if the recording names none, as those of the DSEC data set and of real cameras."""
    size_px: tuple[int, int] | None = None
    """Columns and rows of the sensor; None if the recording does not tell them, as those of the DSEC data set."""

    def __len__(self) -> int:
        return len(self.t_ns)


def load(path: str | os.PathLike[str], *, from_ns: int | None = None, to_ns: int | None = None) -> Events:
    """Reads a recording, or its events from `from_ns` on and before `to_ns`. Of an HDF5 file only their part is read,
    if its index fits the times there.

    Events that are not in order of time are sorted; those of one time stay as they are. A file that is no recording,
    is damaged, claims more than it holds, or has pixels beyond its sensor or polarities that are none raises
    `ArgumentError`."""
    path = pathlib.Path(path)
    if path.suffix not in SUFFIXES:
        raise ArgumentError(f"{path.name}, expected one of {', '.join(SUFFIXES)}")
    first_ns = None if from_ns is None else nanoseconds(from_ns, "from_ns")
    end_ns = None if to_ns is None else nanoseconds(to_ns, "to_ns")
    if path.suffix == ".npz":
        return _cut(_load_npz(path), first_ns, end_ns)
    if path.suffix in (".raw", ".aedat4"):
        return _load_native(path, first_ns, end_ns)
    return _cut(_load_hdf5(path, first_ns, end_ns), first_ns, end_ns)


def load_dsec(
    path: str | os.PathLike[str],
) -> tuple[NDArray[np.uint16], NDArray[np.uint16], NDArray[np.int64], NDArray[np.uint8]]:
    """Reads what `files.save` wrote as `.h5`, or a file of the DSEC data set: x, y, t_ns, p."""
    events = _load_hdf5(pathlib.Path(path), None, None)
    return events.x, events.y, events.t_ns, events.p


def h5py_library() -> Any:
    """The module `h5py`, and the filters of `hdf5plugin` if that is there. An error tells how to install `h5py`."""
    try:
        import h5py
    except ImportError as error:
        raise ImportError("HDF5 files need h5py: pip install esaac[hdf5]") from error
    with contextlib.suppress(ImportError):
        importlib.import_module("hdf5plugin")
    return h5py


def _load_npz(path: pathlib.Path) -> Events:
    try:
        with zipfile.ZipFile(path) as archive:
            members = {member.filename.removesuffix(".npy"): member for member in archive.infolist()}
            is_truth = TRUTH[0] in members
            _check_columns(path, members, TRUTH if is_truth else "xytp")

            def column(name: str, kinds: str = "iub", axes: int = 1) -> NDArray[Any]:
                member = members[name]
                check_member(path, member)
                with archive.open(member) as stream:
                    check_array(path, member, stream, kinds, axes)
                with archive.open(member) as stream:
                    return np.lib.format.read_array(stream, allow_pickle=False)

            sensor = SensorModel.from_toml(str(column("sensor", "U", 0))) if "sensor" in members else None
            if is_truth:
                return _of_pixels(path, sensor, *(column(name) for name in TRUTH[:4]))
            x, y, t_ns, p = (column(name) for name in "xytp")
            ids = column("id") if "id" in members else None
    except zipfile.BadZipFile as error:
        damaged = f"{path.name} is damaged: {error}"
        none = f"{path.name} is no .npz archive, or not a whole one"
        raise ArgumentError(damaged if zipfile.is_zipfile(path) else none) from error
    except EsaacError:
        raise
    except (EOFError, RuntimeError, ValueError, zlib.error) as error:
        raise ArgumentError(f"{path.name} is damaged: {error}") from error
    _check_lengths(path, [x, y, t_ns, p] if ids is None else [x, y, t_ns, p, ids])
    check_range(t_ns, LEAST_NS, MOST_NS, f"{path.name}: t")
    return _events(path, x, y, t_ns, p, ids, sensor)


def _events(
    path: pathlib.Path,
    x: NDArray[Any],
    y: NDArray[Any],
    t_ns: NDArray[Any],
    p: NDArray[Any],
    ids: NDArray[Any] | None,
    sensor: SensorModel | None,
) -> Events:
    """Events in order of time, of a file's columns of one length."""
    size_px = _size_px(sensor)
    for name, column, side_px in zip("xy", (x, y), size_px or (MOST_SIDE_PX, MOST_SIDE_PX)):
        check_range(column, 0, side_px - 1, f"{path.name}: {name}")
    events = Events(
        np.ascontiguousarray(x, np.uint16),
        np.ascontiguousarray(y, np.uint16),
        np.ascontiguousarray(t_ns, np.int64),
        polarities(p, f"{path.name}: p"),
        None if ids is None else ids_column(ids, len(t_ns), f"{path.name}: ids"),
        sensor,
        size_px,
    )
    return _chosen(events, np.argsort(events.t_ns, kind="stable")) if _goes_back(events.t_ns) else events


def _goes_back(t_ns: NDArray[Any]) -> bool:
    return bool((t_ns[1:] < t_ns[:-1]).any())


def _of_pixels(
    path: pathlib.Path,
    sensor: SensorModel,
    count: NDArray[Any],
    dt_ns_low: NDArray[Any],
    dt_ns_high: NDArray[Any],
    p: NDArray[Any],
) -> Events:
    """True events, which come pixel by pixel with the time since the pixel's previous one."""
    count = count.astype(np.int64)
    if len(count) != sensor.width * sensor.height:
        raise ArgumentError(
            f"{path.name} has {len(count)} pixels, expected {sensor.width * sensor.height} "
            f"({sensor.width} x {sensor.height})"
        )
    _check_lengths(path, [dt_ns_low, dt_ns_high, p])
    if count.min() < 0 or count.sum() != len(p):
        raise ArgumentError(f"{path.name} has {len(p)} events, expected {count.sum()}, the sum of all pixels")
    for name, half in (("dt_ns_low", dt_ns_low), ("dt_ns_high", dt_ns_high)):
        check_range(half, 0, 0xFFFF, f"{path.name}: {name}")
    p = polarities(p, f"{path.name}: p")
    t_ns = np.cumsum(dt_ns_low.astype(np.int64) | dt_ns_high.astype(np.int64) << 16)
    before = np.cumsum(count) - count
    t_ns -= np.repeat(np.append(0, t_ns)[before], count)
    pixel = np.repeat(np.arange(len(count)), count)
    order = np.lexsort((p, pixel, t_ns))
    y, x = (part.astype(np.uint16) for part in np.divmod(pixel[order], sensor.width))
    return Events(x, y, t_ns[order], p[order], None, sensor, _size_px(sensor))


def _load_native(path: pathlib.Path, first_ns: int | None, end_ns: int | None) -> Events:
    """The events of an interval of a file that the native part reads."""
    size_px, columns = load_recording(path, first_ns, end_ns)
    return Events(*columns, ids=None, sensor=None, size_px=size_px)


def _load_hdf5(path: pathlib.Path, first_ns: int | None, end_ns: int | None) -> Events:
    """The events of a recording, or at least those of an interval."""
    library = h5py_library()
    if path.exists() and not library.is_hdf5(path):
        raise ArgumentError(f"{path.name} is no HDF5 file")
    try:
        with library.File(path, "r") as file:
            try:
                return _of_hdf5(path, file, first_ns, end_ns)
            except OSError:
                _check_filters(library, path, file)
                raise
    except EsaacError:
        raise
    except (KeyError, OSError, RuntimeError, ValueError) as error:
        # An error of the system has its number: the file is not there, or may not be read.
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise ArgumentError(f"{path.name} is damaged: {error}") from error


def _check_filters(library: Any, path: pathlib.Path, file: Any) -> None:
    """Raises if a dataset was packed by a filter that HDF5 does not have here, as those of the DSEC data set are."""
    needed = set()

    def look(_: str, item: Any) -> None:
        if isinstance(item, library.Dataset):
            packing = item.id.get_create_plist()
            filters = [packing.get_filter(number) for number in range(packing.get_nfilters())]
            needed.update((code, name.decode(errors="replace")) for code, _, _, name in filters)

    file.visititems(look)
    lacking = [f"{name} ({code})" for code, name in sorted(needed) if not library.h5z.filter_avail(code)]
    if lacking:
        raise ArgumentError(f"{path.name} needs the HDF5 filter {', '.join(lacking)}: pip install hdf5plugin")


def _of_hdf5(path: pathlib.Path, file: Any, first_ns: int | None, end_ns: int | None) -> Events:
    events = file.get("events", {})
    _check_columns(path, events.keys() if hasattr(events, "keys") else (), "xytp")
    names = [name for name in ("x", "y", "t", "p", "id") if name in events]
    for name in names:
        check_dataset(path, events[name], f"events/{name}")
    _check_lengths(path, [events[name] for name in names])
    offset_us = _t_offset_us(path, file["t_offset"]) if "t_offset" in file else 0
    first, end = 0, len(events["t"])
    if "ms_to_idx" in file:
        check_dataset(path, file["ms_to_idx"], "ms_to_idx")
        first, end = _rows(file["ms_to_idx"], end, offset_us, first_ns, end_ns)
    t_ns = _times_of_rows(path, events["t"], first, end, offset_us, first_ns, end_ns)
    if t_ns is None:
        first, end = 0, len(events["t"])
        t_ns = _times_ns(path, events["t"][:], offset_us)
    columns = {name: events[name][first:end] for name in names if name != "t"}
    sensor = SensorModel.from_toml(file.attrs["sensor"]) if "sensor" in file.attrs else None
    x, y, p = (columns[name] for name in "xyp")
    return _events(path, x, y, t_ns, p, columns.get("id"), sensor)


def _times_of_rows(
    path: pathlib.Path,
    t_us: Any,
    first: int,
    end: int,
    offset_us: int,
    first_ns: int | None,
    end_ns: int | None,
) -> NDArray[np.int64] | None:
    """Times of the rows that an index tells for an interval. None if they and those beside them do not fit it: then
    it is not the index of events in order of time, and any row may be one of the interval."""
    count = len(t_us)
    near, behind = max(first - 1, 0), min(end + 1, count)
    t_ns = _times_ns(path, t_us[near:behind], offset_us)
    if (first, end) != (0, count):
        fits = not _goes_back(t_ns)
        fits &= first == 0 or first_ns is None or bool(t_ns[0] < first_ns)
        fits &= end == count or end_ns is None or bool(t_ns[-1] >= end_ns)
        if not fits:
            return None
    return t_ns[first - near : end - near]


def _times_ns(path: pathlib.Path, t_us: NDArray[Any], offset_us: int) -> NDArray[np.int64]:
    check_range(t_us, -MOST_US - offset_us, MOST_US - offset_us, f"{path.name}: t")
    return (t_us.astype(np.int64) + offset_us) * 1000


def _t_offset_us(path: pathlib.Path, offset: Any) -> int:
    if getattr(offset, "shape", None) not in ((), (1,)):
        raise ArgumentError(f"{path.name}: t_offset is {offset!r}, expected one number")
    offset_us = int(np.ravel(offset[()])[0])
    if not -MOST_US <= offset_us <= MOST_US:
        raise ArgumentError(f"{path.name}: t_offset is {offset_us}, expected {-MOST_US} to {MOST_US} us")
    return offset_us


def _size_px(sensor: SensorModel | None) -> tuple[int, int] | None:
    return None if sensor is None else (sensor.width, sensor.height)


def _rows(
    index: Any, count: int, offset_us: int, first_ns: int | None, end_ns: int | None
) -> tuple[int, int]:
    """Rows that contain the events of an interval. Entry `ms` of the index is the first row at or after it. An index
    may tell anything."""

    def row(t_ns: int | None, up: int, without: int) -> int:
        if t_ns is None or not len(index):
            return without
        ms = (t_ns // 1000 - offset_us) // 1000 + up
        if ms >= len(index):
            # The index may end before the events do.
            return count if up else int(index[len(index) - 1])
        return int(index[max(ms, 0)])

    first = min(max(row(first_ns, 0, 0), 0), count)
    return first, min(max(row(end_ns, 1, count), first), count)


def _cut(events: Events, first_ns: int | None, end_ns: int | None) -> Events:
    first = 0 if first_ns is None else np.searchsorted(events.t_ns, first_ns)
    end = len(events) if end_ns is None else np.searchsorted(events.t_ns, end_ns)
    return _chosen(events, slice(first, end))


def _chosen(events: Events, rows: slice | NDArray[np.intp]) -> Events:
    """These events, in the order of their rows."""
    columns = {name: getattr(events, name) for name in ("x", "y", "t_ns", "p", "ids")}
    kept = {name: None if column is None else column[rows] for name, column in columns.items()}
    return dataclasses.replace(events, **kept)


def _check_columns(path: pathlib.Path, names: Any, expected: Iterable[str]) -> None:
    missing = ", ".join(name for name in expected if name not in names)
    if missing and len(names):
        raise ArgumentError(f"{path.name} has {', '.join(sorted(names))}, expected also {missing}")
    if missing:
        raise ArgumentError(f"{path.name} has no events, expected {missing}")


def _check_lengths(path: pathlib.Path, columns: list[Any]) -> None:
    lengths = [len(column) for column in columns]
    if min(lengths) < max(lengths):
        raise ArgumentError(
            f"{path.name} has columns of {min(lengths)} to {max(lengths)} events, expected all of one length"
        )
