"""Poses out of rigid 4x4 matrices, as most renderers have them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from esaac.errors import FrameError

if TYPE_CHECKING:
    from numpy.typing import NDArray

# Rounding of float32 that a rotation may have.
_TOLERANCE = 1e-3


def poses_of(matrices: NDArray[Any], name: str) -> NDArray[np.float64]:
    """`(..., 7)`, x y z and a quaternion x y z w, of matrices `(..., 4, 4)` or `(..., 3, 4)`."""
    if matrices.shape[-2:] not in ((4, 4), (3, 4)) or matrices.dtype.kind not in "fiu":
        raise FrameError(
            f"poses: {name} has shape {matrices.shape} and dtype {matrices.dtype}, expected numbers (..., 4, 4) or "
            "(..., 3, 4)"
        )
    matrices = matrices.astype(np.float64)
    _check(matrices, name)
    return np.concatenate([matrices[..., :3, 3], _quaternions(matrices[..., :3, :3])], axis=-1)


def _check(matrices: NDArray[np.float64], name: str) -> None:
    turns = matrices[..., :3, :3]
    x, y, z = (turns[..., axis] for axis in range(3))
    products = turns @ np.swapaxes(turns, -1, -2)
    rigid = np.abs(products - np.eye(3)).max(axis=(-1, -2)) < _TOLERANCE
    # A mirror has a third axis that points the other way.
    rigid &= (np.cross(x, y) * z).sum(axis=-1) > 0
    if matrices.shape[-2] == 4:
        rigid &= (np.abs(matrices[..., 3, :] - (0, 0, 0, 1)) < _TOLERANCE).all(axis=-1)
    # NaN is not rigid either.
    if not rigid.all():
        first = tuple(int(index) for index in np.argwhere(~rigid)[0])
        raise FrameError(
            f"poses: {name}{list(first)} is {_fault(matrices[first])}, expected a rigid transform: no scale, no "
            "mirror, translation in the last column"
        )


def _fault(matrix: NDArray[np.float64]) -> str:
    """What is wrong with a matrix that is not rigid."""
    if not np.isfinite(matrix).all():
        return f"not finite: {matrix.tolist()}"
    turn = matrix[:3, :3]
    if len(matrix) == 4 and np.abs(matrix[3] - (0, 0, 0, 1)).max() >= _TOLERANCE:
        if np.abs(matrix[:, 3] - (0, 0, 0, 1)).max() < _TOLERANCE:
            return f"transposed: its last row is {matrix[3].tolist()}"
        return f"not affine: its last row is {matrix[3].tolist()}, and not 0, 0, 0, 1"
    squares = turn.T @ turn
    if np.abs(squares - np.diag(np.diag(squares))).max() >= _TOLERANCE:
        return f"sheared: its columns are not at right angles: {turn.tolist()}"
    sizes = np.sqrt(np.diag(squares))
    if np.abs(sizes**2 - 1).max() >= _TOLERANCE:
        return f"scaled: its columns have the lengths {sizes.round(6).tolist()}"
    return "mirrored: its determinant is -1"


def _quaternions(turns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of rotations `(..., 3, 3)`, scalar last."""
    xx, yy, zz = (turns[..., axis, axis] for axis in range(3))
    # Four times the squares of x, y, z, w; the largest is far from 0.
    squares = np.stack([1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz, 1 + xx + yy + zz], axis=-1)
    sums = lambda a, b: turns[..., a, b] + turns[..., b, a]
    gaps = lambda a, b: turns[..., a, b] - turns[..., b, a]
    x, y, z, w = np.moveaxis(squares, -1, 0)
    rows = np.stack(
        [
            np.stack([x, sums(0, 1), sums(0, 2), gaps(2, 1)], axis=-1),
            np.stack([sums(0, 1), y, sums(1, 2), gaps(0, 2)], axis=-1),
            np.stack([sums(0, 2), sums(1, 2), z, gaps(1, 0)], axis=-1),
            np.stack([gaps(2, 1), gaps(0, 2), gaps(1, 0), w], axis=-1),
        ],
        axis=-2,
    )
    largest = squares.argmax(axis=-1)[..., None, None]
    chosen = np.take_along_axis(rows, largest, axis=-2)[..., 0, :]
    turned: NDArray[np.float64] = chosen / np.linalg.norm(chosen, axis=-1, keepdims=True)
    return turned
