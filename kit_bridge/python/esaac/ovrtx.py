"""An event camera for ovrtx, NVIDIA's RTX renderer as a library.

ovrtx and Warp are imported with this module, and not with `esaac`. It has run with a stand-in for ovrtx, and not with
ovrtx itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
import ovrtx
import warp as wp

import esaac
from esaac.attributes import KnownAttributes
from esaac.errors import ArgumentError, FrameError
from esaac.poses import PoseRecorder

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from esaac import Intrinsics, Packet, Poses, SensorModel

COLOUR, MOTION, DEPTH, IDS = (
    "HdrColor",
    "TargetMotionSD",
    "DistanceToImagePlaneSD",
    "NonStableInstanceSegmentation",
)
"""Render variables by their `sourceName`. Colour must be there. Depth and ids are read where poses are given."""


class EventCamera(KnownAttributes):
    """An event camera of an ovrtx render product.

        camera = EventCamera("/Render/Camera", "davis346")
        products = renderer.step(render_products={"/Render/Camera"}, delta_time=1 / 60)
        packet = camera.step(products, t_ns=simulation_time_ns)

    Time is the simulation's own: ovrtx's clock goes by the `delta_time` of its steps, whatever the simulation does.
    Images are read on the GPU where they lie. `events` is the `esaac.EventCamera`, with `event_frame()`,
    `voxel_grid()` and `statistics`.
    """

    events: esaac.EventCamera

    _OWN = ("events",)
    _CHANGE = "camera.events.sensor = camera.events.sensor.replace({name}=...)"

    def __init__(
        self,
        product: str,
        sensor: SensorModel | str | None = None,
        *,
        intrinsics: Intrinsics | Sequence[float] | None = None,
        variables: Mapping[str, str] | None = None,
        on_gpu: bool = True,
        check_every: int = 100,
        **options: Any,
    ) -> None:
        """
        * `product`: path of the render product. Its image has the sensor's size.
        * `sensor`: a preset or an `esaac.SensorModel`. `options` are more arguments of `esaac.EventCamera`:
          parameters of the sensor (`width=64, contrast_on=0.2`), `profile`, `packets`, `device`.
        * `intrinsics`: the lens, which depth needs.
        * `variables`: paths of render variables by their `sourceName`. Without it, they are those whose path ends in
          that name.
        * `on_gpu`: False copies images to the host first.
        * `check_every`: at every so many frames, whether the renderer has stopped drawing is checked, which copies
          two images to the host; 0 is never.

        Wrong values raise `esaac.ArgumentError`, those of the sensor `esaac.SensorError`.
        """
        unknown = sorted(set(variables or {}) - {COLOUR, MOTION, DEPTH, IDS})
        if unknown:
            expected = ", ".join((COLOUR, MOTION, DEPTH, IDS))
            raise ArgumentError(f"variables has `{unknown[0]}`, expected {expected}")
        self._product, self._variables = product, dict(variables or {})
        self._device = ovrtx.Device.CUDA if on_gpu else ovrtx.Device.CPU
        self.events = esaac.EventCamera(sensor, intrinsics=intrinsics, **options)
        self._frozen = _Frozen(check_every)
        self._last_ns: int | None = None

    def step(self, products: Any, t_ns: int, poses: Poses | PoseRecorder | None = None) -> Packet:
        """The events since the last frame; none for the first.

        * `products`: what `renderer.step` returned, or what was fetched of `step_async`.
        * `t_ns`: the simulation's time of this frame.
        * `poses`: for synthesis `rigid`; they must span the interval.

        Raises `esaac.FrameError` for images that are missing or do not fit, and if the renderer hands out one image
        again and again while something moves."""
        drawn = self._drawn(products)
        names = {"hdr": COLOUR, "motion": MOTION}
        if poses is not None:
            names |= {"depth": DEPTH, "ids": IDS}
        found = {argument: self._find(drawn, name) for argument, name in names.items()}
        if found["hdr"] is None:
            raise FrameError(
                f"{self._product} has the render variables {sorted(drawn)}, expected {COLOUR}; if its prim has "
                "another name, tell it by variables="
            )
        if poses is not None and found["depth"] is None:
            raise FrameError(f"{self._product} has no {DEPTH}, which poses need, among {sorted(drawn)}")
        self._frozen.check(found["hdr"], found["motion"], self._has_turned(poses, t_ns))
        given = {argument: variable for argument, variable in found.items() if variable is not None}
        mapped = {argument: self._map(variable) for argument, variable in given.items()}
        try:
            images = {argument: _image(mapping, argument) for argument, mapping in mapped.items()}
            packet = self.events.step(images.pop("hdr"), t_ns=t_ns, poses=poses, **images)
        finally:
            # The engine has read them.
            for mapping in mapped.values():
                mapping.unmap()
        self._last_ns = t_ns
        return packet

    def reset(self) -> None:
        """Begins anew: the next frame is the first."""
        self.events.reset()
        self._last_ns = None

    def close(self) -> None:
        """Frees the memory of the event camera."""
        self.events.close()

    def __enter__(self) -> EventCamera:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _drawn(self, products: Any) -> Mapping[str, Any]:
        if self._product not in products:
            raise FrameError(f"no render product {self._product} among {sorted(products.keys())}")
        frames = products[self._product].frames
        if len(frames) == 0:
            raise FrameError(f"{self._product} has no frame, expected one; the renderer may still be loading")
        variables: Mapping[str, Any] = frames[0].render_vars
        return variables

    def _find(self, drawn: Mapping[str, Any], name: str) -> Any:
        if name in self._variables:
            return drawn.get(self._variables[name])
        # Keys are names of sources up to ovrtx 0.4, and paths of prims from 0.5 on.
        return next((drawn[key] for key in drawn if key.rsplit("/", 1)[-1] == name), None)

    def _map(self, variable: Any) -> Any:
        if self._device == ovrtx.Device.CPU:
            return variable.map(device=self._device)
        # `__dlpack__` of ovrtx ignores the stream that it is given, so no stream waits for the renderer: we do.
        mapping = variable.map(device=self._device, sync_stream=0)
        mapping.wait()
        return mapping

    def _has_turned(self, poses: Poses | PoseRecorder | None, t_ns: int) -> bool:
        """Whether the poses say that the camera has moved since the last frame."""
        if poses is None or self._last_ns is None:
            return False
        spanning = poses.spanning(self._last_ns, t_ns) if isinstance(poses, PoseRecorder) else poses
        moved = np.ptp(spanning.camera, axis=0)
        return bool(moved.max() > 1e-4)


class _Frozen:
    """Notices a renderer that hands out one image again and again."""

    def __init__(self, every: int) -> None:
        if every < 0:
            raise ArgumentError(f"check_every is {every}, expected 0 or more")
        self._every, self._count = every, 0
        self._image: NDArray[Any] | None = None

    def check(self, colour: Any, motion: Any, turned: bool) -> None:
        """At the last frame of `every`, and the one before it."""
        self._count += 1
        if self._every == 0 or self._count % self._every not in (0, self._every - 1):
            return
        image, before = _on_host(colour), self._image
        last = self._count % self._every == 0
        self._image = None if last and self._every > 1 else image
        if not last or before is None or not np.array_equal(image, before):
            return
        if turned or (motion is not None and np.abs(_on_host(motion)[..., :2]).max() > 0.1):
            raise FrameError(
                "the renderer hands out the same image while something moves, expected another one; set "
                "`bool omni:rtx:rt:ecoMode:enabled = false` on the render product, or it stops after 500 frames"
            )


def _on_host(variable: Any) -> NDArray[Any]:
    mapping = variable.map(device=ovrtx.Device.CPU)
    copy = np.array(np.from_dlpack(mapping))
    mapping.unmap()
    return copy


def _image(mapping: Any, argument: str) -> Any:
    image = wp.from_dlpack(mapping)
    # Some versions hand out the bits of depth as integers.
    return image.view(wp.float32) if argument == "depth" and image.dtype == wp.uint32 else image
