"""Event cameras of Newton: their paths and events against what Newton itself draws."""

import gc
import os

import newton
import numpy as np
import pytest
import rigid_numpy
import warp as wp
import worlds
from worlds import FRAME_HZ, HEIGHT, LENS, PHYSICS_HZ, TRUTH_HZ, WIDTH, Moving

import esaac
from esaac.newton import EventCameras
from esaac.on_warp import SubstepLog
from esaac.on_warp.frames import times_of

SENSOR = {"width": WIDTH, "height": HEIGHT, "contrast_on": 0.15, "contrast_off": 0.15}
COLUMNS = ("x", "y", "t_ns", "p")
WORLDS = 2


def cameras(moving, on_link=False, rate_hz=PHYSICS_HZ, **options):
    options = {"substep_s": 1 / rate_hz, "intrinsics": LENS, **SENSOR, **moving.mounted(on_link), **options}
    return EventCameras(moving.model, "dvs128", **options)


def on_host(column):
    return column if isinstance(column, np.ndarray) else column.numpy()


def events_of(packets, world):
    return tuple(
        np.concatenate([on_host(getattr(packet[world], name)) for packet in packets]) for name in COLUMNS
    )


def run(frame_hz, seconds, on_link, synthesis, **options):
    """Events of each world."""
    moving = Moving(WORLDS)
    physics_hz = max(PHYSICS_HZ, frame_hz)
    made, packets = cameras(moving, on_link, physics_hz, synthesis=synthesis, **options), []
    for frame in range(round(seconds * frame_hz) + 1):
        for substep in range(physics_hz * (frame - 1) // frame_hz, physics_hz * frame // frame_hz):
            if substep >= 0:
                made.record(moving.at(substep / physics_hz))
        state = moving.at(frame / frame_hz)
        packets.append(
            made.step(state) if synthesis != "motion" else stepped_with_motion(made, state, moving)
        )
    made.close()
    return [events_of(packets, world) for world in range(WORLDS)]


def stepped_with_motion(made, state, moving):
    """A step as of a renderer that gives motion vectors in place of depth and poses."""
    handed, step = {}, made.events.step

    def told(colour, *, t_ns, depth, ids, poses, stream):
        earlier = max(len(poses) - 1 - PHYSICS_HZ // FRAME_HZ, 0)
        images = depth.numpy(), ids.numpy()
        vectors = [
            predicted(poses, world, *(image[world] for image in images), earlier)[0] - PIXELS
            for world in range(moving.worlds)
        ]
        motion = wp.array(np.array(vectors, np.float32), device=colour.device)
        return step(colour, motion, t_ns=t_ns, stream=stream)

    made.events.step = told
    handed = made.step(state)
    made.events.step = step
    return handed


PIXELS = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), axis=-1).astype(float)


def turned(quaternion, points):
    x, w = quaternion[..., :3], quaternion[..., 3:]
    return points + 2 * np.cross(x, np.cross(x, points) + w * points)


def moved(pose, points):
    return turned(pose[..., 3:], points) + pose[..., :3]


def unmoved(pose, points):
    return turned(pose[..., 3:] * (-1, -1, -1, 1), points - pose[..., :3])


def predicted(poses, world, depth, ids, step):
    """Where the poses say each pixel's surface was at an earlier step: pixels, and points in the camera's axes."""
    fx, fy, cx, cy = LENS
    across, down = (PIXELS[..., 0] - cx) / fx, (PIXELS[..., 1] - cy) / fy
    points = moved(
        poses.camera[-1, world], depth[..., None] * np.stack([across, -down, -np.ones_like(down)], -1)
    )
    for number in range(poses.bodies.shape[2]):
        on = ids == number + 1
        points[on] = moved(
            poses.bodies[step, world, number], unmoved(poses.bodies[-1, world, number], points[on])
        )
    points = unmoved(poses.camera[step, world], points)
    pixels = np.stack(
        [cx - fx * points[..., 0] / points[..., 2], cy + fy * points[..., 1] / points[..., 2]], -1
    )
    return pixels, points


