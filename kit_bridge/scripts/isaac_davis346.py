"""Isaac Sim, standalone: a DAVIS346 on a moving camera. Its events are recorded and published.

    ./python.sh kit_bridge/scripts/isaac_davis346.py --seconds 5 --record out/

It ends with an error if the camera cannot be attached or the recording cannot be written.

Tested: `--help`, and the extension on stand-ins for Kit (`kit_bridge/tests/stand_ins`). Not tested: the script as a
whole, which needs Isaac Sim.
"""

import argparse
import math
import pathlib

PARSER = argparse.ArgumentParser(description=__doc__.splitlines()[0])
PARSER.add_argument("--seconds", type=float, default=5.0)
PARSER.add_argument("--record", default="out", help="folder for recordings; files that are there stay")
PARSER.add_argument("--event-ids", action="store_true", help="record which prim each event shows")
PARSER.add_argument("--no-ros", action="store_true", help="do not publish to ROS 2")
ARGUMENTS = PARSER.parse_args()

# After the arguments: `--help` does not need it.
from isaacsim import SimulationApp

APP = SimulationApp({"headless": True, "multi_gpu": False, "anti_aliasing": 0})

# Kit's modules are there once the application is.
import omni.kit.app
import omni.timeline
from pxr import Gf, Sdf, UsdGeom, UsdLux, UsdPhysics

EXTENSIONS = pathlib.Path(__file__).resolve().parents[1] / "exts"


def build(stage):
    """A floor of boxes, a light, and a camera that is an event camera; returns its translation."""
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdLux.DomeLight.Define(stage, "/light").CreateIntensityAttr(800.0)
    for i in range(-6, 7):
        for j in range(-6, 7):
            cube = UsdGeom.Cube.Define(stage, f"/floor/box_{i + 6}_{j + 6}")
            cube.CreateSizeAttr(0.4)
            cube.AddTranslateOp().Set(Gf.Vec3d(0.5 * i, 0.5 * j, 0.1 * ((3 * i + 5 * j) % 4)))
            shade = 0.1 + 0.2 * ((i * i + 2 * j * j) % 5)
            cube.CreateDisplayColorAttr([Gf.Vec3f(shade, shade * 0.8, 1 - shade)])
    if ARGUMENTS.event_ids:
        # Labels need poses, which are recorded at each step of physics.
        UsdPhysics.Scene.Define(stage, "/physics")
    camera = UsdGeom.Camera.Define(stage, "/World/davis")
    camera.CreateFocalLengthAttr(18.0)
    camera.CreateHorizontalApertureAttr(20.955)
    place = camera.AddTranslateOp()
    prim = camera.GetPrim()
    labels = ["event_ids"] if ARGUMENTS.event_ids else []
    for name, kind, value in (
        ("sensor", Sdf.ValueTypeNames.Token, "davis346"),
        ("profile", Sdf.ValueTypeNames.Token, "noisy"),
        ("outputs", Sdf.ValueTypeNames.TokenArray, ["events", "aps", "rgb", "depth", *labels]),
        ("publish", Sdf.ValueTypeNames.Bool, not ARGUMENTS.no_ros),
        ("topic", Sdf.ValueTypeNames.String, "/davis"),
    ):
        prim.CreateAttribute(f"esaac:{name}", kind).Set(value)
    return place


def main():
    manager = omni.kit.app.get_app().get_extension_manager()
    manager.add_path(str(EXTENSIONS))
    manager.set_extension_enabled_immediate("esaac.sim", True)
    from esaac_sim.sinks import Recorder
    from esaac_sim.standalone import begin

    bridge, stage = begin(APP.update, record=ARGUMENTS.record)
    place = build(stage)
    attached = bridge.attach(stage)
    for problem in bridge.problems:
        print("problem:", problem)
    if not attached:
        raise SystemExit("error: no camera is attached, so there is nothing to record")
    timeline = omni.timeline.get_timeline_interface()
    timeline.play()
    for index in range(int(60 * ARGUMENTS.seconds)):
        t = index / 60
        place.Set(Gf.Vec3d(1.2 * math.sin(0.9 * t), 0.6 * math.sin(1.7 * t), 4.0))
        APP.update()
    for feed in bridge.feeds:
        print(f"{feed.spec.path}: {feed.frames} frames, {feed.events} events, {feed.message}")
    timeline.stop()
    recorders = [sink for feed in bridge.feeds for sink in feed.sinks if isinstance(sink, Recorder)]
    bridge.detach()
    for recorder in recorders:
        print(f"recorded: {recorder.path}")


try:
    main()
finally:
    APP.close()
