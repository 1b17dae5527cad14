"""Labels of events in the extension `esaac.sim`: which prim each event shows, and the table that says so."""

import json
import sys

import carb.settings
import h5py
import numpy as np
import omni.physx
import pytest
import warp as wp
from kit_stage import APP, TIMELINE, bridge, camera, fresh_stage
from omni.replicator import core as rep
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, UsdSemantics, UsdShade

import esaac
from esaac_sim import sinks
from esaac_sim.bridge import SETTINGS
from esaac_sim.closing import CloseError
from esaac_sim.instances import Instances
from esaac_sim.renumber import renumbered
from esaac_sim.schema import SchemaError, spec_of
from esaac_sim.semantics import semantics_of

OVERRIDES = "width = 64\nheight = 48\ncontrast_on = 0.15"
FOCAL_PX = 24.0 / 20.955 * 64
FRONT_M = 7.5
"""From the camera to the cubes' fronts."""
MARGIN_PX = 1.5
"""The renderer draws whole pixels."""


def swings(x, y, hz=4.0):
    """The way of a body around a place: position, and rotation x y z w."""
    return lambda t: ((x + 0.5 * np.sin(2 * np.pi * hz * t), y, 0.0), (0.0, 0.0, 0.0, 1.0))


def leaves(t):
    """The way of a body that is out of sight after some frames."""
    return (-0.5 + 20 * t, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0)


WAYS = {"/cube": swings(-0.5, 1.0), "/box": swings(0.4, -1.0)}


def body(stage, path, way):
    UsdGeom.Cube.Define(stage, path).CreateSizeAttr(1.0)
    UsdPhysics.RigidBodyAPI.Apply(stage.GetPrimAtPath(path))
    omni.physx.bodies[path] = way


@pytest.fixture
def stage(tmp_path):
    """Two bodies, one above the other, and a camera that wants labels; recordings go to `tmp_path`."""
    with fresh_stage() as stage:
        prim = stage.GetPrimAtPath("/camera")
        prim.GetAttribute("esaac:mode").Set("auto")
        prim.CreateAttribute("esaac:outputs", Sdf.ValueTypeNames.TokenArray).Set(["events", "event_ids"])
        for path, way in WAYS.items():
            body(stage, path, way)
        carb.settings.get_settings().set(SETTINGS + "record", str(tmp_path))
        yield stage


def play(frames):
    TIMELINE.play()
    for _ in range(frames):
        APP.update()


def recorded(path):
    """Columns of a recording, and its table: from ids to paths of prims."""
    with np.load(path) as file:
        columns = {name: file[name] for name in ("x", "y", "t", "id")}
    table = json.loads(path.with_suffix(".ids.json").read_text())
    assert table["camera"] == "/camera"
    return columns, {int(number): told["prim"] for number, told in table["instances"].items()}


def reach(way, columns):
    """How far inside of a body's image events are at their own times; negative outside, pixels."""
    place = np.array([way(t)[0] for t in columns["t"] * 1e-9])
    across = abs(columns["x"] + 0.5 - 32 - FOCAL_PX * place[:, 0] / FRONT_M)
    down = abs(columns["y"] + 0.5 - 24 + FOCAL_PX * place[:, 1] / FRONT_M)
    return FOCAL_PX * 0.5 / FRONT_M - np.maximum(across, down)


def assert_labelled(columns, prims, ways):
    """Each label is that of the body that the event's pixel shows at the event's time."""
    numbers = {prim: number for number, prim in prims.items()}
    for prim, way in ways.items():
        inside, its = reach(way, columns), columns["id"] == numbers[prim]
        assert its.sum() > 50 and (inside[its] > -MARGIN_PX).all(), (prim, inside[its].min())
        assert its[inside > MARGIN_PX].all()
    assert set(columns["id"]) <= {0, *prims}


