"""Replicator: a data set of event recordings in DSEC's layout. The scene changes from one recording to the next.

    ./python.sh kit_bridge/scripts/replicator_dataset.py --out dataset/ --recordings 20

Each recording is `NNNN/events.h5` and `NNNN/sensor.toml`. A recording that is there already ends the script. With
`--event-ids` each event has the id of the prim that it shows (`events/id`), and `NNNN/ids.json` says which prim each
id is.

Tested: `--help`, and the extension on stand-ins for Kit (`kit_bridge/tests/stand_ins`). Not tested: the script as a
whole, which needs Isaac Sim.
"""

import argparse
import pathlib
import random

PARSER = argparse.ArgumentParser(description=__doc__.splitlines()[0])
PARSER.add_argument("--out", type=pathlib.Path, default=pathlib.Path("dataset"))
PARSER.add_argument("--recordings", type=int, default=20)
PARSER.add_argument("--frames", type=int, default=120)
PARSER.add_argument("--sensor", default="davis346")
PARSER.add_argument("--event-ids", action="store_true", help="record which prim each event shows")
PARSER.add_argument("--seed", type=int, default=0)
ARGUMENTS = PARSER.parse_args()

# After the arguments: `--help` does not need it.
from isaacsim import SimulationApp

APP = SimulationApp({"headless": True, "multi_gpu": False, "anti_aliasing": 0})

import omni.kit.app
import omni.timeline
from pxr import Gf, Sdf, UsdGeom, UsdLux, UsdPhysics

EXTENSIONS = pathlib.Path(__file__).resolve().parents[1] / "exts"


def shuffle(stage, draw):
    """Puts boxes of random place, size, colour and speed under random light. Returns those that move."""
    stage.RemovePrim("/scene")
    UsdLux.DomeLight.Define(stage, "/scene/light").CreateIntensityAttr(10 ** draw.uniform(2, 3.5))
    moving = []
    for index in range(draw.randint(5, 25)):
        cube = UsdGeom.Cube.Define(stage, f"/scene/box_{index}")
        cube.CreateSizeAttr(draw.uniform(0.1, 0.8))
        cube.CreateDisplayColorAttr([Gf.Vec3f(*(draw.uniform(0.05, 0.9) for _ in range(3)))])
        at = Gf.Vec3d(draw.uniform(-2, 2), draw.uniform(-1.5, 1.5), draw.uniform(-3, 0))
        speed = Gf.Vec3d(*(draw.gauss(0, 0.6) for _ in range(3)))
        moving.append((cube.AddTranslateOp(), at, speed))
    if ARGUMENTS.event_ids:
        # Labels need poses, which are recorded at each step of physics.
        UsdPhysics.Scene.Define(stage, "/scene/physics")
    camera = UsdGeom.Camera.Define(stage, "/scene/camera")
    camera.AddTranslateOp().Set(Gf.Vec3d(0, 0, 4))
    prim = camera.GetPrim()
    prim.CreateAttribute("esaac:sensor", Sdf.ValueTypeNames.Token).Set(ARGUMENTS.sensor)
    if ARGUMENTS.event_ids:
        prim.CreateAttribute("esaac:outputs", Sdf.ValueTypeNames.TokenArray).Set(["events", "event_ids"])
    overrides = f"seed = {draw.getrandbits(31)}\ncontrast_on = {draw.uniform(0.1, 0.3):.3f}"
    prim.CreateAttribute("esaac:overrides", Sdf.ValueTypeNames.String).Set(overrides)
    return moving


def main():
    manager = omni.kit.app.get_app().get_extension_manager()
    manager.add_path(str(EXTENSIONS))
    manager.set_extension_enabled_immediate("esaac.sim", True)
    from esaac_sim.sinks import Recorder
    from esaac_sim.standalone import begin

    bridge, stage = begin(APP.update)
    draw, timeline = random.Random(ARGUMENTS.seed), omni.timeline.get_timeline_interface()
    for number in range(ARGUMENTS.recordings):
        folder = ARGUMENTS.out / f"{number:04}"
        if folder.exists():
            raise SystemExit(
                f"error: {folder} is there already, expected a new folder; choose another with --out"
            )
        moving = shuffle(stage, draw)
        if not bridge.attach(stage):
            raise SystemExit("error: " + "; ".join(bridge.problems))
        (feed,) = bridge.feeds
        recorder = Recorder(folder, feed.spec, suffix=".h5")
        feed.sinks.append(recorder)
        timeline.play()
        for index in range(ARGUMENTS.frames):
            for place, at, speed in moving:
                place.Set(at + speed * (index / 60))
            APP.update()
        timeline.stop()
        # The next recording begins at time 0.
        APP.update()
        bridge.detach()
        recorder.path.rename(folder / "events.h5")
        if recorder.ids_path is not None:
            recorder.ids_path.rename(folder / "ids.json")
        (folder / "sensor.toml").write_text(feed.spec.sensor.to_toml())
        print(f"{folder}: {feed.frames} frames, {feed.events} events")


try:
    main()
finally:
    APP.close()
