"""Lenses, poses and their recorder: what synthesis `rigid` knows besides images.

World from camera and world from body, in metres and nanoseconds. Between the times given, positions and rotations are
interpolated smoothly. Arrays may be on the host or on a CUDA device; those on a device are copied to the host, once a
step (a few kilobytes).
"""

from collections.abc import Mapping, Sequence
from typing import Any, Literal, Union

import numpy as np
from numpy.typing import NDArray

MARGIN: int
"""Samples beyond either end of an interval that the poses within depend on."""

Array = Any
"""An array of any library, on the host or on a CUDA device."""

Projection = Literal["pinhole", "fisheye"]
"""`fisheye` is equidistant: the distance from the centre goes with the angle."""

Order = Literal["xyzw", "wxyz"]
"""Order of a quaternion's numbers in the last four of a pose.

* `xyzw`, the default: Isaac Lab 3, Newton, Warp, PhysX, ROS, SciPy.
* `wxyz`: Isaac Lab 2, Isaac Sim's own arrays, MuJoCo, Blender.
"""

Axes = Literal["usd", "opengl", "ros", "opencv", "world"]
"""Which way a camera looks in its own axes. Bodies have no such choice.

* `usd`, the default, and `opengl`: along -z, x right, y up. USD, Isaac Sim, Newton, Blender, MuJoCo.
* `ros` and `opencv`: along z, x right, y down. ROS's optical frames.
* `world`: along x, y left, z up. Isaac Lab's name for it.
"""

Table = Union[Mapping[int, Union[int, None]], Sequence[int], Array]
"""Which body an id is: a dict from ids to numbers of bodies, or an array in which entry i is the body of id i. -1 (in
a dict also None) is the static world: it has a path, and does not move. An id that is not there has no poses; its
pixels take their motion vectors, if there are any, and are counted."""

class Intrinsics:
    """A lens without distortion: focal lengths and principal point in pixels (of a fisheye: pixels a radian).

    The centre of the first pixel is at (0, 0), so that the middle of the image is at `(width - 1) / 2`. With
    `half_pixel_centres` it is at (.5, .5) and the middle at `width / 2`, as in Isaac Lab, Newton and OpenGL.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    projection: Projection
    half_pixel_centres: bool
    def __init__(
        self,
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        projection: Projection = "pinhole",
        half_pixel_centres: bool = False,
    ) -> None: ...
    @classmethod
    def from_matrix(
        cls, matrix: Array, *, projection: Projection = "pinhole", half_pixel_centres: bool = False
    ) -> Intrinsics:
        """From `[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]`."""
    @classmethod
    def of(cls, given: Union[Intrinsics, Sequence[float], None]) -> Union[Intrinsics, None]: ...
    def told(self) -> tuple[str, float, float, float, float]: ...
    def ray_lengths(self, width: int, height: int) -> NDArray[np.float32]:
        """Distance from the camera's centre of what has depth 1, for each pixel. `depth = distance / ray_lengths`
        makes the depth that is wanted of the distance that ray casters give (Newton's `depth`, Isaac Sim's
        `distance_to_camera`). 1 everywhere for a fisheye, whose depth is that distance."""

class Poses:
    """Where the camera and the bodies are at some times, which span the interval of a step: from the frame before to
    this one. Some samples beyond both ends make the paths near the ends smoother.

    * `times_ns`: `(steps,)`, ascending. One pose alone stands still at all times.
    * `camera`: `(steps, 7)`, or `(steps, cameras, 7)` for a `TiledEventCamera`: position x y z, quaternion.
    * `bodies`: `(steps, bodies, 7)`, or `(steps, environments, bodies, 7)` where each environment has its own.
    * `ids`: which body an id is, see `Table`. One table for all cameras, or a list with one for each. Without it,
      id i + 1 is body i.

    Id 0 is the static world. Where a renderer counts shapes from 0, as Newton's `shape_index` does, add 1 to the
    image and put the static world before the table: `ids=numpy.insert(shape_body, 0, -1)`.

    Numbers that are no pose raise `FrameError` when they are stepped: a quaternion whose length is not 1 within a
    thousandth, NaN, times that do not ascend or do not span the interval.
    """

    times_ns: NDArray[np.int64]
    camera: NDArray[np.float64]
    bodies: NDArray[np.float64]
    tables: list[tuple[NDArray[np.uint32], NDArray[np.int64]]]
    def __init__(
        self,
        times_ns: Array,
        camera: Array,
        bodies: Union[Array, None] = None,
        *,
        ids: Union[Table, Sequence[Table], None] = None,
        order: Order = "xyzw",
        axes: Axes = "usd",
    ) -> None: ...
    @classmethod
    def from_matrices(
        cls,
        times_ns: Array,
        camera: Array,
        bodies: Union[Array, None] = None,
        *,
        ids: Union[Table, Sequence[Table], None] = None,
        axes: Axes = "opengl",
    ) -> Poses:
        """From matrices, world from camera and world from body: `(steps, 4, 4)` or `(steps, 3, 4)`, with one axis
        more for several cameras or bodies. A matrix with a scale or a mirror raises `FrameError`.

        A renderer that wants the view matrix, camera from world, has the inverse: give `numpy.linalg.inv(view)`, and
        `axes="opencv"` if it looks along z, as gsplat and COLMAP do."""
    def __len__(self) -> int: ...

class PoseRecorder:
    """Keeps the poses of physics steps until the frames that need them have been stepped.

    Call `record` after each physics step and give the recorder to `step` as `poses`: it takes what spans the interval
    and forgets what is older. Each camera, or `TiledEventCamera`, has a recorder of its own. It keeps at most `limit`
    samples; the oldest go first.

    Arrays are copied where they are, since a simulator writes to them again. Those on a CUDA device are brought to
    the host when `step` asks for them.

    A frame's time that is at most `tolerance_ns` before the first or after the last sample counts as that sample's
    own: clocks of floats are a few nanoseconds off.
    """

    ids: Union[Table, Sequence[Table], None]
    """May be set anew between two steps."""
    order: Order
    axes: Axes
    tolerance_ns: int
    def __init__(
        self,
        *,
        ids: Union[Table, Sequence[Table], None] = None,
        order: Order = "xyzw",
        axes: Axes = "usd",
        limit: int = 1024,
        tolerance_ns: int = 1000,
    ) -> None: ...
    def __len__(self) -> int: ...
    def record(self, t_ns: int, camera: Array, bodies: Union[Array, None] = None) -> None:
        """Poses at a time: camera `(7,)` or `(cameras, 7)`, bodies `(bodies, 7)` or `(environments, bodies, 7)`.

        Bodies may become more: the first keep their numbers, and new ones count as still until their first sample."""
    def spanning(self, from_ns: int, to_ns: int) -> Poses:
        """The samples of an interval, and two beyond each end where there are any. `step` calls it."""
    def forget_before(self, t_ns: int) -> None:
        """Drops what no interval that begins at `t_ns` or later needs. `step` calls it."""
    def forget_from(self, t_ns: int) -> None:
        """Drops the samples at `t_ns` and later. Call it to record one anew."""
    def clear(self) -> None:
        """Drops everything. Call it when time is set back."""
