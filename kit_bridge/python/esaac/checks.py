"""Times, depth, and numbers of cameras and environments, as callers give them."""

from __future__ import annotations

import operator
from collections.abc import Iterable
from typing import Any

import numpy as np

from esaac._native import MOST_BINS
from esaac.errors import ArgumentError, FrameError

LEAST_NS, MOST_NS = -(1 << 63), (1 << 63) - 1
"""Times have 64 bits."""

MOST_ID = 0xFFFFFFFF
"""Greatest id of an instance."""

UNKNOWN = MOST_ID
"""Id of what has no pose of its own in MuJoCo and Newton: tendons, particles, what deforms. No table of theirs has
it, so such pixels are counted."""


def on_host(array: Any) -> np.ndarray[Any, Any]:
    """An array of any library as NumPy's."""
    if hasattr(array, "detach"):
        array = array.detach().cpu()
    if not isinstance(array, np.ndarray):
        for name in ("numpy", "get"):
            if hasattr(array, name):
                array = getattr(array, name)()
                break
    return np.asarray(array)


def nanoseconds(t_ns: Any, name: str = "t_ns") -> int:
    """A time as an int; `name` is its name in errors. A float is refused: it is seconds, most often."""
    try:
        time = operator.index(t_ns)
    except TypeError:
        expected = "expected an integer, nanoseconds: round(seconds * 1e9)"
        raise TypeError(f"{name} is {t_ns!r}, {expected}") from None
    if not LEAST_NS <= time <= MOST_NS:
        raise ArgumentError(f"{name} is {time}, expected {LEAST_NS} to {MOST_NS} ns")
    return time


def ids_column(ids: Any, count: int, name: str = "ids") -> np.ndarray[Any, Any]:
    """Instances of `count` events as int64, copied only if they are not so yet; `name` is their name in errors."""
    ids = np.asarray(ids)
    # An empty list has no type that tells anything.
    if ids.shape != (count,) or (ids.dtype.kind not in "iu" and count):
        raise ArgumentError(
            f"{name} are {ids.dtype} {ids.shape}, expected {count} integers, one for each event"
        )
    most = np.iinfo(np.int64).max
    if count and ids.dtype.kind == "u" and ids.max() > most:
        raise ArgumentError(f"{name} have {ids.max()}, expected at most {most}")
    return np.ascontiguousarray(ids, np.int64)


def check_depth(depth: np.ndarray[Any, Any], name: str) -> None:
    """Raises if depth is no image of metres as `step` takes it: whole numbers are millimetres, most often. `name` is
    its name in errors."""
    if depth.dtype != np.float32:
        raise FrameError(f"{name} has dtype {depth.dtype.str}, expected float32")


def bins_of(bins: Any) -> int:
    """The number of bins of a voxel grid."""
    return whole_number(bins, 1, MOST_BINS, "bins")


def whole_number(given: Any, least: int, most: int, name: str) -> int:
    """A number of something as an int; `name` is its name in errors."""
    expected = f"expected a whole number from {least} to {most}"
    try:
        count = operator.index(given)
    except TypeError:
        raise ArgumentError(f"{name} is {given!r}, {expected}") from None
    if not least <= count <= most:
        raise ArgumentError(f"{name} is {count}, {expected}")
    return count


def index_of(given: Any, count: int, what: str) -> int:
    """The number of one of `count` cameras or environments; `what` names the kind in errors."""
    expected = f"expected a number from 0 to {count - 1}"
    try:
        index = operator.index(given)
    except TypeError:
        raise ArgumentError(f"{what} is {given!r}, {expected}") from None
    if not 0 <= index < count or isinstance(given, (bool, np.bool_)):
        raise ArgumentError(f"{what} is {given!r}, {expected}")
    return index


def indices_of(given: Any, count: int, what: str) -> list[int]:
    """Numbers of some of `count` cameras or environments, of a number, of several, or of a mask with a bool for
    each."""
    values = listed(given)
    values = values if isinstance(values, list) else [values]
    return _of_mask(values, count, what) if _are_bools(values) else [index_of(v, count, what) for v in values]


def indices_of_mask(given: Any, count: int, what: str) -> list[int]:
    """Numbers of the cameras or environments for which a mask is true."""
    values = listed(given)
    if not isinstance(values, list) or not _are_bools(values):
        raise ArgumentError(f"mask of {what}s is {given!r}, expected {count} bools")
    return _of_mask(values, count, what)


def listed(given: Any) -> Any:
    """The entries of an array of any library or of another iterable as a list. One number stays as it is."""
    if hasattr(given, "tolist"):
        return given.tolist()
    if hasattr(given, "numpy"):
        return given.numpy().tolist()
    return list(given) if isinstance(given, Iterable) and not isinstance(given, (str, bytes)) else given


def _are_bools(values: list[Any]) -> bool:
    return bool(values) and all(isinstance(value, (bool, np.bool_)) for value in values)


def _of_mask(values: list[Any], count: int, what: str) -> list[int]:
    if len(values) != count:
        raise ArgumentError(f"mask of {what}s has {len(values)} entries, expected {count}")
    return [index for index, value in enumerate(values) if value]
