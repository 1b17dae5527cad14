"""Event cameras of MuJoCo Warp: their paths against what its renderer shows, their events against what it draws."""

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import rigid_numpy
import warp as wp
from batch_scene import WORLDS, Moving
from mujoco_scene import FRAME_HZ, HEIGHT, PHYSICS_HZ, WIDTH
from test_mujoco import directions, traced
from test_newton import events_of, flat, moved, on_host, unmoved

import esaac
from esaac.mujoco.lens import lens_of
from esaac.mujoco.view import UNKNOWN
from esaac.mujoco_warp import EventCameras

SENSOR = {"width": WIDTH, "height": HEIGHT, "contrast_on": 0.15, "contrast_off": 0.15}
PER_FRAME = PHYSICS_HZ // FRAME_HZ


def cameras(moving, camera="still", **options):
    options = {**SENSOR, **options}
    return EventCameras(moving.host_model, moving.model, moving.data, camera, "dvs128", **options)


def as_mujoco_has(moving, world):
    """The present state of a world."""
    data = mujoco.MjData(moving.host_model)
    data.qpos[:] = moving.data.qpos.numpy()[world]
    mujoco.mj_forward(moving.host_model, data)
    return data


def interval(made, moving):
    """Records the steps up to the next frame."""
    for _ in range(PER_FRAME):
        made.record()
        moving.step()


@pytest.mark.parametrize("camera", ["still", "asymmetric", "square", "shaken"])
def test_depth_and_bodies_are_those_of_rays_through_the_middles_of_pixels(camera):
    moving = Moving()
    made = cameras(moving, camera)
    made.step()
    interval(made, moving)
    made.step()
    lens = lens_of(moving.host_model, moving.host_model.camera(camera).id, WIDTH, HEIGHT, cropped=True)
    for world in range(WORLDS):
        data = as_mujoco_has(moving, world)
        turn = data.cam(camera).xmat.reshape(3, 3)
        rays = directions(lens).reshape(-1, 3) @ turn.T
        depth, bodies = traced(moving.host_model, data, data.cam(camera).xpos, rays)
        ids, drawn = made.view.ids.numpy()[world].ravel(), made.view.depth.numpy()[world].ravel()
        same = ids == bodies
        assert same.mean() > 0.99 and set(ids) == {0, 1, 2}
        np.testing.assert_allclose(drawn[same], depth[same], rtol=2e-4)


def told(poses, world, depth, ids, lens):
    """Of all substeps: each pixel's surface in the camera's axes, by the poses alone."""
    points = moved(poses.camera[-1, world], directions(lens) * depth[..., None])
    numbers = ids.astype(int)
    still = np.array([[0, 0, 0, 0, 0, 0, 1.0]])
    body = lambda step: np.concatenate([still, poses.bodies[step, world]])[numbers]
    local = unmoved(body(-1), points)
    return [unmoved(poses.camera[step, world], moved(body(step), local)) for step in range(len(poses))]