def test_each_event_is_labelled_with_the_prim_that_it_shows(stage, tmp_path):
    UsdSemantics.LabelsAPI.Apply(stage.GetPrimAtPath("/cube"), "class").CreateLabelsAttr(["toy", "cube"])
    running = bridge()
    assert running.attach(stage) == 1 and not running.problems
    play(16)
    (feed,) = running.feeds
    assert feed.frames == 14 and not feed.faults, feed.message
    assert feed.camera.synthesis == "rigid" and len(feed.forms["event_ids"]) == len(feed.packet)
    assert feed.instances == {
        7: {"prim": "/cube", "semantics": {"class": ["toy", "cube"]}},
        8: {"prim": "/box", "semantics": {}},
    }
    events, instances = feed.events, feed.instances
    running.detach()
    columns, prims = recorded(tmp_path / "camera.npz")
    assert columns["id"].dtype == np.int64 and len(columns["id"]) == events
    assert_labelled(columns, prims, WAYS)
    told = json.loads((tmp_path / "camera.ids.json").read_text())["instances"]
    assert told == {str(number): each for number, each in instances.items()}
    assert {path.name for path in tmp_path.iterdir()} == {"camera.npz", "camera.ids.json"}


def test_a_prim_keeps_its_id_when_kit_gives_it_another(stage, tmp_path):
    ways = {"/cube": leaves, "/box": WAYS["/box"]}
    omni.physx.bodies["/cube"] = leaves
    running = bridge()
    running.attach(stage)
    play(3)
    (feed,) = running.feeds
    kits, lost = [], 0
    write = feed.write

    def watched(data):
        (entry,) = (value for key, value in data.items() if key.startswith("instance_id"))
        kits.append({path: number for number, path in entry["info"]["idToLabels"].items()})
        write(data)

    running._attached[0][1]._made.sink = watched
    for _ in range(17):
        APP.update()
        lost += feed.camera.statistics["without_poses"]
    # Kit's number of the box was free for it when the cube had left.
    assert kits[0]["/box"] == "8" and kits[-1] == {"BACKGROUND": "0", "/box": "7"}
    assert feed.frames == 18 and not feed.faults and lost == 0, feed.message
    assert {number: each["prim"] for number, each in feed.instances.items()} == {7: "/cube", 8: "/box"}
    running.detach()
    assert_labelled(*recorded(tmp_path / "camera.npz"), ways)


def test_cameras_of_a_stage_have_the_same_ids(stage):
    options = {"sensor": "dvs128", "mode": "rigid", "overrides": OVERRIDES}
    outputs = ["events", "event_ids", "voxel_grid"]
    second = camera(stage, "/second", packets="host", outputs=outputs, **options)
    # It sees the box alone, which Kit counts from 7 on as well.
    second.GetAttribute("xformOp:translate").Set(Gf.Vec3d(0.4, -3.0, 8))
    running = bridge()
    assert running.attach(stage) == 2
    play(8)
    first, second = running.feeds
    assert {number: each["prim"] for number, each in first.instances.items()} == {7: "/cube", 8: "/box"}
    assert {number: each["prim"] for number, each in second.instances.items()} == {8: "/box"}
    assert set(second.forms) == {"event_ids", "voxel_grid"} and 8 in second.forms["event_ids"]
    running.detach()


def test_files_that_follow_have_ids_and_a_table_of_their_own(stage, tmp_path):
    running = bridge()
    running.attach(stage)
    (feed,) = running.feeds
    play(10)
    feed.change(contrast_on=0.2)
    play(6)
    rep._FRAME = 0
    play(10)
    # The first frame after the rewind is at time 0, before the first physics step.
    assert feed.gaps == 1 and feed.faults == 1, feed.message
    running.detach()
    for name in ("camera", "camera_2", "camera_3"):
        columns, prims = recorded(tmp_path / f"{name}.npz")
        assert prims == {7: "/cube", 8: "/box"} and len(columns["id"]) > 100
        assert_labelled(columns, prims, WAYS)