def drawn(moving, state, cameras, directions):
    """Albedo, distance and shape along rays `(height, width, 3)` of each world; Newton's own colours of a surface."""
    moving.model.bvh_refit_shapes(state)
    config = newton.sensors.SensorTiledCamera.RenderConfig(
        enable_textures=True, enable_backface_culling=False
    )
    sensor = newton.sensors.SensorTiledCamera(moving.model, default_render_config=config)
    images = []
    for world in range(moving.worlds):
        rays = np.zeros((1, HEIGHT, WIDTH, 2, 3), np.float32)
        rays[0, ..., 1, :] = directions[world] / np.linalg.norm(directions[world], axis=-1, keepdims=True)
        given = {
            "albedo_image": sensor.utils.create_albedo_image_output(WIDTH, HEIGHT),
            "depth_image": sensor.utils.create_depth_image_output(WIDTH, HEIGHT),
            "shape_index_image": sensor.utils.create_shape_index_image_output(WIDTH, HEIGHT),
        }
        places = wp.array(cameras[None], dtype=wp.transformf, device=moving.model.device)
        sensor.update(state, places, wp.array(rays, dtype=wp.vec3f, device=moving.model.device), **given)
        albedo, distance, shape = (array.numpy()[world, 0] for array in given.values())
        images.append(((albedo & 255).astype(float), distance, shape, rays[0, ..., 1, :].astype(float)))
    return images


def flat(depth):
    """Pixels whose neighbours are of the same plane: its inverse depth is linear in the image."""
    inverse, planar = 1 / depth.astype(float), np.zeros(depth.shape, bool)
    bends = [np.abs(np.diff(inverse, 2, axis=axis)) for axis in (0, 1)]
    planar[1:-1, 1:-1] = (bends[0][:, 1:-1] < 1e-4) & (bends[1][1:-1] < 1e-4)
    return planar


@pytest.mark.parametrize("on_link", [True, False])
def test_paths_are_within_a_fiftieth_of_a_pixel_of_where_newton_shows_them(on_link):
    moving, handed = Moving(WORLDS), {}
    made = cameras(moving, on_link)
    step = made.events.step
    made.events.step = lambda *arrays, **given: handed.update(given) or step(*arrays, **given)
    made.step(moving.at(0.0))
    for substep in range(8):
        made.record(moving.at(substep / PHYSICS_HZ))
    made.step(moving.at(8 / PHYSICS_HZ))
    poses, depth, ids = handed["poses"], handed["depth"].numpy(), handed["ids"].numpy()
    assert len(poses) == 9
    straight = [predicted(poses, world, depth[world], ids[world], -1)[1] for world in range(WORLDS)]
    last = drawn(moving, moving.at(8 / PHYSICS_HZ), poses.camera[-1], straight)
    away_px, across_px = [], 0.0
    for substep in range(9):
        there = [predicted(poses, world, depth[world], ids[world], substep)[1] for world in range(WORLDS)]
        now = drawn(moving, moving.at(substep / PHYSICS_HZ), poses.camera[substep], there)
        for world in range(WORLDS):
            albedo, distance, shape, rays = now[world]
            away = np.linalg.norm(rays * distance[..., None] - there[world], axis=-1)
            same = (shape == last[world][2]) & (away < 0.02)
            slopes = np.stack(np.gradient(last[world][0])[::-1], axis=-1)
            for number in np.unique(ids[world]):
                inner = same & (ids[world] == number) & flat(depth[world])
                away_px.append((away * LENS[0] / distance)[inner])
                shift, *_ = np.linalg.lstsq(slopes[inner], (albedo - last[world][0])[inner], rcond=None)
                across_px = max(across_px, float(np.linalg.norm(shift)))
    away_px = np.concatenate(away_px)
    # Beside an edge of the box, a few points are hidden by the box itself.
    hidden, furthest_px = np.mean(away_px > 0.02), np.quantile(away_px, 0.995)
    print(
        f"{len(away_px)} points: {furthest_px:.5f} px along a ray (99.5% of them; {100 * hidden:.2f}% are hidden), "
        f"{across_px:.5f} px across (mean of a surface)"
    )
    assert len(away_px) > 9 * WORLDS * 1500
    assert furthest_px < 0.02 and across_px < 0.02


