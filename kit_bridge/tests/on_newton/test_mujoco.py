"""Event cameras of MuJoCo: their paths against MuJoCo's own poses and rays, their events against what it draws."""

import mujoco
import mujoco_scene as scene
import numpy as np
import pytest
import rigid_numpy
from mujoco_scene import FRAME_HZ, HEIGHT, PHYSICS_HZ, POSES_HZ, TRUTH_HZ, WIDTH
from test_newton import moved, unmoved

import esaac
from esaac.mujoco import EventCamera
from esaac.mujoco.lens import lens_of
from esaac.mujoco.view import UNKNOWN

SENSOR = {"width": WIDTH, "height": HEIGHT, "contrast_on": 0.15, "contrast_off": 0.15}
COLUMNS = ("x", "y", "t_ns", "p")
CAMERAS = ["still", "shaken"]


@pytest.fixture(scope="module")
def model():
    return scene.model()


def made(model, camera="still", **options):
    return EventCamera(model, camera, "dvs128", **{**SENSOR, **options})


def directions(lens, width=WIDTH, height=HEIGHT):
    """Rays through the middles of pixels in a camera's axes."""
    _, fx, fy, cx, cy = lens.told()
    x, y = np.meshgrid((np.arange(width) - cx) / fx, (np.arange(height) - cy) / fy)
    return np.stack([x, -y, -np.ones_like(x)], axis=-1)


def traced(model, data, eye, rays):
    """Distance along rays `(n, 3)` to the first geom, in lengths of the ray, and its body; -1 where there is none."""
    lengths, bodies, geom = np.full(len(rays), -1.0), np.full(len(rays), -1), np.zeros(1, np.int32)
    for index, ray in enumerate(rays):
        length = np.linalg.norm(ray)
        distance = mujoco.mj_ray(model, data, eye, ray / length, None, 1, -1, geom)
        if geom[0] >= 0:
            lengths[index], bodies[index] = distance / length, model.geom_bodyid[geom[0]]
    return lengths, bodies


@pytest.mark.parametrize("camera", [*CAMERAS, "asymmetric"])
def test_depth_and_bodies_are_those_of_rays_through_the_middles_of_pixels(camera):
    model = scene.model()
    data = scene.begun(model)
    with made(model, camera) as cam:
        cam.step(data)
        rays = directions(lens_of(model, model.camera(camera).id, WIDTH, HEIGHT)).reshape(-1, 3)
        turn = data.cam(camera).xmat.reshape(3, 3)
        depth, bodies = traced(model, data, data.cam(camera).xpos, rays @ turn.T)
        same = cam.ids.ravel() == bodies
        assert same.mean() > 0.99 and {0, 1, 2} <= set(cam.ids.ravel())
        np.testing.assert_allclose(cam.depth.ravel()[same], depth[same], rtol=2e-4)


