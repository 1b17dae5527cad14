"""Synthesis `rigid`: depth, ids and poses, whatever library, order, axes and rate they come in."""

import pathlib
import sys

import numpy as np
import pytest
from conftest import FRAME_NS, assert_same, bars, join

import esaac

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "scripts"))

import rigid_numpy as scene

WIDTH, HEIGHT = 40, 24
FRAMES, STEPS = 4, 8
"""Frames of a run, and physics steps a frame."""
# The middle of the image that the scene renders is the middle of the lens.
LENS = esaac.Intrinsics(scene.FOCAL_PX, scene.FOCAL_PX, (WIDTH - 1) / 2, (HEIGHT - 1) / 2)


def camera(**options):
    options = {"intrinsics": LENS, "synthesis": "rigid", **options}
    return esaac.EventCamera("dvs128", **SENSOR, **options)


SENSOR = {"width": WIDTH, "height": HEIGHT, "contrast_on": 0.1, "contrast_off": 0.1}


def box_pose(shift_s=0.0):
    return lambda t: scene.box_pose(t + shift_s)


def frame(index, shift_s=0.0):
    """Colour, depth and ids; the box is ahead of its time by `shift_s`."""
    return scene.render(index * FRAME_NS * 1e-9, WIDTH, HEIGHT, samples=1, box=box_pose(shift_s))


IMAGES = [frame(index) for index in range(FRAMES)]
TIMES_NS = np.arange(-STEPS, (FRAMES + 1) * STEPS) * FRAME_NS // STEPS


def numbers(shift_s=0.0):
    """Poses of the camera and of the box at all physics steps."""
    camera_poses = np.stack([scene.camera_pose(t) for t in TIMES_NS * 1e-9])
    return camera_poses, np.stack([scene.box_pose(t + shift_s) for t in TIMES_NS * 1e-9])[:, None]


CAMERA, BODIES = numbers()


def run(cam, poses=None, images=IMAGES, change=lambda array: array, **given):
    poses = esaac.Poses(TIMES_NS, CAMERA, BODIES) if poses is None else poses
    packets = []
    for index, (hdr, depth, ids) in enumerate(images):
        arrays = {"depth": change(depth), "ids": change(ids), **given}
        packets.append(cam.step(change(hdr), t_ns=index * FRAME_NS, poses=poses, **arrays))
    return join(packets)


@pytest.fixture(scope="module")
def expected():
    return run(camera())


def test_auto_takes_the_best_that_the_input_allows(expected):
    cam = camera(synthesis="auto")
    assert cam.synthesis is None
    assert_same(run(cam), expected)
    assert cam.synthesis == "rigid" and cam.sensor.synthesis == "auto"
    for motion, synthesis in ((bars(WIDTH, HEIGHT, 0)[1], "motion"), (None, "linear")):
        cam = camera(synthesis="auto")
        cam.step(IMAGES[0][0], motion, t_ns=0)
        assert cam.synthesis == synthesis
    rig = esaac.Rig([esaac.SensorModel("dvs128", synthesis="auto", **SENSOR)])
    assert rig.syntheses == [None]


def test_arrays_of_any_kind_give_the_same_events(expected):
    import warp as wp

    wp.config.quiet = True
    changes = {
        "with an axis of channels": lambda array: array.reshape(HEIGHT, WIDTH, -1),
        "columns first": np.asfortranarray,
        "negative strides": lambda array: array[::-1].copy()[::-1],
        "memoryview": memoryview,
        "warp": lambda array: wp.array(array, device="cpu"),
    }
    for what, change in changes.items():
        actual = run(camera(), change=change)
        assert len(actual[0]) == len(expected[0]), what
        assert_same(actual, expected)


@pytest.mark.parametrize("dtype", [np.uint16, np.int16, np.int32])
def test_ids_of_other_types_are_the_same_ids(expected, dtype):
    images = [(hdr, depth, ids.astype(dtype)) for hdr, depth, ids in IMAGES]
    assert_same(run(camera(), images=images), expected)