def glow(stage, path):
    """What sets the light that a prim gives."""
    material = UsdShade.Material.Define(stage, "/glow")
    light = UsdShade.Shader.Define(stage, "/glow/shader").CreateInput(
        "emissive_intensity", Sdf.ValueTypeNames.Float
    )
    UsdShade.MaterialBindingAPI.Apply(stage.GetPrimAtPath(path)).Bind(material)
    return light.Set


def test_static_prims_have_labels_and_what_has_no_poses_yet_has_none(stage):
    # A wall that becomes brighter from frame to frame.
    wall = UsdGeom.Cube.Define(stage, "/wall")
    wall.CreateSizeAttr(2.0)
    place, light = wall.AddTranslateOp(), glow(stage, "/wall")
    place.Set(Gf.Vec3d(2, 0, -1))
    running = bridge()
    running.attach(stage)
    (feed,) = running.feeds
    labels = []
    for frame in range(10):
        light(0.1 * 1.3**frame)
        if frame > 5:
            # A script begins to move it, which nobody could know before.
            place.Set(Gf.Vec3d(2 + 0.01 * frame, 0, -1))
        play(1)
        labels.append(set(feed.forms.get("event_ids", ())) - {0, 7, 8})
    (number,) = (number for number, each in feed.instances.items() if each["prim"] == "/wall")
    assert labels[3:] == [{number}] * 3 + [{-1}] + [{number}] * 3 and not feed.faults, feed.message
    running.detach()


def test_hdf5_keeps_them_and_formats_without_a_place_are_refused(stage, tmp_path):
    carb.settings.get_settings().set(SETTINGS + "record", "")
    running = bridge()
    running.attach(stage)
    (feed,) = running.feeds
    recorder = sinks.Recorder(tmp_path, feed.spec, suffix=".h5")
    feed.sinks.append(recorder)
    with pytest.raises(
        esaac.ArgumentError, match="/camera.esaac:outputs has `event_ids`, .* as .raw has no place"
    ):
        sinks.Recorder(tmp_path, feed.spec, suffix=".raw")
    play(8)
    running.detach()
    with h5py.File(tmp_path / "camera.h5") as file:
        assert {7, 8} <= set(file["events/id"][:])
    assert recorder.ids_path == tmp_path / "camera.ids.json" and recorder.ids_path.exists()
    # Without labels there is no table.
    plain = spec_of(camera(stage, "/plain", sensor="dvs128"))
    assert sinks.Recorder(tmp_path, plain, suffix=".raw").ids_path is None


def test_a_table_that_is_there_stays_and_one_that_fails_loses_no_event(stage, tmp_path):
    (tmp_path / "camera.ids.json").write_text("another's")
    running = bridge()
    running.attach(stage)
    play(8)
    (feed,) = running.feeds
    assert feed.sinks[0].path == tmp_path / "camera_2.npz"
    # The folder of the table's partial file is taken by a folder of that name.
    (tmp_path / ".camera_2.ids.json.partial").mkdir()
    with pytest.raises(CloseError, match="partial"):
        running.detach()
    assert not list(tmp_path.glob("*.npz")) and len(running.unsaved[0]) == feed.events
    (tmp_path / ".camera_2.ids.json.partial").rmdir()
    assert running.save_unsaved() == 0
    assert (tmp_path / "camera.ids.json").read_text() == "another's"
    (path,) = tmp_path.glob("*.npz")
    assert_labelled(*recorded(path), WAYS)