@pytest.mark.parametrize("camera", CAMERAS)
def test_paths_are_within_a_fiftieth_of_a_pixel_of_mujocos_own(model, camera, monkeypatch):
    data, states, handed = scene.begun(model), [], {}
    with made(model, camera) as cam:
        step = cam.events.step
        spanning = lambda given: given["poses"].spanning(0, given["t_ns"])
        kept = lambda *images, **given: handed.update(poses=spanning(given)) or step(*images, **given)
        monkeypatch.setattr(cam.events, "step", kept)
        cam.step(data)
        for index in range(PHYSICS_HZ // FRAME_HZ):
            mujoco.mj_step(model, data)
            if (index + 1) % (PHYSICS_HZ // POSES_HZ) == 0:
                cam.record(data)
                states.append(data.qpos.copy())
        cam.step(data)
        depth, ids = cam.depth.ravel().astype(float), cam.ids.ravel()
    poses, seen = handed["poses"], depth > 0
    lens = lens_of(model, model.camera(camera).id, WIDTH, HEIGHT)
    own = mujoco.MjData(model)

    def at(qpos):
        own.qpos[:] = qpos
        mujoco.mj_forward(model, own)
        turns = own.xmat.reshape(-1, 3, 3)[ids]
        return own.cam(camera).xpos, own.cam(camera).xmat.reshape(3, 3), own.xpos[ids], turns

    # Points of the last frame's surfaces in the axes of their bodies.
    eye, turn, places, turns = at(states[-1])
    points = eye + (directions(lens).reshape(-1, 3) * depth[:, None]) @ turn.T
    local = np.einsum("nji,nj->ni", turns, points - places)
    still = np.array([[0, 0, 0, 0, 0, 0, 1.0]])
    assert len(poses) == 1 + len(states)
    worst_px, along_px, shown = 0.0, [], []
    for qpos, camera_pose, bodies in zip(states, poses.camera[1:, 0], poses.bodies[1:, 0]):
        eye, turn, places, turns = at(qpos)
        true = places + np.einsum("nij,nj->ni", turns, local)
        body = np.concatenate([still, bodies])[ids]
        told = moved(body, local)
        pixels = [
            lens.fx * there[:, :2] / there[:, 2:]
            for there in ((true - eye) @ turn, unmoved(camera_pose, told))
        ]
        worst_px = max(worst_px, float(np.linalg.norm(pixels[0] - pixels[1], axis=-1)[seen].max()))
        # Where MuJoCo itself has a surface along the way to the point.
        length, bodies = traced(model, own, eye, (told - eye)[seen])
        same = (bodies == ids[seen]) & (np.abs(length - 1) < 0.02)
        along_px.append((np.abs(length - 1) * lens.fx)[same])
        shown.append(same.mean())
    furthest_px = np.quantile(np.concatenate(along_px), 0.995)
    print(
        f"camera {camera}: {worst_px:.6f} px across, {furthest_px:.6f} px along rays, {min(shown):.3f} shown"
    )
    assert worst_px < 0.02 and furthest_px < 0.02 and min(shown) > 0.9


def run(camera, frame_hz, seconds, synthesis, **options):
    model, begun = (scene.yard(), scene.yard_begun) if camera == "yard" else (scene.model(), scene.begun)
    data, packets = begun(model), []
    with made(model, camera, synthesis=synthesis, **options) as cam:
        for index in range(round(seconds * PHYSICS_HZ) + 1):
            if index:
                mujoco.mj_step(model, data)
            if index % (PHYSICS_HZ // POSES_HZ) == 0:
                cam.record(data)
            if index % (PHYSICS_HZ // frame_hz) == 0:
                packets.append(cam.step(data))
        if synthesis == "rigid":
            assert not cam.events.statistics["without_poses"]
    return tuple(np.concatenate([getattr(packet, name) for packet in packets]) for name in COLUMNS)


BOUNDS = {
    ("still", FRAME_HZ): 0.62,
    ("still", 120): 0.8,
    ("shaken", FRAME_HZ): 0.85,
    ("yard", FRAME_HZ): 0.42,
}
"""Still cameras see only what turns, with texture as fine as their pixels, and hard edges."""


@pytest.mark.parametrize(("camera", "frame_hz"), BOUNDS)
def test_events_agree_with_those_of_mujoco_rendered_at_960_hz(camera, frame_hz, monkeypatch):
    """The truth is averaged of more samples than the frames, so that the frames' own noise counts against them."""
    monkeypatch.setattr(rigid_numpy, "WIDTH", WIDTH)
    seconds = 0.2
    truth = run(camera, TRUTH_HZ, seconds, "linear", antialiasing=7)
    scores = {
        synthesis: rigid_numpy.f1(run(camera, frame_hz, seconds, synthesis), truth)
        for synthesis in ("rigid", "linear")
    }
    told = {name: round(score, 3) for name, score in scores.items()}
    print(f"camera {camera}, frames at {frame_hz} Hz, {len(truth[0])} events: F1 within 1 ms {told}")
    assert scores["rigid"] >= BOUNDS[camera, frame_hz]
    assert scores["rigid"] > (1.4 if frame_hz == FRAME_HZ else 1.0) * scores["linear"]


def test_trap_poses_after_a_step_are_those_of_its_end_and_the_data_are_left_alone(model):
    data = scene.begun(model)
    with made(model, "shaken") as cam:
        for _ in range(8):
            mujoco.mj_step(model, data)
        kept = {
            name: getattr(data, name).copy() for name in ("qpos", "qvel", "xpos", "cam_xpos", "sensordata")
        }
        cam.record(data), cam.step(data)
        for name, values in kept.items():
            np.testing.assert_array_equal(getattr(data, name), values)
        (sample,) = cam._recorder._samples
        stale = data.xpos[1:].copy()
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(sample.bodies[:, :3], data.xpos[1:], atol=1e-12)
        np.testing.assert_allclose(sample.camera[:3], data.cam("shaken").xpos, atol=1e-12)
        assert np.abs(stale - data.xpos[1:]).max() > 1e-3


def test_a_state_that_is_set_at_a_recorded_time_takes_the_place_of_the_one_before(model):
    data = scene.begun(model)
    with made(model) as cam:
        cam.record(data)
        cam.record(data)
        (before,) = cam._recorder._samples
        data.qpos[:3] += 0.25
        cam.step(data)
        (sample,) = cam._recorder._samples
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(sample.bodies[:, :3], data.xpos[1:], atol=1e-12)
        assert np.abs(sample.bodies - before.bodies).max() > 0.1
        data.qpos[:3] += 0.25
        cam.record(data)
        assert cam._recorder._samples[-1] is sample, "the frame shows it"


def test_a_reset_begins_an_episode_that_equals_the_first(model):
    def episode(cam):
        data, packets = scene.begun(model), []
        for index in range(3 * PHYSICS_HZ // FRAME_HZ + 1):
            if index:
                mujoco.mj_step(model, data)
            cam.record(data)
            if index % (PHYSICS_HZ // FRAME_HZ) == 0:
                packets.append(cam.step(data))
        return data, packets

    with made(model, profile="noisy") as cam:
        data, first = episode(cam)
        # Time is set back, and nobody has said so.
        with pytest.raises(esaac.FrameError, match=r"data.time is 0 ns, .*; call reset\(\)"):
            cam.record(scene.begun(model))
        with pytest.raises(esaac.FrameError, match="the frame at 100000000 ns has been drawn"):
            cam.step(data)
        cam.reset()
        _, second = episode(cam)
    assert len(first[0]) == len(second[0]) == 0 and len(first[2]) > 300
    for early, late in zip(first, second):
        for name in COLUMNS:
            np.testing.assert_array_equal(getattr(early, name), getattr(late, name))


def test_the_example_writes_a_recording(tmp_path):
    import mujoco_events

    count, synthesis = mujoco_events.main(
        ["--seconds", "0.15", "--width", "64", "--height", "48", "--out", str(tmp_path / "events.npz")]
    )
    assert count > 500 and synthesis == "rigid" and len(np.load(tmp_path / "events.npz")["t"]) == count


SKY = """
<mujoco>
  <visual><headlight ambient="1 1 1"/></visual>
  <worldbody>
    <site name="mark" type="sphere" size=".2" pos="-.6 2 0" rgba="1 1 1 1"/>
    <body pos="0 2 .6"><joint type="slide" axis="1 0 0"/><geom size=".2"/><site name="a" pos="0 0 -.1"/></body>
    <site name="b" pos="0 2 -.7"/>
    <camera name="eye" xyaxes="1 0 0 0 0 1" fovy="60"/>
    <camera name="flat" xyaxes="1 0 0 0 0 1" fovy="2" {flat}/>
  </worldbody>
  <tendon><spatial width=".05"><site site="a"/><site site="b"/></spatial></tendon>
</mujoco>
"""


def sky():
    try:
        return mujoco.MjModel.from_xml_string(SKY.format(flat='projection="orthographic"'))
    except ValueError:
        return mujoco.MjModel.from_xml_string(SKY.format(flat='orthographic="true"'))


def test_the_sky_is_far_away_sites_are_part_of_their_body_and_tendons_have_no_pose():
    model = sky()
    data = mujoco.MjData(model)
    with made(model, "eye") as cam:
        cam.step(data)
        assert cam.colour.shape == (HEIGHT, WIDTH, 3) and cam.colour.dtype == np.float32
        assert set(np.unique(cam.ids)) == {0, 1, UNKNOWN}
        assert (cam.depth[0] == 0).all() and np.isclose(cam.depth[cam.ids == 1].min(), 1.8, atol=0.02)
        still = cam.ids == 0
        assert np.isclose(cam.depth[still & (cam.depth > 0)].min(), 1.8, atol=0.02)
        data.time = 0.01
        assert len(cam.step(data)) == 0
        assert cam.events.statistics["without_poses"] > 0
        data.time, model.cam_fovy[0] = 0.02, 50
        with pytest.raises(esaac.ArgumentError, match="the lens of camera 0 is changed while it runs"):
            cam.step(data)


def test_wrong_arguments_are_told(model):
    for camera, options, error, message in (
        ("nobody", {}, esaac.ArgumentError, "camera is `nobody`, expected one of still, asymmetric, shaken"),
        (3, {}, esaac.ArgumentError, "camera is 3, expected 0 to 2"),
        ("still", {"antialiasing": 2}, esaac.ArgumentError, "antialiasing is 2, expected 1, 3, 5 or 7"),
        ("still", {"limit": 2}, esaac.ArgumentError, "limit is 2, expected at least 9"),
        ("still", {"contrast_on": -1}, esaac.SensorError, "contrast_on"),
    ):
        with pytest.raises(error, match=message):
            made(model, camera, **options)
    with made(model, "still") as cam:
        with pytest.raises(AttributeError, match=r"`contrast_on` is a parameter .*camera\.events\.sensor ="):
            cam.contrast_on = 0.4
        data, other = mujoco.MjData(model), mujoco.MjData(sky())
        for call in (cam.record, cam.step):
            with pytest.raises(
                esaac.ArgumentError, match="data have .* bodies, expected .* the camera's model"
            ):
                call(other)
            data.time = np.nan
            with pytest.raises(esaac.FrameError, match="data.time is nan, expected finite seconds"):
                call(data)
        data.time = 0
        cam.step(data)
    cam.close()
    for call in (cam.record, cam.step):
        with pytest.raises(esaac.ClosedError, match="the camera is closed"):
            call(data)
    with pytest.raises(esaac.ArgumentError, match="camera 1 is orthographic, expected a perspective one"):
        made(sky(), "flat")
    assert (model.vis.global_.offwidth, model.vis.global_.offheight) == (640, 480)
