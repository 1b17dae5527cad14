"""Render products, annotators and writers, over a renderer of cubes.

The renderer draws the front of every cube of the stage, as it stands before cameras that look along -z and are only
moved; what light a cube gives is its bound material's `emissive_intensity`, else .8. That is enough to check what a
writer makes of frames, and no more.
"""

import types

import numpy as np
import warp as wp
from pxr import UsdGeom, UsdShade

import omni.physx
import omni.timeline
import omni.usd

wp.config.quiet = True

DEVICE = "cuda:0" if wp.is_cuda_available() else "cpu"
BACKGROUND = 0.05
RATE_HZ = 60.0

NO_FAULTS = {
    "empty_frames": 2,
    "negate_motion": False,
    "gamma": False,
    "stopped_clock": False,
    "repeat": False,
    "suffix": True,
    "motion_channels": 4,
    "keeps_rate": False,
    "inverse_depth": False,
    "holes": False,
    "one_id": False,
    "no_labels": False,
}
faults = types.SimpleNamespace(**NO_FAULTS)
"""What the renderer gets wrong; tests set it."""

_PRODUCTS = []
_WRITERS = {}
_FRAME = 0


class RenderProduct:
    def __init__(self, camera, resolution):
        self.camera, self.resolution = camera, resolution
        self.path = f"/Render/RenderProduct_{len(_PRODUCTS)}"
        self.writers, self.drawn, self.before, self.hdr = [], 0, {}, None
        self.tick = self.images = None
        _PRODUCTS.append(self)

    def destroy(self):
        _PRODUCTS.remove(self)


class create:
    @staticmethod
    def render_product(camera, resolution):
        return RenderProduct(camera, resolution)


class AnnotatorRegistry:
    @staticmethod
    def get_annotator(name, device="cpu", do_array_copy=True, init_params=None):
        """F2: an annotator that a writer lists."""
        return types.SimpleNamespace(
            name=name, device=device, do_array_copy=do_array_copy, init_params=init_params
        )


class orchestrator:
    """F1: writers are called while the timeline plays, unless that is switched off."""

    capture_on_play = True

    @classmethod
    def set_capture_on_play(cls, on):
        cls.capture_on_play = on


class Writer:
    """F1: subclasses list annotators in `__init__` and have `write`."""

    def attach(self, products):
        by_path = {product.path: product for product in _PRODUCTS}
        self.products = [by_path.get(product, product) for product in products]
        for product in self.products:
            product.writers.append(self)

    def detach(self):
        for product in self.products:
            product.writers.remove(self)


class WriterRegistry:
    @staticmethod
    def register(kind):
        _WRITERS[kind.__name__] = kind


class _Blank:
    """A writer before `initialize`, which makes a new one of its registered kind."""

    def __init__(self, kind):
        self._kind, self._made = kind, None

    def initialize(self, **parameters):
        self._made = self._kind(**parameters)

    def __getattr__(self, name):
        return getattr(self._made, name)


class writers:
    @staticmethod
    def get(name):
        return _Blank(_WRITERS[name])


def reset():
    """As new, with all faults gone."""
    global _FRAME
    _FRAME = 0
    _PRODUCTS.clear()
    orchestrator.capture_on_play = True
    omni.physx.reset()
    faults.__dict__.update(NO_FAULTS)


def draw():
    """One frame of every render product, handed to its writers while the timeline plays (F1)."""
    global _FRAME
    timeline = omni.timeline.get_timeline_interface()
    if timeline.is_stopped():
        _FRAME = 0  # F5: writers ask for a time that begins anew.
    if not timeline.is_playing() or not orchestrator.capture_on_play:
        return
    omni.physx.step_to(_FRAME, RATE_HZ)
    stage = omni.usd.get_context().get_stage()
    for product in list(_PRODUCTS):
        for _ in range(2 if faults.repeat else 1):  # F6
            data = _data(product, stage, _FRAME)
            for writer in list(product.writers):
                listed = {a.name for a in writer.annotators}
                writer.write({key: value for key, value in data.items() if key.split("-")[0] in listed})
            for value in data.values():  # F7
                if isinstance(value, wp.array) and value.size:
                    value.fill_(7)
        product.drawn += 1
    _FRAME += 1


