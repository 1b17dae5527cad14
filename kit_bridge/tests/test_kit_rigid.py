"""Modes `rigid` and `auto` of the extension: depth, ids and poses of what moves, at every physics step."""

import sys
import warnings

import numpy as np
import omni.physx
import pytest
from kit_stage import APP, TIMELINE, bridge, camera, fresh_stage, move
from omni.replicator import core as rep
from pxr import Gf, Usd, UsdGeom, UsdPhysics

import esaac
from esaac_sim.frames import FrameUnusable, frame_of
from esaac_sim.poses import Transforms
from esaac_sim.schema import SchemaError, spec_of
from esaac_sim.writer import EsaacEventWriter

PHYSICS_HZ = rep.RATE_HZ * omni.physx.STEPS


@pytest.fixture
def stage():
    with fresh_stage() as stage:
        stage.GetPrimAtPath("/camera").GetAttribute("esaac:mode").Set("rigid")
        yield stage


def swing(t):
    """A body that swings faster than frames tell."""
    return (0.6 * np.sin(2 * np.pi * 9 * t), 0.2, 0.0), (0.0, 0.0, 0.0, 1.0)


def rigid_body(stage, path="/cube"):
    UsdPhysics.RigidBodyAPI.Apply(stage.GetPrimAtPath(path))
    omni.physx.bodies[path] = swing


class Copies:
    """A second writer on the same camera that copies what it is handed."""

    def __init__(self, spec):
        self.frames, self.spec = [], spec
        self.product = rep.create.render_product(spec.path, (spec.sensor.width, spec.sensor.height))
        self.writer = EsaacEventWriter(self.keep, with_motion=False, with_depth=True, with_ids=True)
        self.writer.attach([self.product])

    def keep(self, data):
        size = self.spec.sensor.width, self.spec.sensor.height
        try:
            frame = frame_of(data, *size, needs_motion=False, needs_geometry=True)
        except FrameUnusable:
            return
        arrays = (array.numpy().copy() for array in (frame.hdr, frame.depth, frame.ids))
        self.frames.append((frame.t_ns, *arrays, frame.labels))


def test_events_follow_the_paths_that_physics_took(stage):
    rigid_body(stage)
    running = bridge()
    assert running.attach(stage) == 1 and not running.problems
    (feed,) = running.feeds
    kept = []
    feed.sinks.append(lambda feed, packet: kept.append((packet.x.copy(), packet.t_ns.copy())))
    copies = Copies(feed.spec)
    TIMELINE.play()
    for _ in range(14):
        APP.update()
    assert feed.frames == 12 and feed.unusable == 2 and not feed.faults, feed.message
    assert feed.camera.synthesis == "rigid" and feed.camera.statistics["without_poses"] == 0
    # The same frames, with the poses as they were.
    alone, lens = esaac.EventCamera(feed.spec.sensor, intrinsics=feed.spec.intrinsics), feed.spec.intrinsics
    assert (lens.cx, lens.cy, lens.half_pixel_centres) == (32, 24, True)
    steps = np.arange(1, 14 * omni.physx.STEPS)
    times_ns = np.round(steps / PHYSICS_HZ * 1e9).astype(np.int64)
    eye = np.zeros((len(steps), 7)) + [0, 0, 8, 0, 0, 0, 1]
    body = np.array([[*swing(step / PHYSICS_HZ)[0], 0, 0, 0, 1] for step in steps])[:, None]
    events = 0
    for (t_ns, hdr, depth, ids, labels), (x, t) in zip(copies.frames, kept):
        assert labels == {"0": "BACKGROUND", "7": "/cube"}
        # The extension hands out two steps beyond the frame before, and none beyond this one.
        first, last = t_ns - round(1e9 / rep.RATE_HZ) if events or len(t) else t_ns, t_ns
        near = (times_ns <= last + 5) & (times_ns >= first - round(2.5e9 / PHYSICS_HZ))
        times = times_ns[near]
        times[-1] = max(times[-1], t_ns)
        poses = esaac.Poses(times, eye[near], body[near], ids={7: 0})
        packet = alone.step(hdr, t_ns=t_ns, depth=depth, ids=ids, poses=poses)
        np.testing.assert_array_equal(packet.x, x)
        np.testing.assert_array_equal(packet.t_ns, t)
        events += len(x)
    assert events > 200 and len(kept) == 12
    running.detach()
    copies.writer.detach()


def test_vectors_that_the_poses_do_not_predict_are_told_of(stage):
    stage.GetPrimAtPath("/camera").GetAttribute("esaac:mode").Set("auto")
    rigid_body(stage)
    for negated in (False, True):
        rep.faults.negate_motion = negated
        running = bridge()
        running.attach(stage)
        (feed,) = running.feeds
        TIMELINE.play()
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            for _ in range(8):
                APP.update()
        told = [w for w in caught if w.category is esaac.PoseWarning]
        assert feed.frames > 4 and not feed.faults and feed.camera.synthesis == "rigid", feed.message
        assert ("sign is flipped" in feed.message) == bool(told) == negated, feed.message
        running.detach()
        TIMELINE.stop()