def product(a, b):
    """Of quaternions x y z w."""
    x, y, z, w = np.moveaxis(a, -1, 0)
    turned = np.array([[w, -z, y, x], [z, w, -x, y], [-y, x, w, z], [-x, -y, -z, w]])
    return np.moveaxis(turned, -1, 0) @ np.asarray(b, float)


@pytest.mark.parametrize(
    ("axes", "right", "up", "back"),
    [
        ("usd", (1, 0, 0), (0, 1, 0), (0, 0, 1)),
        ("opengl", (1, 0, 0), (0, 1, 0), (0, 0, 1)),
        ("ros", (1, 0, 0), (0, -1, 0), (0, 0, -1)),
        ("opencv", (1, 0, 0), (0, -1, 0), (0, 0, -1)),
        ("world", (0, -1, 0), (0, 0, 1), (-1, 0, 0)),
    ],
)
def test_axes_of_a_camera_are_what_their_names_say(axes, right, up, back):
    poses = esaac.Poses(TIMES_NS, CAMERA, axes=axes)
    for given, brought in zip(CAMERA, poses.camera[:, 0]):
        # What the camera calls right, up and back is where it says that these are.
        ours = scene.matrix(given[3:]) @ np.array([right, up, back], float).T
        np.testing.assert_allclose(scene.matrix(brought[3:]), ours, atol=1e-12)
        np.testing.assert_array_equal(brought[:3], given[:3])


def test_order_and_axes_make_no_difference_to_events(expected):
    first = [0, 1, 2, 6, 3, 4, 5]
    scalar_first = esaac.Poses(TIMES_NS, CAMERA[:, first], BODIES[..., first], order="wxyz")
    assert_same(run(camera(), scalar_first), expected)
    # The same camera in optical axes: turned by half a turn about x.
    optical = CAMERA.copy()
    optical[:, 3:] = product(CAMERA[:, 3:], (-1, 0, 0, 0))
    assert_same(run(camera(), esaac.Poses(TIMES_NS, optical, BODIES, axes="ros")), expected)


def test_tables_say_which_body_an_id_is(expected):
    still = np.zeros_like(BODIES) + [9, 9, 9, 0, 0, 0, 1]
    two = np.concatenate([still, BODIES], axis=1)
    for ids in ({1: 1}, {0: -1, 1: 1, 7: 0}, [-1, 1], np.array([-1, 1, 0, -1]), [{1: 1, 8: None}]):
        poses = esaac.Poses(TIMES_NS, CAMERA, two, ids=ids)
        assert_same(run(camera(), poses), expected)


def test_float32_poses_are_nearly_the_same(expected):
    poses = esaac.Poses(TIMES_NS.tolist(), CAMERA.astype(np.float32), BODIES.astype(np.float32))
    x, *_ = run(camera(), poses)
    assert abs(len(x) - len(expected[0])) < 0.01 * len(expected[0])


def test_a_recorder_hands_out_what_spans_each_interval_and_forgets_the_rest(expected):
    recorder, cam, packets, taken = esaac.PoseRecorder(ids={1: 0}), camera(), [], 0
    body = np.empty((1, 7))
    for index, (hdr, depth, ids) in enumerate(IMAGES):
        while TIMES_NS[taken] <= index * FRAME_NS + 2 * FRAME_NS // STEPS:
            body[:] = BODIES[taken]
            recorder.record(int(TIMES_NS[taken]), CAMERA[taken], body)
            taken += 1
        # The simulator's memory is its own again.
        body[:] = np.nan
        packets.append(cam.step(hdr, t_ns=index * FRAME_NS, depth=depth, ids=ids, poses=recorder))
        assert len(recorder) == 5
    assert_same(join(packets), expected)
    recorder.clear()
    assert len(recorder) == 0


