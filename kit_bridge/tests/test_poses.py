"""Poses and their recorder: whatever order, axes and rate they come in, and what is said of wrong ones."""

import numpy as np
import pytest
from conftest import FRAME_NS, assert_same, join
from rigid_scene import BODIES, CAMERA, DEPTH, HDR, IDS, IMAGES, STEPS, TIMES_NS, camera, run, scene

import esaac


@pytest.fixture(scope="module")
def expected():
    return run(camera())


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
        # Two substeps after the frame, the one at it and four before it.
        assert len(recorder) == min(7, taken)
    assert_same(join(packets), expected)
    recorder.clear()
    assert len(recorder) == 0


def test_a_recorder_hands_out_all_that_the_velocities_at_the_ends_come_from():
    recorder = esaac.PoseRecorder()
    for step in range(11):
        recorder.record(step * 1_000_000, CAMERA[0], BODIES[0])
    # At a track's end a velocity comes from four samples on one side.
    poses = recorder.spanning(9_000_000, 10_000_000)
    assert poses.times_ns.tolist() == [step * 1_000_000 for step in range(5, 11)]


def test_a_recorder_is_bounded_and_forgives_clocks_of_floats():
    recorder = esaac.PoseRecorder(limit=20, tolerance_ns=1000)
    for step in range(200):
        recorder.record(step * 1_000_000 + 3, CAMERA[0], BODIES[0])
    assert len(recorder) == 20
    poses = recorder.spanning(190_000_000, 199_000_900)
    assert poses.times_ns[[0, -1]].tolist() == [185_000_003, 199_000_900] and len(poses) == 15
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


def test_a_sample_may_be_recorded_anew():
    recorder = esaac.PoseRecorder()
    for step in range(3):
        recorder.record(step, CAMERA[0])
    recorder.forget_from(1)
    recorder.record(1, CAMERA[3])
    assert recorder.spanning(0, 1).times_ns.tolist() == [0, 1]
    np.testing.assert_array_equal(recorder.spanning(1, 1).camera[-1, 0], CAMERA[3])


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
        ((TIMES_NS, CAMERA, BODIES), {"ids": {7: -2}}, "id 7 is body -2, expected one from 0, or -1"),
    ],
)
def test_arrays_that_are_no_poses_are_named_when_they_are_given(arguments, options, message):
    with pytest.raises((esaac.FrameError, esaac.ArgumentError), match=message):
        esaac.Poses(*arguments, **options)


def test_a_table_of_poses_without_bodies_says_that_there_are_none():
    hdr, depth, given = IMAGES[0]
    with pytest.raises(esaac.FrameError, match="id 7 is body 0, but the poses have no bodies"):
        poses = esaac.Poses(TIMES_NS, CAMERA, ids={7: 0})
        camera().step(hdr, t_ns=0, depth=depth, ids=given, poses=poses)


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
