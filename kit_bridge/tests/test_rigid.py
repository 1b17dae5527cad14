"""Synthesis `rigid`: depth, ids and poses of cameras, environments and rigs, whatever library they come from."""

import sys

import numpy as np
import pytest
from conftest import FRAME_NS, assert_same, bars, join
from rigid_scene import (
    BODIES,
    CAMERA,
    DEPTH,
    FRAMES,
    HDR,
    HEIGHT,
    IDS,
    IMAGES,
    LENS,
    SENSOR,
    TIMES_NS,
    WIDTH,
    camera,
    frame,
    numbers,
    run,
    scene,
)

import esaac


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


def test_a_recorder_keeps_what_cameras_without_a_time_will_need():
    _, stacked, cameras, bodies = tiled()
    recorder = esaac.PoseRecorder()
    for t_ns, poses, places in zip(TIMES_NS, cameras, bodies):
        recorder.record(int(t_ns) - 1_000_000_000, poses, places)
    hdr, depth, ids = stacked[0]
    sensor = esaac.SensorModel("dvs128", synthesis="rigid", **SENSOR)
    with esaac.TiledEventCamera(sensor, 3, intrinsics=LENS) as envs:
        images = {"depth": depth, "ids": ids, "poses": recorder}
        envs.step(hdr, t_ns=-1_000_000_000, **images)
        kept = len(recorder)
        envs.reset()
        envs.step(hdr, t_ns=[None] * 3, **images)
        assert len(recorder) == kept
        envs.step(hdr, t_ns=-1_000_000_000, **images)


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
    with pytest.raises(esaac.ArgumentError, match="format b'ESAACPY1', expected b'ESAACPY5'"):
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


def test_poses_that_were_not_followed_are_once_the_camera_does():
    cam, other, poses = camera(synthesis="linear"), camera(), esaac.Poses(TIMES_NS, CAMERA, BODIES)
    hdr, depth, ids = IMAGES[0]
    for each in (cam, other):
        each.step(hdr, t_ns=0, depth=depth, ids=ids, poses=poses)
    # The change makes the next frame the first.
    cam.sensor = cam.sensor.replace(synthesis="rigid")
    other.reset()
    assert_same(run(cam), run(other))


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


@pytest.mark.parametrize("synthesis", ["rigid", "linear"])
def test_poses_of_before_an_environments_reset_may_be_anything(synthesis):
    tiled = esaac.TiledEventCamera("dvs128", 2, intrinsics=LENS, synthesis=synthesis, **SENSOR)
    hdr, depth, ids = (np.stack([image] * 2) for image in IMAGES[0])
    still = np.array([0, 0, 0, 0, 0, 0, 1.0])
    step = lambda t_ns, poses: tiled.step(hdr, t_ns=t_ns, depth=depth, ids=ids, poses=poses)
    poses = lambda times_ns: (np.tile(still, (len(times_ns), 2, 1)), np.tile(still, (len(times_ns), 2, 1, 1)))
    step(0, esaac.Poses([0], *poses([0])))
    tiled.reset([1])
    step(FRAME_NS, esaac.Poses([0, FRAME_NS], *poses([0, FRAME_NS])))
    times_ns = [FRAME_NS // 2, FRAME_NS, 2 * FRAME_NS]
    camera, bodies = poses(times_ns)
    # The first environment has had a frame then.
    bodies[0, 0] = np.nan
    with pytest.raises(esaac.FrameError, match="body 0 of environment 0, step 0: x is NaN"):
        step(2 * FRAME_NS, esaac.Poses(times_ns, camera, bodies))
    bodies[0] = still
    camera[0, 1] = bodies[0, 1] = np.nan
    step(2 * FRAME_NS, esaac.Poses(times_ns, camera, bodies))
    bodies[1, 1] = np.nan
    with pytest.raises(esaac.FrameError, match="body 0 of environment 1, step 1: x is NaN"):
        step(3 * FRAME_NS, esaac.Poses([FRAME_NS // 2, FRAME_NS, 3 * FRAME_NS], camera, bodies))