def test_a_recorder_is_bounded_and_forgives_clocks_of_floats():
    recorder = esaac.PoseRecorder(limit=20, tolerance_ns=1000)
    for step in range(200):
        recorder.record(step * 1_000_000 + 3, CAMERA[0], BODIES[0])
    assert len(recorder) == 20
    poses = recorder.spanning(190_000_000, 199_000_900)
    assert poses.times_ns[[0, -1]].tolist() == [187_000_003, 199_000_900] and len(poses) == 13
    for span in ((179_000_000, 190_000_000), (190_000_000, 199_002_000)):
        with pytest.raises(
            esaac.FrameError, match="recorded from 180000003 to 199000003 ns, expected them to span"
        ):
            recorder.spanning(*span)
    with pytest.raises(esaac.FrameError, match="expected a time after 199000003 ns"):
        recorder.record(5, CAMERA[0], BODIES[0])
    with pytest.raises(esaac.FrameError, match=r"shapes \(\(7,\), None\), expected \(\(7,\), \(1, 7\)\)"):
        recorder.record(200_000_000, CAMERA[0])
    with pytest.raises(esaac.FrameError, match="no poses are recorded"):
        esaac.PoseRecorder().spanning(0, 1)
    with pytest.raises(esaac.ArgumentError, match="limit is 2"):
        esaac.PoseRecorder(limit=2)


def test_a_recorder_takes_whole_nanoseconds_alone():
    recorder = esaac.PoseRecorder()
    for wrong in (0.5, 1e6, np.float64(3), "4"):
        with pytest.raises(TypeError, match="t_ns is .*, expected an integer, nanoseconds"):
            recorder.record(wrong, CAMERA[0])
    with pytest.raises(esaac.ArgumentError, match="t_ns is 9223372036854775808, expected"):
        recorder.record(1 << 63, CAMERA[0])
    recorder.record(np.int32(5), CAMERA[0])
    assert recorder.spanning(5, 5).times_ns.tolist() == [5]


def test_times_are_a_copy():
    times_ns = TIMES_NS.copy()
    poses = esaac.Poses(times_ns, CAMERA)
    times_ns[:] = 0
    np.testing.assert_array_equal(poses.times_ns, TIMES_NS)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"camera": CAMERA[:-1, None]}, r"camera has shape \[47, 1, 7\], expected 48 steps as times_ns"),
        ({"camera": CAMERA[:, None, :6].copy()}, r"camera has shape \[48, 1, 6\], .* and 7 numbers a pose"),
        ({"bodies": BODIES[:1, None]}, r"bodies has shape \[1, 1, 1, 7\], expected 48 steps"),
        ({"times_ns": TIMES_NS[1:]}, r"camera has shape \[48, 1, 7\], expected 47 steps"),
        ({"tables": [(np.arange(3, dtype=np.uint32), np.arange(1))]}, "bodies for 1 ids, expected 3"),
    ],
)
def test_poses_that_were_changed_are_checked_again(changes, message):
    poses = esaac.Poses(TIMES_NS, CAMERA, BODIES)
    for name, value in changes.items():
        setattr(poses, name, value)
    with pytest.raises(esaac.FrameError, match=message):
        camera().step(HDR, t_ns=0, depth=DEPTH, ids=IDS, poses=poses)


def test_bodies_that_come_later_stood_still_before():
    recorder = esaac.PoseRecorder()
    for step in range(6):
        recorder.record(step, CAMERA[step], None if step < 2 else BODIES[[step] * (1 if step < 4 else 2), 0])
    bodies = recorder.spanning(0, 5).bodies[:, 0]
    np.testing.assert_array_equal(bodies[:, 0], BODIES[[2, 2, 2, 3, 4, 5], 0])
    np.testing.assert_array_equal(bodies[:, 1], BODIES[[4, 4, 4, 4, 4, 5], 0])


SHIFTS_S = (0.0, 0.05, 0.11)


def tiled():
    """Three environments whose boxes are at other places: images of all, poses of all."""
    frames = [[frame(index, shift_s) for shift_s in SHIFTS_S] for index in range(FRAMES)]
    stacked = [tuple(np.stack(planes) for planes in zip(*each)) for each in frames]
    cameras, bodies = zip(*map(numbers, SHIFTS_S))
    return frames, stacked, np.stack(cameras, axis=1), np.stack(bodies, axis=1)