def test_what_a_script_moves_has_poses_from_its_second_interval_on(stage):
    running = bridge()
    running.attach(stage)
    TIMELINE.play()
    for _ in range(6):
        APP.update()
    (feed,) = running.feeds
    lost = lambda: feed.camera.statistics["without_poses"]
    assert feed.frames == 4 and lost() == 0
    move(stage, 1, first=4)
    assert feed.frames == 5 and lost() > 50
    move(stage, 3, first=5)
    assert feed.frames == 8 and not feed.faults and lost() == 0, feed.message
    running.detach()


def test_bodies_that_are_spawned_while_it_runs_are_followed_from_then_on(stage):
    transforms = Transforms(stage)
    recorder = transforms.recorder("/camera")
    omni.physx.step_to(1, rep.RATE_HZ)
    then_ns = transforms._last_ns
    # A body below a group, one that comes with a layer, and one that becomes a body.
    UsdGeom.Xform.Define(stage, "/group")
    UsdPhysics.RigidBodyAPI.Apply(UsdGeom.Cube.Define(stage, "/group/box").GetPrim())
    asset = Usd.Stage.CreateInMemory()
    UsdPhysics.RigidBodyAPI.Apply(UsdGeom.Cube.Define(asset, "/asset/body").GetPrim())
    animated = UsdGeom.Cube.Define(asset, "/asset/animated").AddTranslateOp()
    animated.Set(Gf.Vec3d(0), 0)
    animated.Set(Gf.Vec3d(1, 0, 0), 24)
    asset.SetDefaultPrim(asset.GetPrimAtPath("/asset"))
    stage.DefinePrim("/spawned").GetReferences().AddReference(asset.GetRootLayer().identifier)
    UsdPhysics.RigidBodyAPI.Apply(stage.GetPrimAtPath("/cube"))
    bodies = ("/group/box", "/spawned/body", "/spawned/animated", "/cube")
    labels = {str(number): path for number, path in enumerate(bodies, 1)}
    # Where they were in the interval in which they came is not known.
    assert transforms.table(labels, then_ns) == {}
    for path in bodies[:2]:
        omni.physx.bodies[path] = swing
    omni.physx.step_to(2, rep.RATE_HZ)
    table = transforms.table(labels, then_ns + 1)
    assert sorted(table.values()) == [0, 1, 2, 3] and transforms.table({"1": "/group"}, 0) == {1: -1}
    poses = recorder.spanning(then_ns, round(2e9 / 60))
    expected = [swing(t_ns * 1e-9)[0][0] for t_ns in poses.times_ns if t_ns > then_ns]
    for number in (1, 2):
        np.testing.assert_allclose(poses.bodies[-len(expected) :, 0, table[number], 0], expected, atol=1e-6)
    # One that is removed ends nothing.
    stage.RemovePrim("/group")
    omni.physx.step_to(3, rep.RATE_HZ)
    assert transforms._last_ns == round(3e9 / 60)
    transforms.close()


def test_animated_prims_are_where_the_timeline_has_them(stage):
    stage.SetTimeCodesPerSecond(60)
    place = stage.GetPrimAtPath("/cube").GetAttribute("xformOp:translate")
    for frame in range(600):
        place.Set(Gf.Vec3d(frame, 0, 0), frame)
    transforms = Transforms(stage)
    recorder = transforms.recorder("/camera")
    # The timeline begins at 2 s, where physics begins at 0; later it jumps forth, and back in a loop.
    for at in (120, 300, 60):
        TIMELINE.set_current_time(at / 60)
        TIMELINE.play()
        for _ in range(6):
            APP.update()
        end = rep._FRAME - 1
        poses = recorder.spanning(round((end - 4) / 60 * 1e9), round(end / 60 * 1e9))
        frames = np.round(poses.times_ns * 1e-9 * PHYSICS_HZ) / omni.physx.STEPS
        # In the frame of a jump itself the timeline was nowhere else.
        known = frames >= end - 4
        np.testing.assert_allclose(poses.bodies[known, 0, 0, 0], (frames - end + at + 6)[known], atol=1e-4)
    transforms.close()