def test_what_labels_need_is_told_with_the_setting(stage, monkeypatch):
    prim = stage.GetPrimAtPath("/camera")
    for mode in ("motion", "linear", "none"):
        prim.GetAttribute("esaac:mode").Set(mode)
        message = f"/camera.esaac:outputs has `event_ids`, which needs mode `rigid` or `auto`, .* is `{mode}`"
        with pytest.raises(SchemaError, match=message):
            spec_of(prim)
    prim.GetAttribute("esaac:mode").Set("auto")
    running = bridge()
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "omni.physx", None)
        assert running.attach(stage) == 0
        why = "poses need omni.physx, which is not enabled; `event_ids` of esaac:outputs needs poses"
        assert running.problems == [f"/camera: {why}"]
        running.detach()
    # Physics does not step, so `auto` would go on without poses.
    with monkeypatch.context() as patch:
        patch.setattr(omni.physx, "step_to", lambda *_: None)
        assert running.attach(stage) == 1
        play(20)
        (feed,) = running.feeds
        assert feed.frames == 0 and feed.message.endswith("`event_ids` of esaac:outputs needs them")
        running.detach()
    UsdGeom.Camera(prim).GetHorizontalApertureAttr().Set(0.0)
    with pytest.raises(SchemaError, match="no horizontal aperture, which `event_ids` of esaac:outputs needs"):
        spec_of(prim)


def test_ids_that_mean_another_prim_are_given_anew():
    stage = Usd.Stage.CreateInMemory()
    instances, image = Instances(stage), np.array([[0, 7], [70_000, 8]], np.uint32)
    first = {"0": "BACKGROUND", "7": "/a", "8": "/b", "70000": "/c"}
    ids, labels = instances.settle(image, first)
    assert ids is image and labels == {0: "BACKGROUND", 7: "/a", 8: "/b", 70_000: "/c"}
    # Two have changed places, and one is new under a number that is another's.
    ids, labels = instances.settle(image, {"0": "BACKGROUND", "7": "/b", "8": "/a", "70000": "/d"})
    assert labels == {0: "BACKGROUND", 8: "/b", 7: "/a", 1: "/d"}
    assert ids.numpy().tolist() == [[0, 8], [1, 7]]
    # What is no prim is told as such; the background stays 0.
    ids, labels = instances.settle(image, {"0": "BACKGROUND", "7": "UNLABELLED"})
    assert labels == {0: "BACKGROUND", 2: "UNLABELLED"} and ids.numpy()[0].tolist() == [0, 2]
    assert instances.described(2) is None and instances.described(0) is None
    assert instances.described(1) == {"prim": "/d", "semantics": {}}


@pytest.mark.parametrize("dtype", [np.uint16, np.int32, np.uint32])
def test_images_of_any_integers_are_renumbered(dtype):
    image = np.arange(12, dtype=dtype).reshape(3, 4)
    expected = image.astype(np.uint32)
    expected[0, 3], expected[2, 3] = 4_000_000_000, 3
    for given in (image, wp.array(image, device="cpu"), np.asfortranarray(image)):
        actual = renumbered(given, {3: 4_000_000_000, 11: 3, 99: 1})
        np.testing.assert_array_equal(actual.numpy(), expected)
        assert actual.dtype == wp.uint32


def test_semantic_labels_are_those_of_the_nearest_prim_that_has_some():
    stage = Usd.Stage.CreateInMemory()
    shelf, part = (
        UsdGeom.Xform.Define(stage, "/shelf").GetPrim(),
        UsdGeom.Cube.Define(stage, "/shelf/part").GetPrim(),
    )
    UsdSemantics.LabelsAPI.Apply(shelf, "class").CreateLabelsAttr(["shelf"])
    UsdSemantics.LabelsAPI.Apply(shelf, "room").CreateLabelsAttr(["store"])
    assert semantics_of(part) == {"class": ["shelf"], "room": ["store"]}
    # As Isaac Sim wrote them before version 5.
    for name, value in (("semanticType", "class"), ("semanticData", "board")):
        part.CreateAttribute(f"semantic:Semantics:params:{name}", Sdf.ValueTypeNames.String).Set(value)
    assert semantics_of(part) == {"class": ["board"], "room": ["store"]}
    assert semantics_of(stage.GetPrimAtPath("/gone")) == {}