def test_environments_give_what_cameras_alone_give():
    frames, stacked, cameras, bodies = tiled()
    sensor = esaac.SensorModel("dvs128", synthesis="rigid", **SENSOR)
    with esaac.TiledEventCamera(sensor, 3, intrinsics=LENS) as envs:
        packets = [
            envs.step(
                hdr, t_ns=index * FRAME_NS, depth=depth, ids=ids, poses=esaac.Poses(TIMES_NS, cameras, bodies)
            )
            for index, (hdr, depth, ids) in enumerate(stacked)
        ]
        assert envs.synthesis == "rigid"
    # The same with bodies of all environments in one array, and a table for each.
    together = bodies.reshape(len(TIMES_NS), 3, 7)
    recorder = esaac.PoseRecorder(ids=[{1: 0}, {1: 1}, {1: 2}])
    for t_ns, poses, places in zip(TIMES_NS, cameras, together):
        recorder.record(t_ns, poses, places)
    with esaac.TiledEventCamera(sensor, 3, intrinsics=LENS) as envs:
        again = [
            envs.step(hdr, t_ns=[index * FRAME_NS] * 3, depth=depth, ids=ids, poses=recorder)
            for index, (hdr, depth, ids) in enumerate(stacked)
        ]
    rig = esaac.Rig([sensor] * 3, intrinsics=[LENS] * 3)
    apart = [esaac.Poses(TIMES_NS, cameras[:, env], bodies[:, env]) for env in range(3)]
    ticks = [
        rig.step([(hdr, None, depth, ids) for hdr, depth, ids in each], index * FRAME_NS, poses=apart)
        for index, each in enumerate(frames)
    ]
    for env in range(3):
        alone = run(camera(), apart[env], [each[env] for each in frames])
        assert_same(join([packet[env] for packet in packets]), alone)
        assert_same(join([packet[env] for packet in again]), alone)
        assert_same(join([tick[env] for tick in ticks]), alone)


def test_an_environment_that_is_reset_does_not_follow_what_moved_it():
    _, stacked, cameras, bodies = tiled()
    sensor = esaac.SensorModel("dvs128", synthesis="rigid", **SENSOR)

    def last(cameras, bodies, reset):
        recorder = esaac.PoseRecorder()
        for t_ns, poses, places in zip(TIMES_NS, cameras, bodies):
            recorder.record(t_ns, poses, places)
        with esaac.TiledEventCamera(sensor, 3, intrinsics=LENS) as envs:
            for index, (hdr, depth, ids) in enumerate(stacked):
                if index == reset:
                    envs.reset([1])
                packet = envs.step(hdr, t_ns=index * FRAME_NS, depth=depth, ids=ids, poses=recorder)
            return packet

    # Until its reset, environment 1 was elsewhere.
    elsewhere, moved = cameras.copy(), bodies.copy()
    before = TIMES_NS < 2 * FRAME_NS
    elsewhere[before, 1, :3] += 50
    moved[before, 1, :, :3] += 70
    plain, teleported = last(cameras, bodies, 2), last(elsewhere, moved, 2)
    assert len(plain[1]) > 100
    np.testing.assert_array_equal(plain[0].t_ns, teleported[0].t_ns)
    # Velocities near the reset come of fewer samples. That they come of none before it shows in what is not moved.
    begun = TIMES_NS >= 2 * FRAME_NS
    fresh = run_one(sensor, stacked, cameras[begun][:, 1], bodies[begun][:, 1])
    np.testing.assert_array_equal(teleported[1].t_ns, fresh.t_ns)
    np.testing.assert_array_equal(teleported[1].x, fresh.x)


def run_one(sensor, stacked, cameras, bodies):
    """The last packet of environment 1, which begins with its third frame."""
    cam = esaac.EventCamera(sensor, intrinsics=LENS)
    poses = esaac.Poses(TIMES_NS[TIMES_NS >= 2 * FRAME_NS], cameras, bodies)
    for index in (2, 3):
        hdr, depth, ids = (plane[1] for plane in stacked[index])
        packet = cam.step(hdr, t_ns=index * FRAME_NS, depth=depth, ids=ids, poses=poses)
    return packet