@pytest.mark.parametrize("on_link", [True, False])
def test_events_agree_with_those_of_newton_rendered_at_960_hz(on_link, monkeypatch):
    """The bound is for this scene and the mean of its worlds. The truth is averaged of more rays than the frames, so
    that the frames' own noise counts against them."""
    monkeypatch.setattr(rigid_numpy, "WIDTH", WIDTH)
    seconds = 0.2
    truth = run(TRUTH_HZ, seconds, on_link, "linear", antialiasing=6)
    scores = {}
    for synthesis in ("rigid", "motion", "linear"):
        got = run(FRAME_HZ, seconds, on_link, synthesis)
        scores[synthesis] = [rigid_numpy.f1(events, expected) for events, expected in zip(got, truth)]
    where = "on a link that shakes" if on_link else "still"
    told = {name: [round(score, 3) for score in each] for name, each in scores.items()}
    print(f"camera {where}, {[len(t[0]) for t in truth]} events: F1 within 1 ms {told}")
    assert np.mean(scores["rigid"]) >= 0.85
    assert min(scores["rigid"]) > max(scores["motion"] + scores["linear"])


EXACT_S = 0.004
"""A substep in whole nanoseconds, so that the same episode has the same intervals at any time."""


def test_an_episode_after_a_reset_is_a_fresh_run_bit_for_bit():
    # Resets at least, at random: ESAAC_RESETS=1000 makes as many, which takes minutes.
    wanted = int(os.environ.get("ESAAC_RESETS", "50"))
    moving, random = Moving(4), np.random.default_rng(7)
    frames, per_frame = 40, 8
    made = cameras(moving, substep_s=EXACT_S, profile="noisy")
    fresh = cameras(moving, substep_s=EXACT_S, profile="noisy")
    expected, begun, resets = [], np.zeros(4, int), 0
    for frame in range(frames):
        for substep in range(per_frame if frame else 0):
            fresh.record(moving.at((per_frame * (frame - 1) + substep) * EXACT_S))
        expected.append(fresh.step(moving.at(per_frame * frame * EXACT_S)))
    frame = 0
    while resets < wanted:
        for substep in range(per_frame if frame else 0):
            made.record(moving.at((per_frame * (frame - 1 - begun) + substep) * EXACT_S))
        packet = made.step(moving.at(per_frame * (frame - begun) * EXACT_S))
        for world in range(4):
            reference = expected[frame - begun[world]][world]
            shift_ns = round(per_frame * begun[world] * EXACT_S * 1e9)
            for name in ("x", "y", "p"):
                columns = [on_host(getattr(one, name)) for one in (packet[world], reference)]
                np.testing.assert_array_equal(*columns)
            np.testing.assert_array_equal(on_host(packet[world].t_ns) - shift_ns, on_host(reference.t_ns))
        # The fresh run is not longer.
        ends = (random.random(4) < 0.3) | (frame - begun == frames - 1)
        again = np.flatnonzero(ends)
        if len(again):
            begun[again] = frame
            made.reset(again)
            # The first frame of the new episode, of these worlds alone.
            assert len(made.step(moving.at(per_frame * (frame - begun) * EXACT_S), worlds=again)) == 0
            resets += len(again)
        frame += 1
    assert sum(len(packet) for packet in expected) > 7_000


