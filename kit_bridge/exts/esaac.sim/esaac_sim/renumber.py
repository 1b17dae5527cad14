"""Images of ids with other numbers, made where the image is."""

from typing import Any

import numpy as np
import warp as wp


@wp.kernel(enable_backward=False)
def _renumber(
    ids: wp.array2d(dtype=Any),
    before: wp.array(dtype=wp.uint32),
    after: wp.array(dtype=wp.uint32),
    out: wp.array2d(dtype=wp.uint32),
):
    row, column = wp.tid()
    number = wp.uint32(ids[row, column])
    at = wp.lower_bound(before, number)
    if at < before.shape[0]:
        if before[at] == number:
            number = after[at]
    out[row, column] = number


def renumbered(ids, changes):
    """A copy of an image `[row, column]` of NumPy or Warp, as an array of Warp: each id that is a key of the dict
    `changes` has its value instead."""
    ids = ids if isinstance(ids, wp.array) else wp.array(np.ascontiguousarray(ids), device="cpu")
    before = sorted(changes)
    tables = [
        wp.array(np.array(table, np.uint32), device=ids.device)
        for table in (before, [changes[number] for number in before])
    ]
    out = wp.empty(ids.shape, wp.uint32, device=ids.device)
    wp.launch(_renumber, ids.shape, [ids, *tables], [out], device=ids.device)
    return out