def test_a_saved_run_goes_on_as_one(expected):
    first, poses = camera(), esaac.Poses(TIMES_NS, CAMERA, BODIES)
    step = lambda cam, index: cam.step(
        IMAGES[index][0], t_ns=index * FRAME_NS, depth=IMAGES[index][1], ids=IMAGES[index][2], poses=poses
    )
    packets = [step(first, index) for index in range(2)]
    state, second = first.save(), camera()
    second.restore(state)
    assert_same(join(packets + [step(second, index) for index in range(2, FRAMES)]), expected)
    with pytest.raises(esaac.ArgumentError, match="with depth, expected cameras made with intrinsics="):
        camera(intrinsics=None).restore(state)
    with pytest.raises(esaac.ArgumentError, match="format b'ESAACPY1', expected b'ESAACPY4'"):
        second.restore(b"ESAACPY1" + state[8:])


def test_lenses_are_told_in_several_ways(expected):
    corner = (scene.FOCAL_PX, scene.FOCAL_PX, WIDTH / 2, HEIGHT / 2)
    matrix = np.array([[corner[0], 0, corner[2]], [0, corner[1], corner[3]], [0, 0, 1]], np.float32)
    for lens in (
        (LENS.fx, LENS.fy, LENS.cx, LENS.cy),
        esaac.Intrinsics(*corner, half_pixel_centres=True),
        esaac.Intrinsics.from_matrix(matrix, half_pixel_centres=True),
    ):
        assert_same(run(camera(intrinsics=lens)), expected)
    lengths = LENS.ray_lengths(WIDTH, HEIGHT)
    x, y = (7 - LENS.cx) / LENS.fx, (3 - LENS.cy) / LENS.fy
    np.testing.assert_allclose(lengths[3, 7], np.sqrt(1 + x * x + y * y), rtol=1e-6)
    fisheye = esaac.Intrinsics(30.0, 30.0, 19.5, 11.5, "fisheye")
    assert (fisheye.ray_lengths(WIDTH, HEIGHT) == 1).all()
    assert len(run(camera(intrinsics=fisheye))[0]) > 100
    for wrong, message in (
        ((1, 2, 3), "expected Intrinsics or"),
        ((0, 20, 3, 4), "focal length fx is 0 px, expected a positive number"),
        (esaac.Intrinsics(20, 20, 3, 4, "mirror"), "projection is `mirror`, expected `pinhole` or `fisheye`"),
    ):
        with pytest.raises(esaac.ArgumentError, match=message):
            camera(intrinsics=wrong)
    with pytest.raises(esaac.ArgumentError, match=r"shape \(2, 2\), expected \(3, 3\)"):
        esaac.Intrinsics.from_matrix(np.eye(2))
    with pytest.raises(esaac.ArgumentError, match="expected \\[\\[fx, 0, cx\\]"):
        esaac.Intrinsics.from_matrix(np.ones((3, 3)))


def test_pixels_without_a_path_are_counted():
    cam = camera()
    hdr, depth, ids = (plane.copy() for plane in IMAGES[1])
    depth[0, :3] = (np.nan, -1, np.inf)
    ids[5, :4] = 77
    poses = esaac.Poses(TIMES_NS, CAMERA, BODIES)
    cam.step(hdr, t_ns=0, depth=depth, ids=ids, poses=poses)
    cam.step(hdr, t_ns=FRAME_NS, depth=depth, ids=ids, poses=poses)
    counts = cam.statistics
    assert (counts["without_depth"], counts["without_poses"], counts["without_lens"]) == (2, 4, 0)
    assert {"input depth", "input ids"} <= {use["purpose"] for use in cam.memory()}


def changed(array, at, value):
    array = array.copy()
    array[at] = value
    return array