@pytest.mark.parametrize("camera", ["still", "shaken"])
def test_paths_are_within_a_fiftieth_of_a_pixel_of_where_the_renderer_shows_them(camera, monkeypatch):
    moving, handed, states = Moving(), {}, []
    made = cameras(moving, camera, antialiasing=1)
    step = made.events.step
    monkeypatch.setattr(made.events, "step", lambda *a, **given: handed.update(given) or step(*a, **given))
    made.step()
    for _ in range(PER_FRAME):
        states.append(moving.data.qpos.numpy().copy())
        made.record()
        moving.step()
    states.append(moving.data.qpos.numpy().copy())
    made.step()
    poses = handed["poses"]
    depth, ids, first = (getattr(made.view, name).numpy().copy() for name in ("depth", "ids", "colour"))
    first = first[..., 0]
    assert len(poses) == PER_FRAME + 1
    lens = lens_of(moving.host_model, moving.host_model.camera(camera).id, WIDTH, HEIGHT)
    away_px, across_px = [], 0.0
    for world in range(WORLDS):
        paths = told(poses, world, depth[world], ids[world], lens)
        slopes = np.stack(np.gradient(first[world])[::-1], axis=-1)
        for substep in range(0, PER_FRAME + 1, 4):
            # The renderer draws that substep once more, with rays towards the predicted points.
            there = paths[substep]
            rays = there / np.linalg.norm(there, axis=-1, keepdims=True)
            made.view._context.ray.assign(rays.reshape(-1, 3).astype(np.float32))
            moving.data.qpos.assign(states[substep])
            made._present.update()
            made.view.draw()
            distance = made.view.depth.numpy()[world] / -rays[..., 2]
            away = np.abs(distance - np.linalg.norm(there, axis=-1))
            same = (made.view.ids.numpy()[world] == ids[world]) & (away < 0.02)
            colour = made.view.colour.numpy()[world, ..., 0]
            for number in range(3):
                inner = same & (ids[world] == number) & flat(depth[world])
                away_px.append((away * lens.fx / distance)[inner])
                shift, *_ = np.linalg.lstsq(slopes[inner], (colour - first[world])[inner], rcond=None)
                across_px = max(across_px, float(np.linalg.norm(shift)))
    away_px = np.concatenate(away_px)
    hidden, furthest_px = np.mean(away_px > 0.02), np.quantile(away_px, 0.995)
    print(
        f"camera {camera}, {len(away_px)} points: {furthest_px:.5f} px along a ray (99.5% of them; "
        f"{100 * hidden:.2f}% are hidden), {across_px:.5f} px across (mean of a surface)"
    )
    assert len(away_px) > 9 * WORLDS * 1500
    assert furthest_px < 0.02 and across_px < 0.02