def _data(product, stage, frame):
    rate_hz = _rate_hz(stage, product.camera)
    tick = int(frame * rate_hz / RATE_HZ + 1e-6)
    # F21: between two ticks there is the last image.
    if product.images is None or tick != product.tick:
        product.tick, product.images = tick, _drawn(product, stage)
    hdr, motion, depth, rgb, ids, labels = product.images
    product.hdr = hdr
    suffix = f"-{product.path.rsplit('/', 1)[1]}" if faults.suffix else ""  # F1
    seconds = 0.0 if faults.stopped_clock else frame / RATE_HZ  # F5
    if faults.inverse_depth:
        depth = 1 / depth
    if faults.holes:
        depth = np.where(np.indices(depth.shape)[-1] % 8 == 0, np.float32(np.nan), depth)
    if faults.one_id:
        ids = np.full_like(ids, max(map(int, labels)))
    segmentation = {} if faults.no_labels else {"info": {"idToLabels": labels}}
    of = lambda array: wp.array(np.squeeze(array), device=DEVICE)  # F2
    vectors = of(motion)
    if motion.size and faults.motion_channels == 2:
        vectors = vectors[:, :, :2]
    return {
        f"HdrColor{suffix}": of(hdr),
        f"motion_vectors{suffix}": vectors,
        f"distance_to_image_plane{suffix}": of(depth),
        f"rgb{suffix}": of(rgb),
        f"instance_id_segmentation{suffix}": {"data": of(ids), **segmentation},  # F14
        f"IsaacReadSimulationTime{suffix}": {"simulationTime": seconds},
    }


def _rate_hz(stage, camera):
    """F21. A renderer that keeps its rate does not look at the session's layer."""
    if faults.keeps_rate:
        own = stage.GetRootLayer().GetAttributeAtPath(f"{camera}.omni:sensor:tickRate")
        return own.default if own and own.default else RATE_HZ
    return stage.GetPrimAtPath(camera).GetAttribute("omni:sensor:tickRate").Get() or RATE_HZ


def _drawn(product, stage):
    """Colour, motion, depth, bytes, ids and their labels."""
    width, height = product.resolution
    hdr = np.full((height, width, 4), BACKGROUND, np.float16)
    motion = np.zeros((height, width, 4), np.float32)
    depth = np.full((height, width), np.inf, np.float32)
    rgb = np.full((height, width, 4), 255, np.uint8)
    ids = np.zeros((height, width), np.uint32)
    labels = {"0": "BACKGROUND"}
    first = product.drawn == 0
    for cube, (x0, x1, y0, y1, z, centre) in _cubes(stage, product.camera, width, height):
        ys, xs = slice(max(y0, 0), max(min(y1, height), 0)), slice(max(x0, 0), max(min(x1, width), 0))
        light = _light(stage, cube)
        hdr[ys, xs] = np.sqrt(light) if faults.gamma else light
        depth[ys, xs] = z
        if rgb[ys, xs].size:  # F14
            ids[ys, xs] = len(labels) + 6
            labels[str(len(labels) + 6)] = cube
        rgb[ys, xs, :3] = (200, 100, 50)
        before = product.before.get(cube, centre)
        moved = (before[0] - centre[0], before[1] - centre[1])  # F3
        if first:
            moved = (99.0, -99.0)  # F4
        motion[ys, xs, :2] = np.negative(moved) if faults.negate_motion else moved
        product.before[cube] = centre
    if product.drawn < faults.empty_frames:  # F4
        hdr, motion, depth, rgb, ids = (
            np.empty((0,), dtype) for dtype in (np.float16, np.float32, np.float32, np.uint8, np.uint32)
        )
    return hdr, motion, depth, rgb, ids, labels


def _cubes(stage, camera_path, width, height):
    camera = UsdGeom.Camera(stage.GetPrimAtPath(camera_path))
    eye = np.array(UsdGeom.Xformable(camera).ComputeLocalToWorldTransform(0).ExtractTranslation())
    focal = camera.GetFocalLengthAttr().Get() / camera.GetHorizontalApertureAttr().Get() * width
    for prim in stage.Traverse():
        if not prim.IsA(UsdGeom.Cube):
            continue
        cube = UsdGeom.Cube(prim)
        half = cube.GetSizeAttr().Get() / 2
        place = omni.physx.place(str(prim.GetPath()))
        if place is None:
            place = np.array(UsdGeom.Xformable(cube).ComputeLocalToWorldTransform(0).ExtractTranslation())
        at = place - eye
        front = -at[2] - half
        if front <= 0.1:
            continue
        u = width / 2 + focal * at[0] / front
        v = height / 2 - focal * at[1] / front
        reach = focal * half / front
        edges = [round(u - reach), round(u + reach), round(v - reach), round(v + reach)]
        yield str(prim.GetPath()), (*edges, front, (u, v))


def _light(stage, path):
    material, _ = UsdShade.MaterialBindingAPI(stage.GetPrimAtPath(path)).ComputeBoundMaterial()
    if material:
        shader = UsdShade.Shader(stage.GetPrimAtPath(f"{material.GetPath()}/shader"))
        return shader.GetInput("emissive_intensity").Get()
    return 0.8