@pytest.mark.parametrize(
    ("poses", "message"),
    [
        (
            (TIMES_NS, changed(CAMERA, (3, 6), 2.0), BODIES),
            "poses: camera, step 3: the quaternion has length",
        ),
        (
            (TIMES_NS, changed(CAMERA, (3, slice(3, 7)), 0.0), BODIES),
            "camera, step 3: the quaternion has length 0, expected 1",
        ),
        ((TIMES_NS, changed(CAMERA, (3, 4), np.nan), BODIES), "camera, step 3: qy is NaN, expected a finite"),
        (
            (TIMES_NS, CAMERA, changed(BODIES, (5, 0, 0), np.inf)),
            "body 0, step 5: x is inf, expected a finite",
        ),
        ((TIMES_NS[::-1], CAMERA, BODIES), "pose 1 is at .* ns, expected after pose 0 at"),
        ((changed(TIMES_NS, 4, TIMES_NS[3]), CAMERA, BODIES), "pose 4 is at .* ns, expected after pose 3 at"),
        (
            (TIMES_NS[STEPS + 1 :], CAMERA[STEPS + 1 :], BODIES[STEPS + 1 :]),
            "expected them to span 0 to 0 ns",
        ),
        ((TIMES_NS, CAMERA[:, None].repeat(2, 1), BODIES), "poses have 2 cameras, expected 1"),
        ((TIMES_NS, CAMERA, BODIES[:, None].repeat(2, 1)), "poses have 2 environments, expected 1"),
    ],
)
def test_wrong_poses_are_named(expected, poses, message):
    hdr, depth, ids = IMAGES[0]
    cam, unmoved = camera(), camera(synthesis="linear")
    # Poses that nothing follows must be right too.
    for each in (cam, unmoved):
        with pytest.raises(esaac.FrameError, match=message):
            each.step(hdr, t_ns=0, depth=depth, ids=ids, poses=esaac.Poses(*poses))
    # Nothing was seen.
    assert_same(run(cam), expected)


def test_poses_must_reach_the_frame_and_the_camera_waits_for_them(expected):
    cam, packets = camera(), []
    for index, (hdr, depth, ids) in enumerate(IMAGES):
        reach = TIMES_NS < index * FRAME_NS
        short = esaac.Poses(TIMES_NS[reach], CAMERA[reach], BODIES[reach])
        with pytest.raises(esaac.FrameError, match=f"expected them to span .* to {index * FRAME_NS} ns"):
            cam.step(hdr, t_ns=index * FRAME_NS, depth=depth, ids=ids, poses=short)
        with pytest.raises(esaac.FrameError, match="no poses, expected poses= at every step"):
            cam.step(hdr, t_ns=index * FRAME_NS, depth=depth, ids=ids)
        poses = esaac.Poses(TIMES_NS, CAMERA, BODIES)
        packets.append(cam.step(hdr, t_ns=index * FRAME_NS, depth=depth, ids=ids, poses=poses))
    assert_same(join(packets), expected)


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((TIMES_NS, CAMERA[:-1]), {}, r"camera has shape \(47, 7\), expected \(steps, 7\) or .*the 48 steps"),
        ((TIMES_NS, CAMERA[:, :6]), {}, r"camera has shape \(48, 6\), expected \(steps, 7\)"),
        ((TIMES_NS, CAMERA.astype(object)), {}, "camera has dtype object, expected float32 or float64"),
        ((TIMES_NS, CAMERA, BODIES[0]), {}, r"bodies has shape \(1, 7\), expected \(steps, bodies, 7\)"),
        ((TIMES_NS * 1e-9, CAMERA), {}, "times_ns has .* dtype float64, expected .* int64, nanoseconds"),
        ((TIMES_NS[:0], CAMERA[:0]), {}, r"times_ns has shape \(0,\)"),
        (
            (np.array([5, 1 << 63], np.uint64), CAMERA[:2]),
            {},
            "times_ns has 9223372036854775808 ns, expected at most 9223372036854775807",
        ),
        ((TIMES_NS, CAMERA, BODIES), {"order": "wzyx"}, "order is `wzyx`, expected one of xyzw, wxyz"),
        ((TIMES_NS, CAMERA, BODIES), {"axes": "unity"}, "axes are `unity`, expected one of usd, opengl, ros"),
        ((TIMES_NS, CAMERA, BODIES), {"ids": {-3: 0}}, "id -3, expected 0 to 4294967295"),
        ((TIMES_NS, CAMERA, BODIES), {"ids": {1: 0.5}}, "expected a number of a body for each id"),
    ],
)
def test_arrays_that_are_no_poses_are_named_when_they_are_given(arguments, options, message):
    with pytest.raises((esaac.FrameError, esaac.ArgumentError), match=message):
        esaac.Poses(*arguments, **options)