def test_a_camera_on_a_body_moves_with_it(stage):
    UsdGeom.Xform.Define(stage, "/robot").AddTranslateOp().Set(Gf.Vec3d(1, 0, 0))
    UsdGeom.XformCommonAPI(stage.GetPrimAtPath("/robot")).SetScale(Gf.Vec3f(2, 2, 2))
    eye = camera(stage, "/robot/eye", sensor="dvs128", mode="auto").GetPrim()
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    rigid_body(stage, "/robot")
    # USD believes the robot to be at (1, 0, 0), and the eye 16 before it. It is turned about y by a quarter.
    half = 0.5**0.5
    omni.physx.bodies["/robot"] = lambda t: ((5 + t, 0, 0), (0, half, 0, half))
    transforms = Transforms(stage)
    recorder = transforms.recorder(str(eye.GetPath()))
    for frame in (1, 2):
        omni.physx.step_to(frame, rep.RATE_HZ)
    poses = recorder.spanning(round(1e9 / 60), round(2e9 / 60))
    t = poses.times_ns * 1e-9
    np.testing.assert_allclose(poses.camera[:, 0, 0], 0.01 * (5 + t + 16), atol=1e-9)
    np.testing.assert_allclose(poses.camera[:, 0, 1:3], 0, atol=1e-9)
    np.testing.assert_allclose(abs(poses.camera[:, 0, 3:] @ [0, half, 0, half]), 1, atol=1e-6)
    np.testing.assert_allclose(poses.bodies[:, 0, 0, 0], 0.01 * (5 + t), atol=1e-9)
    labels = {"0": "BACKGROUND", "1": "UNLABELLED", "2": "/robot/eye/lens", "3": "/cube"}
    assert transforms.table(labels, 0) == {2: 0, 3: -1}
    transforms.close()
    assert not omni.physx._subscribed


def test_time_that_is_set_back_begins_the_recording_anew(stage):
    rigid_body(stage)
    running = bridge()
    running.attach(stage)
    move(stage, 10)
    (feed,) = running.feeds
    rep._FRAME = 0
    for _ in range(5):
        APP.update()
    # The first frame is at time 0, before the first physics step.
    assert feed.gaps == 1 and feed.frames == 8 + 4, feed.message
    running.detach()


def test_auto_asks_for_motion_as_well_and_goes_on_without(stage):
    rigid_body(stage)
    stage.GetPrimAtPath("/camera").GetAttribute("esaac:mode").Set("auto")
    spec = spec_of(stage.GetPrimAtPath("/camera"))
    assert spec.with_motion and spec.with_geometry
    running = bridge()
    running.checks = [check("motion")]
    running.attach(stage)
    assert "what has no poses is blended" in running.problems[0]
    move(stage, 8)
    (feed,) = running.feeds
    assert feed.frames == 6 and feed.camera.synthesis == "rigid" and not feed.spec.with_motion
    running.detach()


def check(disables):
    from esaac_sim.self_test import Check

    return Check(disables, False, "wrong", disables=disables)


def test_auto_does_without_poses_where_there_are_none_and_says_so(stage, monkeypatch):
    prim, running = stage.GetPrimAtPath("/camera"), bridge()
    prim.GetAttribute("esaac:mode").Set("auto")

    def runs_by_vectors(first):
        (feed,) = running.feeds
        move(stage, 12, first=first)
        before = feed.frames
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            move(stage, 6, first=first + 12)
        assert feed.camera.synthesis == "motion" and feed.frames > before and feed.events > 100, feed.message
        assert not feed.faults
        return feed

    # Physics does not step.
    with monkeypatch.context() as patch:
        patch.setattr(omni.physx, "step_to", lambda *_: None)
        assert running.attach(stage) == 1 and not running.problems
        move(stage, 6)
        assert running.feeds[0].frames == 0 and "no poses yet" in running.feeds[0].message
        feed = runs_by_vectors(6)
        assert feed.message == "no poses, as physics does not step; mode `auto` is `motion`"
        running.detach()
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "omni.physx", None)
        running.attach(stage)
        why = "poses need omni.physx, which is not enabled, so mode `auto` does without poses"
        assert running.problems == [f"/camera: {why}"]
        runs_by_vectors(24)
        running.detach()
    UsdGeom.Camera(prim).GetHorizontalApertureAttr().Set(0.0)
    assert running.attach(stage) == 1 and not running.feeds[0].spec.with_geometry
    why = "the camera has no horizontal aperture, so mode `auto` does without poses"
    assert running.problems == [f"/camera: {why}"]
    running.detach()


def test_what_is_missing_is_told(stage, monkeypatch):
    running = bridge()
    running.attach(stage)
    monkeypatch.setattr(omni.physx, "step_to", lambda *_: None)
    move(stage, 5)
    (feed,) = running.feeds
    assert feed.frames == 0 and "does the stage have a physics scene?" in feed.message.lower()
    running.detach()
    monkeypatch.setitem(sys.modules, "omni.physx", None)
    assert running.attach(stage) == 0 and "poses need omni.physx, which is not enabled" in running.problems[0]
    running.detach()
    UsdGeom.Camera(stage.GetPrimAtPath("/camera")).GetHorizontalApertureAttr().Set(0.0)
    with pytest.raises(SchemaError, match="no horizontal aperture, which mode `rigid` needs"):
        spec_of(stage.GetPrimAtPath("/camera"))
    data = {"instance_id_segmentation": np.zeros((4, 5), np.uint32), "IsaacReadSimulationTime": 1}
    data |= {
        "HdrColor": np.zeros((4, 5, 4), np.float16),
        "distance_to_image_plane": np.zeros((4, 5), np.float32),
    }
    with pytest.raises(FrameUnusable, match="no `idToLabels`"):
        frame_of(data, 5, 4, needs_motion=False, needs_geometry=True)
