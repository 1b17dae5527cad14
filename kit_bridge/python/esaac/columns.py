"""Columns of events: which values they may have."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from esaac.errors import ArgumentError


def check_range(column: NDArray[Any], low: int, high: int, name: str) -> None:
    """Raises if a column of integers has a value outside of `low` to `high`; `name` is its name in errors."""
    if not len(column):
        return
    for value in (int(column.min()), int(column.max())):
        if not low <= value <= high:
            raise ArgumentError(f"{name} has {value}, expected {low} to {high}")


def polarities(p: NDArray[Any], name: str) -> NDArray[np.uint8]:
    """0 (OFF) and 1 (ON), of 0 and 1, -1 and 1, or booleans; `name` is the column's name in errors."""
    check_range(p, -1, 1, name)
    if (p == -1).any() and (p == 0).any():
        raise ArgumentError(f"{name} has -1, 0 and perhaps 1, expected 0 and 1, or -1 and 1")
    return np.ascontiguousarray(p == 1, np.uint8)