def test_memory_stays_where_it_is():
    """Over 10,000 steps with ESAAC_STEPS=10000, which takes minutes."""
    moving, steps = Moving(2), int(os.environ.get("ESAAC_STEPS", "400"))
    made = cameras(moving, width=16, height=12, intrinsics=(20, 20, 7.5, 5.5), antialiasing=1, limit=16)

    def resident():
        gc.collect()
        with open("/proc/self/statm") as statm:
            return int(statm.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    def step(first, count):
        sent = 0
        for index in range(first, first + count):
            for substep in range(2 if index else 0):
                made.record(moving.at(0.01 * ((index + substep / 2 - 1) % 30)))
            if index % 30 == 0:
                made.reset()
            sent += len(made.step(moving.at(0.01 * (index % 30))))
            made.events.event_frames()
        return sent

    # Buffers grow in the first episodes.
    assert step(0, 150) > 500
    before, uses = resident(), made.events.memory()
    step(150, steps)
    assert resident() - before < 4 << 20
    assert made.events.memory() == uses


def test_a_reset_that_is_not_read_begins_with_the_next_frame():
    moving, per_frame = Moving(2), 8
    made, fresh = (cameras(moving, substep_s=EXACT_S, profile="noisy") for _ in range(2))

    def interval(to, substeps):
        for substep in substeps:
            to.record(moving.at(substep * EXACT_S))
        return to.step(moving.at((substeps[-1] + 1) * EXACT_S))

    made.step(moving.at(0))
    interval(made, range(per_frame))
    # World 1 begins anew, and nobody asks for its first frame until three substeps have passed.
    made.reset([1])
    for substep in range(per_frame, per_frame + 3):
        made.record(moving.at(substep * EXACT_S))
    assert len(made.step(moving.at((per_frame + 3) * EXACT_S), worlds=[1])) == 0
    fresh.step(moving.at((per_frame + 3) * EXACT_S))
    late = interval(made, range(per_frame + 3, 2 * per_frame))
    expected = interval(fresh, range(per_frame + 3, 2 * per_frame))
    assert len(late[1]) > 100 and len(late[0]) > len(expected[0])
    late, expected = (
        {name: on_host(getattr(packets[1], name)) for name in COLUMNS} for packets in (late, expected)
    )
    late["t_ns"] = late["t_ns"] - round((per_frame + 3) * EXACT_S * 1e9)
    for name in COLUMNS:
        np.testing.assert_array_equal(late[name], expected[name])


def test_worlds_that_wait_have_no_time():
    t_ns = 33_000_000
    assert times_of(np.array([True, True]), t_ns) == t_ns
    assert times_of(np.array([True, False, True]), t_ns) == [t_ns, None, t_ns]
    assert times_of(np.array([False]), t_ns) == [None]


def test_wrong_arguments_are_told():
    moving = Moving(2)
    for wrong, message in (
        ({"substep_s": 0}, "substep_s is 0, expected seconds above 0"),
        ({"substep_s": np.inf}, "substep_s is inf, expected seconds above 0"),
        ({"antialiasing": 2.5}, "antialiasing is 2.5, expected a whole number from 1 to 8"),
        ({"limit": 0}, "limit is 0, expected at least 1"),
        ({"bodies": 4}, "bodies are 4, expected -1 to 3"),
        (
            {"bodies": [0, 1, 2]},
            r"bodies are \[0, 1, 2\], expected a number of a body, or one for each world",
        ),
        ({"bodies": [2, 1]}, "camera of world 0 is on body 2 of world 1, expected one of its own world"),
        ({"bodies": 1}, "camera of world 1 is on body 1 of world 0, expected one of its own world"),
        ({"intrinsics": None}, "intrinsics are None, expected Intrinsics"),
        ({"places": np.zeros((3, 7))}, r"places have shape \(3, 7\), expected \(7,\) or \(2, 7\)"),
    ):
        with pytest.raises(esaac.ArgumentError, match=message):
            cameras(moving, **wrong)
    made = cameras(moving)
    with pytest.raises(
        AttributeError, match="EventCameras has no attribute `wordls`; parameters are changed"
    ):
        made.wordls = [0]
    for wrong, message in (
        ([2], "world is 2, expected a number from 0 to 1"),
        ([-1], "world is -1, expected"),
        ([0.5], "world is 0.5, expected"),
        ([True], "mask of worlds has 1 entries, expected 2"),
    ):
        with pytest.raises(esaac.ArgumentError, match=message):
            made.step(moving.at(0), worlds=wrong)
    other = Moving(3).at(0)
    for call in (made.record, made.step):
        with pytest.raises(esaac.ArgumentError, match="the state has 6 bodies, expected 4, those of the cam"):
            call(other)
    made.step(moving.at(0))
    made.record(moving.at(0))
    packet = made.step(moving.at(1 / PHYSICS_HZ), worlds=np.array([False, True]))
    assert len(packet[0]) == 0 < len(packet[1])
    made.close()
    made.close()
    for call in (lambda: made.record(moving.at(0)), lambda: made.step(moving.at(0)), made.reset):
        with pytest.raises(esaac.ClosedError, match="the cameras are closed"):
            call()


def test_substeps_that_are_lost_are_told():
    moving = Moving(1)
    made = cameras(moving, limit=10)
    made.step(moving.at(0))
    with pytest.raises(esaac.ArgumentError, match="has had its frame at substep 0, expected record"):
        made.step(moving.at(0))
    for substep in range(11):
        made.record(moving.at(substep / PHYSICS_HZ))
    with pytest.raises(esaac.FrameError, match="11 substeps since the last frame, expected at most 10"):
        made.step(moving.at(11 / PHYSICS_HZ))


def test_what_is_sent_for_is_what_is_read():
    moving = Moving(3)
    model, state = moving.model, moving.model.state()
    log = SubstepLog(model, 1e-3, limit=7)
    other = wp.array([3.0, 4.0], dtype=wp.float32, device=model.device)
    for now in range(20):
        for first in range(max(0, now - 7), now + 1):
            asked = log.ask(first, now, state, [other])
            steps, states = log.since(first, now, state)
            got_steps, got_states = asked.since(int(steps[0]))
            assert asked.now == now and (asked.others[0] == [3, 4]).all()
            assert (got_steps == steps).all() and (got_states == states).all() and len(steps) == len(states)
            assert asked.since(int(steps[0]) + 1) is None
        # More substeps than were expected.
        assert now == 0 or log.ask(now - 1, now - 1, state).since(max(0, now - 3)) is None
        log.record(state)
        state.body_q.assign(np.random.default_rng(now).random((model.body_count, 7), np.float32))


def test_what_hits_nothing_has_the_background_and_turns_with_the_camera():
    moving = Moving(1)
    behind = worlds.STILL.copy()
    behind[3:] = (0, 1, 0, 0)
    behind[:3] = moving.origins[0]
    made = cameras(moving, places=behind, background=(0.1, 0.2, 0.3))
    made.step(moving.at(0))
    np.testing.assert_allclose(made.view.colour.numpy()[0, 5, 5], (0.1, 0.2, 0.3), rtol=1e-6)
    assert not made.view.depth.numpy().any() and not made.view.ids.numpy().any()


def test_averaging_draws_an_edge_between_two_pixels():
    moving = Moving(1)
    edges, one_ray = {}, None
    for antialiasing in (1, 2, 3):
        made = cameras(moving, antialiasing=antialiasing)
        made.step(moving.at(0.05))
        edges[antialiasing] = made.view.colour.numpy()[0, ..., 0]
        depths = made.view.depth.numpy()
        if antialiasing > 1:
            # Depth is that of the pixel's middle, however many rays its colour has.
            np.testing.assert_allclose(depths, one_ray, rtol=1e-5)
            assert np.abs(edges[antialiasing] - edges[1]).max() > 0.02
        one_ray = depths if one_ray is None else one_ray
    with pytest.raises(esaac.ArgumentError, match="antialiasing is 0, expected a whole number from 1 to 8"):
        cameras(moving, antialiasing=0)
    fisheye = esaac.Intrinsics(*LENS, "fisheye")
    with pytest.raises(esaac.ArgumentError, match="expected `pinhole`"):
        cameras(moving, intrinsics=fisheye)
    with pytest.raises(esaac.ArgumentError, match=r"places have shape \(6,\), expected \(7,\) or \(1, 7\)"):
        cameras(moving, places=np.zeros(6))