def run(camera, frame_hz, seconds, synthesis, **options):
    """Events of each world."""
    moving, packets = Moving(), []
    made = cameras(moving, camera, synthesis=synthesis, **options)
    for index in range(round(seconds * PHYSICS_HZ) + 1):
        if index:
            made.record()
            moving.step()
        if index % (PHYSICS_HZ // frame_hz) == 0:
            packets.append(made.step())
    if synthesis == "rigid":
        assert not any(each["without_poses"] for each in made.events.statistics["cameras"])
    made.close()
    return [events_of(packets, world) for world in range(WORLDS)]


BOUNDS = {"still": 0.6, "shaken": 0.8}


@pytest.mark.parametrize("camera", BOUNDS)
def test_events_agree_with_those_of_mujoco_warp_rendered_at_every_step(camera, monkeypatch):
    monkeypatch.setattr(rigid_numpy, "WIDTH", WIDTH)
    seconds = 0.1
    truth = run(camera, PHYSICS_HZ, seconds, "linear", antialiasing=7)
    scores = {
        synthesis: [
            rigid_numpy.f1(*pair)
            for pair in zip(run(camera, FRAME_HZ, seconds, synthesis, antialiasing=5), truth)
        ]
        for synthesis in ("rigid", "linear")
    }
    shown = {name: [round(score, 3) for score in each] for name, each in scores.items()}
    print(f"camera {camera}, {[len(t[0]) for t in truth]} events: F1 within 1 ms {shown}")
    assert np.mean(scores["rigid"]) >= BOUNDS[camera]
    assert min(scores["rigid"]) > 1.4 * max(scores["linear"])


def test_trap_poses_after_a_step_are_those_of_its_end_and_the_data_are_left_alone():
    moving = Moving()
    # Nothing has computed where bodies are.
    moving.data.qpos.assign(moving.data.qpos.numpy() + np.float32(0.05))
    made = cameras(moving, "shaken")
    made.step()
    interval(made, moving)
    names = ("qpos", "qvel", "xpos", "xquat", "geom_xpos", "cam_xpos", "subtree_com", "cdof")
    kept = {name: getattr(moving.data, name).numpy().copy() for name in names}
    made.record(), made.step()
    for name, values in kept.items():
        np.testing.assert_array_equal(getattr(moving.data, name).numpy(), values, err_msg=name)
    rows = made._present.body_q.numpy()[None]
    for world in range(WORLDS):
        data = as_mujoco_has(moving, world)
        camera, bodies = made._present.poses([0], rows)[0, world], made._present.arranged(rows)[0, world]
        np.testing.assert_allclose(bodies[:, :3], data.xpos[1:], atol=1e-6)
        for turn, expected in zip(bodies[:, 3:], data.xquat[1:, [1, 2, 3, 0]]):
            np.testing.assert_allclose(abs(turn @ expected), 1, atol=1e-6)
        np.testing.assert_allclose(camera[:3], data.cam("shaken").xpos, atol=1e-6)
        axes = unmoved(camera, camera[:3] + data.cam("shaken").xmat.reshape(3, 3).T)
        np.testing.assert_allclose(axes, np.eye(3), atol=1e-6)
        assert np.abs(kept["xpos"][world] - data.xpos).max() > 1e-3


def test_a_world_that_begins_anew_is_a_fresh_run_and_the_other_one_goes_on():
    # Physics of whole microseconds, so that the same episode has the same intervals at any time.
    options = {"substep_s": 0.001, "profile": "noisy"}

    def frame(made, moving):
        interval(made, moving)
        return made.step()

    moving, undisturbed = Moving(), Moving()
    made, fresh = cameras(moving, **options), cameras(undisturbed, **options)
    assert len(made.step()) == len(fresh.step()) == 0
    got, expected = ([frame(*pair) for _ in range(2)] for pair in ((made, moving), (fresh, undisturbed)))
    moving.begin([1])
    made.reset([1])
    # The first frame of the new episode, of this world alone; the other waits.
    assert len(made.step(worlds=[1])) == 0
    got += [frame(made, moving) for _ in range(2)]
    expected += [frame(fresh, undisturbed) for _ in range(2)]
    for index in range(4):
        pairs = [(got[index][0], expected[index][0], 0)]
        if index >= 2:
            pairs.append((got[index][1], expected[index - 2][1], 2 * PER_FRAME * 1_000_000))
        for one, other, shift_ns in pairs:
            assert len(one) > 300
            for name in ("x", "y", "p"):
                np.testing.assert_array_equal(on_host(getattr(one, name)), on_host(getattr(other, name)))
            np.testing.assert_array_equal(on_host(one.t_ns) - shift_ns, on_host(other.t_ns))
    assert len(got[0][0]) != len(got[0][1])


def test_a_world_that_waits_has_the_events_of_both_intervals_later():
    moving = Moving()
    made = cameras(moving)
    made.step()
    interval(made, moving)
    assert len(made.step(worlds=[0])[1]) == 0
    interval(made, moving)
    late = made.step()
    first_ns = 2 * PER_FRAME * 1e9 / PHYSICS_HZ
    assert on_host(late[1].t_ns).min() < 0.3 * first_ns < 0.5 * first_ns <= on_host(late[0].t_ns).min()


def test_a_graph_may_record_and_step():
    packets = []
    for captures in (False, True):
        moving = Moving()
        made = cameras(moving)
        made.step()

        def record_and_step(moving=moving, made=made):
            made.record()
            mjw.step(moving.model, moving.data)

        if captures:
            with wp.ScopedCapture() as capture:
                record_and_step()
        for _ in range(PER_FRAME):
            if captures:
                wp.capture_launch(capture.graph)
            else:
                record_and_step()
        packets.append(made.step())
    assert len(packets[0]) == len(packets[1]) > 600
    for name in ("x", "y", "t_ns", "p"):
        np.testing.assert_array_equal(*(on_host(getattr(packet, name)) for packet in packets))


def test_arrays_of_the_model_that_are_exchanged_are_drawn():
    moving = Moving()
    made = cameras(moving, antialiasing=1)
    made.step()
    made.record()
    made.step()
    floor = made.view.colour.numpy()[0, -1, 5].copy()
    colours = moving.model.geom_rgba.numpy().copy()
    colours[:, moving.host_model.geom("floor").id] *= 0.5
    moving.model.geom_rgba = wp.array(colours, dtype=wp.vec4)
    made.record()
    made.step()
    encoded = 0.5 * np.array([0.4, 0.4, 0.45])
    np.testing.assert_allclose(
        made.view.colour.numpy()[0, -1, 5], ((encoded + 0.055) / 1.055) ** 2.4, rtol=0.02
    )
    assert (made.view.colour.numpy()[0, -1, 5] < 0.3 * floor).all()


CLOTH = """
<mujoco>
  <visual><headlight ambient="1 1 1" diffuse="0 0 0"/></visual>
  <asset>{sky}</asset>
  <worldbody>
    <body pos="0 2 .6"><joint type="slide" axis="1 0 0"/><geom size=".2"/></body>
    <flexcomp name="cloth" type="grid" count="4 4 1" spacing=".1 .1 .1" pos="0 2 0" euler="90 0 0" radius=".01"
      dim="2" mass="1"><edge equality="true"/></flexcomp>
    <camera name="eye" xyaxes="1 0 0 0 0 1" fovy="60"/>
    <camera name="flat" xyaxes="1 0 0 0 0 1" fovy="2" projection="orthographic"/>
  </worldbody>
</mujoco>
"""
SKY = '<texture type="skybox" builtin="flat" rgb1=".2 .4 .6" width="16" height="96"/>'


def cloth(sky="", camera="eye", **options):
    host_model = mujoco.MjModel.from_xml_string(CLOTH.format(sky=sky))
    data = mjw.make_data(host_model, nworld=2)
    return EventCameras(host_model, mjw.put_model(host_model), data, camera, **{**SENSOR, **options}), data


def test_the_sky_is_far_away_and_flexes_have_no_pose():
    made, data = cloth(background=(0.1, 0.2, 0.3))
    made.step()
    ids, depth = made.view.ids.numpy().copy(), made.view.depth.numpy().copy()
    assert set(np.unique(ids)) == {0, 1, UNKNOWN} and np.isclose(depth[ids == 1].min(), 1.8, atol=0.02)
    np.testing.assert_allclose(depth[ids == UNKNOWN], 2, atol=0.03)
    assert (depth[ids == 0] == 0).all()
    np.testing.assert_allclose(made.view.colour.numpy()[1, 0, 0], (0.1, 0.2, 0.3), rtol=1e-6)
    places = data.qpos.numpy().copy()
    places[1] += 0.1
    data.qpos.assign(places)
    made.record()
    made.step()
    moved_ids = made.view.ids.numpy()
    for kind in (1, UNKNOWN):
        assert (moved_ids[0] == ids[0]).all() and (moved_ids[1] == kind).sum() > 20
        assert ((moved_ids[1] == kind) != (ids[1] == kind)).any()
    assert all(each["without_poses"] for each in made.events.statistics["cameras"])
    made, _ = cloth(sky=SKY, rendering={"enabled_geom_groups": [1]})
    made.step()
    assert set(np.unique(made.view.ids.numpy())) == {0, UNKNOWN}
    encoded = np.array([0.2, 0.4, 0.6])
    np.testing.assert_allclose(
        made.view.colour.numpy()[0, 0, 0], ((encoded + 0.055) / 1.055) ** 2.4, rtol=0.02
    )


def test_wrong_arguments_are_told():
    moving = Moving()
    for camera, options, error, message in (
        (
            "nobody",
            {},
            esaac.ArgumentError,
            "camera is `nobody`, expected one of still, asymmetric, square, shaken",
        ),
        ("still", {"antialiasing": 2}, esaac.ArgumentError, "antialiasing is 2, expected 1, 3, 5 or 7"),
        ("still", {"substep_s": 0}, esaac.ArgumentError, "substep_s is 0, expected seconds above 0"),
        ("still", {"limit": 0}, esaac.ArgumentError, "limit is 0, expected at least 1"),
        (
            "still",
            {"rendering": {"nworld": 3}},
            esaac.ArgumentError,
            "rendering has `nworld`, which event cameras set",
        ),
        ("still", {"contrast_on": -1}, esaac.SensorError, "contrast_on"),
    ):
        with pytest.raises(error, match=message):
            cameras(moving, camera, **options)
    with pytest.raises(esaac.ArgumentError, match="camera 1 is orthographic, expected a perspective one"):
        cloth(camera="flat")
    made = cameras(moving, limit=10)
    with pytest.raises(AttributeError, match=r"`contrast_on` is a parameter .*cameras\.events\.set_sensor"):
        made.contrast_on = 0.4
    made.step()
    with pytest.raises(esaac.ArgumentError, match="world 0 has had its frame at substep 0, expected record"):
        made.step()
    with pytest.raises(esaac.ArgumentError, match=r"world is 2, expected a number from 0 to 1"):
        made.step(worlds=[2])
    for _ in range(11):
        made.record()
    with pytest.raises(esaac.FrameError, match="11 substeps since the last frame, expected at most 10"):
        made.step()
    made.close()
    for call in (made.record, made.step, made.reset):
        with pytest.raises(esaac.ClosedError, match="the cameras are closed"):
            call()
