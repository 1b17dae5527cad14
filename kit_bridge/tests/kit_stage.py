"""A stage with a cube and an event camera, and Kit's stand-ins around it."""

import contextlib
import pathlib

import carb
import carb.settings
import omni.kit.app
import omni.timeline
import omni.ui
import omni.usd
from omni.replicator import core as rep
from pxr import Gf, Sdf, Usd, UsdGeom

from esaac_sim.bridge import SETTINGS, Bridge
from esaac_sim.extension import Log
from esaac_sim.schema import register

EXTENSION = pathlib.Path(__file__).parents[1] / "exts/esaac.sim"
APP = omni.kit.app.get_app()
TIMELINE = omni.timeline.get_timeline_interface()
# As the extension does when it starts: USD asks for schemas once.
register()
KINDS = {bool: Sdf.ValueTypeNames.Bool, int: Sdf.ValueTypeNames.Int, str: Sdf.ValueTypeNames.Token}


@contextlib.contextmanager
def fresh_stage():
    """A stage with a cube and a camera with motion vectors; the timeline is stopped and the self-test off."""
    rep.reset()
    TIMELINE.reset()
    omni.ui.reset()
    carb.LINES.clear()
    settings = carb.settings.get_settings()
    settings.clear()
    settings.set(SETTINGS + "self_test", False)
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.Cube.Define(stage, "/cube").AddTranslateOp().Set(Gf.Vec3d(-0.5, 0.2, 0))
    overrides = "width = 64\nheight = 48\ncontrast_on = 0.15  # more"
    camera(stage, "/camera", sensor="dvs128", mode="motion", overrides=overrides)
    omni.usd.get_context().stage = stage
    yield stage
    omni.usd.get_context().stage = None


def camera(stage, path, **attributes):
    prim = UsdGeom.Camera.Define(stage, path)
    prim.AddTranslateOp().Set(Gf.Vec3d(0, 0, 8))
    prim.CreateHorizontalApertureAttr(20.955)
    prim.CreateFocalLengthAttr(24.0)
    for name, value in attributes.items():
        kind = Sdf.ValueTypeNames.TokenArray if isinstance(value, list) else KINDS[type(value)]
        kind = Sdf.ValueTypeNames.String if name == "overrides" else kind
        prim.GetPrim().CreateAttribute(f"esaac:{name}", kind).Set(value)
    return prim.GetPrim()


def move(stage, frames, first=0, speed=0.02):
    """Plays `frames` updates in which the cube moves on."""
    TIMELINE.play()
    place = stage.GetPrimAtPath("/cube").GetAttribute("xformOp:translate")
    for index in range(first, first + frames):
        place.Set(Gf.Vec3d(-0.5 + speed * index, 0.2, 0))
        APP.update()


def bridge():
    return Bridge(carb.settings.get_settings(), Log())