@pytest.mark.parametrize(
    ("ids", "message"),
    [
        ({1: 3}, "id 1 is body 3, expected less than 1, or -1 for the static world"),
        ({0: 0}, "instance 0 has poses, but 0 is the static world; expected ids from 1"),
        ([{1: 0}, {1: 0}], "poses have 2 tables of ids, expected 1"),
    ],
)
@pytest.mark.parametrize("synthesis", ["rigid", "linear"])
def test_wrong_tables_are_named(ids, message, synthesis):
    hdr, depth, given = IMAGES[0]
    with pytest.raises(esaac.FrameError, match=message):
        camera(synthesis=synthesis).step(
            hdr, t_ns=0, depth=depth, ids=given, poses=esaac.Poses(TIMES_NS, CAMERA, BODIES, ids=ids)
        )


def test_poses_that_were_not_followed_are_once_the_camera_does():
    cam, other, poses = camera(synthesis="linear"), camera(), esaac.Poses(TIMES_NS, CAMERA, BODIES)
    hdr, depth, ids = IMAGES[0]
    for each in (cam, other):
        each.step(hdr, t_ns=0, depth=depth, ids=ids, poses=poses)
    # The change makes the next frame the first.
    cam.sensor = cam.sensor.replace(synthesis="rigid")
    other.reset()
    assert_same(run(cam), run(other))


HDR, DEPTH, IDS = IMAGES[0]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"depth": DEPTH.astype(np.float64)}, "depth has dtype <f8, expected float32"),
        ({"depth": DEPTH[:-1]}, r"depth has shape \[23, 40\], expected \(24, 40\)"),
        ({"depth": None}, "ids without depth, expected both"),
        ({"depth": None, "ids": None}, "poses without depth, expected both"),
        ({"depth": None, "ids": None, "poses": None}, "`rigid` needs depth, a lens and poses"),
        ({"ids": IDS.astype(np.int64)}, "ids has dtype <i8, expected uint16, uint32, int16 or int32"),
        ({"ids": IDS[..., None].repeat(2, 2)}, r"ids has shape \[24, 40, 2\], expected \(24, 40\)"),
    ],
)
def test_wrong_depth_and_ids_are_named(given, message):
    arguments = {"depth": DEPTH, "ids": IDS, "poses": esaac.Poses(TIMES_NS, CAMERA, BODIES), **given}
    with pytest.raises(esaac.FrameError, match=message):
        camera().step(HDR, t_ns=0, **arguments)
    if given.get("depth") is not None:
        with pytest.raises(esaac.FrameError, match=f"depth without a lens|{message}"):
            camera(intrinsics=None).step(HDR, t_ns=0, **arguments)


def test_later_frames_have_depth_and_ids_as_the_first():
    cam, poses = camera(), esaac.Poses(TIMES_NS, CAMERA, BODIES)
    cam.step(HDR, t_ns=0, depth=DEPTH, ids=IDS, poses=poses)
    with pytest.raises(esaac.FrameError, match="with depth, expected f32 colour .* with depth and U32 ids"):
        cam.step(HDR, t_ns=FRAME_NS, depth=DEPTH, poses=poses)
    with pytest.raises(
        esaac.FrameError, match="with U32 ids and without depth, expected .* with depth and U32"
    ):
        cam.step(HDR, t_ns=FRAME_NS, ids=IDS)
    cam = camera(synthesis="linear")
    cam.step(HDR, t_ns=0)
    with pytest.raises(esaac.FrameError, match="with U32 ids and without depth, expected f32 colour without"):
        cam.step(HDR, t_ns=FRAME_NS, ids=IDS)


