"""F22: cameras of Isaac Sim 6, which draw on render products of Replicator."""

import omni.usd
from omni.replicator import core as rep
from pxr import Sdf, UsdRender


class RtxCamera:
    def __init__(self, path, *, tick_rate=0.0):
        self.paths = [path]
        prim = omni.usd.get_context().get_stage().GetPrimAtPath(path)
        prim.CreateAttribute("omni:sensor:tickRate", Sdf.ValueTypeNames.Float).Set(tick_rate)


class CameraSensor:
    def __init__(self, camera, *, resolution, annotators=(), render_vars=None):
        """`resolution` is (height, width)."""
        self.authoring_object, self.resolution = camera, resolution
        self._texture = rep.create.render_product(camera.paths[0], (resolution[1], resolution[0]))

    @property
    def render_product(self):
        return UsdRender.Product.Define(omni.usd.get_context().get_stage(), self._texture.path)
