"""The self-test's scene: a cube that glows, a camera that looks at it along -z, far below the user's own."""

import omni.replicator.core as rep
from pxr import Gf, Sdf, UsdGeom, UsdShade

from . import self_test as the
from .ticks import ATTRIBUTE, EveryFrame
from .writer import EsaacEventWriter

DEPTH_M = -1000.0
"""Far below the user's scene, so that neither is seen in the other's images."""


class SelfTestScene:
    """Prims, a render product, and a writer that collects copies of its data."""

    def __init__(self, stage, with_geometry):
        self.stage, self.frames, self.twins = stage, [], None
        unit = UsdGeom.GetStageMetersPerUnit(stage) or 1.0
        self.metre = 1.0 / unit
        UsdGeom.Xform.Define(stage, the.ROOT)
        camera = UsdGeom.Camera.Define(stage, f"{the.ROOT}/camera")
        camera.CreateFocalLengthAttr(the.FOCAL_MM)
        camera.CreateHorizontalApertureAttr(the.APERTURE_MM)
        camera.CreateVerticalApertureAttr(the.APERTURE_MM * the.SIZE_PX[1] / the.SIZE_PX[0])
        camera.CreateClippingRangeAttr(Gf.Vec2f(0.01 * self.metre, 100.0 * self.metre))
        camera.AddTranslateOp().Set(self._at(0, 0, 0))
        camera.GetPrim().CreateAttribute(ATTRIBUTE, Sdf.ValueTypeNames.Float).Set(the.TICK_HZ)
        self.every_frame = EveryFrame(stage, [f"{the.ROOT}/camera"])
        cube = UsdGeom.Cube.Define(stage, the.CUBE)
        cube.CreateSizeAttr(the.CUBE_M * self.metre)
        self.place = cube.AddTranslateOp()
        self.glow = self._material(cube)
        self.move(0)
        self.product = rep.create.render_product(f"{the.ROOT}/camera", the.SIZE_PX)
        rep.WriterRegistry.register(EsaacEventWriter)
        self.writer = rep.writers.get("EsaacEventWriter")
        self.writer.initialize(sink=self._keep, with_depth=with_geometry, with_ids=with_geometry)
        self.writer.attach([self.product])

    def move(self, index):
        """Sets the cube's position and brightness for a frame."""
        t = index / the.RATE_HZ
        vx, vy = the.SPEED_M_PER_S
        self.place.Set(self._at(vx * t, vy * t, -the.DISTANCE_M))
        level = the.RADIANCE[0] if index < 2 + the.FRAMES // 2 else the.RADIANCE[1]
        self.glow.Set(level)

    def remove(self):
        self.writer.detach()
        self.product.destroy()
        self.every_frame.restore()
        self.stage.RemovePrim(the.ROOT)

    def _keep(self, data):
        if self.twins:
            self.twins.write(data)
        # The renderer's memory is valid until `write` returns, so copy what is judged later.
        self.frames.append({key: _copied(value) for key, value in data.items()})

    def _at(self, x, y, z):
        return Gf.Vec3d(x * self.metre, (y + DEPTH_M) * self.metre, z * self.metre)

    def _material(self, cube):
        material = UsdShade.Material.Define(self.stage, f"{the.ROOT}/glow")
        shader = UsdShade.Shader.Define(self.stage, f"{the.ROOT}/glow/shader")
        shader.SetSourceAsset(Sdf.AssetPath("OmniPBR.mdl"), "mdl")
        shader.SetSourceAssetSubIdentifier("OmniPBR", "mdl")
        shader.CreateInput("diffuse_color_constant", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(0, 0, 0))
        # Nothing of the stage's lights, a dome light for example, is seen on it.
        shader.CreateInput("specular_level", Sdf.ValueTypeNames.Float).Set(0.0)
        shader.CreateInput("enable_emission", Sdf.ValueTypeNames.Bool).Set(True)
        shader.CreateInput("emissive_color", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(1, 1, 1))
        glow = shader.CreateInput("emissive_intensity", Sdf.ValueTypeNames.Float)
        material.CreateSurfaceOutput("mdl").ConnectToSource(shader.ConnectableAPI(), "out")
        UsdShade.MaterialBindingAPI.Apply(cube.GetPrim()).Bind(material)
        return glow


def _copied(value):
    if isinstance(value, dict) and "data" in value:
        # Beside the image there is what its ids are.
        return {**value, "data": _copied(value["data"])}
    return value.numpy().copy() if hasattr(value, "numpy") else value