def test_a_first_step_that_is_refused_fixes_nothing():
    cam, poses = camera(synthesis="auto"), esaac.Poses(TIMES_NS, CAMERA, BODIES)
    many = esaac.Poses(TIMES_NS, CAMERA, BODIES, ids=dict.fromkeys(range(1, 200_000), 0))
    with pytest.raises(esaac.FrameError, match="instances"):
        cam.step(HDR, t_ns=0, depth=DEPTH, ids=IDS, poses=many)
    assert cam.synthesis is None and cam.aps is None
    with pytest.raises(esaac.ArgumentError, match="nothing to save"):
        cam.save()
    # Other formats than those of the step that was refused.
    cam.step(HDR.astype(np.float16), t_ns=0)
    assert cam.synthesis == "linear"
    cam = camera()
    with pytest.raises(esaac.FrameError, match="instances"):
        cam.submit(HDR, t_ns=0, depth=DEPTH, ids=IDS, poses=many)
    assert_same(run(cam, poses), run(camera(), poses))


@pytest.mark.parametrize("turns", [False, True])
def test_the_same_input_gives_the_same_events_by_command_and_package(tmp_path, turns):
    """The command reads files and poses by its own code, and steps the engine without Python."""
    import json
    import subprocess

    import OpenEXR

    rate_hz, pose_rate_hz, count = 25, 200, 3
    times_ns = np.arange((count - 1) * pose_rate_hz // rate_hz + 1) * (1_000_000_000 // pose_rate_hz)
    poses = [np.stack([of(t) for t in times_ns * 1e-9]) for of in (scene.camera_pose, scene.box_pose)]
    if not turns:
        for each in poses:
            each[:, 3:] = (0, 0, 0, 1)
    rows = lambda pose: np.vstack(
        [np.column_stack([scene.matrix(pose[3:]), pose[:3]]), [0, 0, 0, 1]]
    ).tolist()
    sequence = {
        "key_rate_hz": rate_hz,
        "pose_rate_hz": pose_rate_hz,
        "intrinsics": {"fx": LENS.fx, "fy": LENS.fy, "cx": LENS.cx, "cy": LENS.cy},
        "camera_to_world": [rows(pose) for pose in poses[0]],
        "instances": {"1": [rows(pose) for pose in poses[1]]},
    }
    (tmp_path / "sequence.json").write_text(json.dumps(sequence))
    cam, packets = camera(), []
    for index in range(count):
        t = index / rate_hz
        hdr, depth, ids = scene.render(t, WIDTH, HEIGHT, samples=1)
        colours = {name: hdr[..., channel].copy() for channel, name in enumerate("RGB")}
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, {**colours, "depth.Z": depth, "id": ids}).write(
            str(tmp_path / f"key_{index:04}.exr")
        )
        given = esaac.Poses(times_ns, poses[0], poses[1][:, None])
        packets.append(cam.step(hdr, t_ns=round(t * 1e9), depth=depth, ids=ids, poses=given))
    out = tmp_path / "events.npz"
    flags = [f"--{name.replace('_', '-')}={value}" for name, value in SENSOR.items()]
    ran = subprocess.run(
        [sys.executable, "-m", "esaac", "simulate", tmp_path, "--sensor", "dvs128", "--synthesis", "rigid"]
        + [*flags, "--out", out],
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 0, ran.stderr
    written = np.load(out)
    theirs = (written["x"], written["y"], written["t"], (written["p"] > 0).astype(np.uint8))
    if turns:
        # Rotations pass through matrices, which rounds them.
        same = set(zip(*(column.tolist() for column in theirs))) & set(
            zip(*(c.tolist() for c in join(packets)))
        )
        assert len(same) > 0.999 * len(theirs[0]) > 500
    else:
        assert_same(join(packets), theirs)


def test_the_example_tells_that_poses_are_worth_something(capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["rigid_numpy.py", "--seconds", "0.1"])
    scene.main()
    lines = capsys.readouterr().out.splitlines()
    linear, rigid = (float(line.rsplit(" ", 1)[1]) for line in lines if "F1" in line)
    assert rigid > linear + 0.3 and rigid > 0.8, lines
