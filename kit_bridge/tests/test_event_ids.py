"""The instance of each event: which camera, which memory, which file, and when it is refused."""

import h5py
import numpy as np
import pytest
from conftest import FRAME_NS, bars
from rigid_scene import BODIES, CAMERA, FRAMES, IMAGES, LENS, SENSOR, TIMES_NS, camera

import esaac

POSES = esaac.Poses(TIMES_NS, CAMERA, BODIES)


def step(cam, index):
    hdr, depth, ids = IMAGES[index]
    return cam.step(hdr, t_ns=index * FRAME_NS, depth=depth, ids=ids, poses=POSES)


def near(index, event_x, event_y):
    """Ids of the frame's pixels at most three pixels from events."""
    ids = np.pad(IMAGES[index][2], 3, mode="edge")
    around = [ids[event_y + 3 + dy, event_x + 3 + dx] for dx in range(-3, 4) for dy in range(-3, 4)]
    return np.stack(around, axis=1)


def test_each_event_has_the_id_of_what_its_pixel_shows():
    cam = camera()
    assert len(step(cam, 0)) == 0 and cam.event_ids().shape == (0,)
    events = 0
    for index in range(1, FRAMES):
        packet = step(cam, index)
        ids = cam.event_ids()
        assert ids.dtype == np.int64 and ids.shape == (len(packet),)
        assert set(ids) == {0, 1}
        # The box and the wall move less than three pixels in an interval.
        x, y = np.asarray(packet.x, np.int64), np.asarray(packet.y, np.int64)
        around = np.concatenate([near(index - 1, x, y), near(index, x, y)], axis=1)
        # But for a pixel or two that neither frame shows.
        assert (around == ids[:, None]).any(axis=1).mean() > 0.999
        events += len(packet)
    assert events > 500


def test_what_is_static_may_have_an_id_of_its_own():
    expected, cam = camera(), camera()
    poses = esaac.Poses(TIMES_NS, CAMERA, BODIES, ids={1: 0, 70_000: -1})
    for index in range(FRAMES):
        hdr, depth, ids = IMAGES[index]
        wall = np.where(ids == 0, np.uint32(70_000), ids)
        packet = cam.step(hdr, t_ns=index * FRAME_NS, depth=depth, ids=wall, poses=poses)
        np.testing.assert_array_equal(packet.t_ns, step(expected, index).t_ns)
        labels = expected.event_ids()
        np.testing.assert_array_equal(cam.event_ids(), np.where(labels == 0, 70_000, labels))
    assert {1, 70_000} == set(cam.event_ids())


def test_rigs_and_environments_have_those_of_their_cameras():
    sensor = esaac.SensorModel("dvs128", synthesis="rigid", **SENSOR)
    alone, rig = camera(), esaac.Rig([sensor] * 2, intrinsics=[LENS] * 2)
    together = esaac.Poses(TIMES_NS, np.stack([CAMERA] * 2, axis=1), BODIES)
    with esaac.TiledEventCamera(sensor, 2, intrinsics=LENS) as envs:
        for index in range(FRAMES):
            (hdr, depth, ids), t_ns = IMAGES[index], index * FRAME_NS
            step(alone, index)
            rig.step([(hdr, None, depth, ids)] * 2, t_ns, poses=[POSES] * 2)
            hdr, depth, ids = (np.stack([image] * 2) for image in IMAGES[index])
            both = envs.step(hdr, t_ns=t_ns, depth=depth, ids=ids, poses=together)
            expected = alone.event_ids()
            for actual in (*rig.event_ids(), *np.split(envs.event_ids(), both.offsets[1:-1])):
                np.testing.assert_array_equal(actual, expected)
    assert len(expected) > 100


def test_a_reset_of_some_cameras_leaves_the_ids_of_the_others():
    sensor = esaac.SensorModel("dvs128", synthesis="rigid", **SENSOR)
    rig = esaac.Rig([sensor] * 3, intrinsics=[LENS] * 3)
    together = esaac.Poses(TIMES_NS, np.stack([CAMERA] * 3, axis=1), BODIES)
    with esaac.TiledEventCamera(sensor, 3, intrinsics=LENS) as envs:
        for index in range(3):
            (hdr, depth, ids), t_ns = IMAGES[index], index * FRAME_NS
            rig.step([(hdr, None, depth, ids)] * 3, t_ns, poses=[POSES] * 3)
            hdr, depth, ids = (np.stack([image] * 3) for image in IMAGES[index])
            envs.step(hdr, t_ns=t_ns, depth=depth, ids=ids, poses=together)
        each, all_ids, packet = rig.event_ids(), envs.event_ids(), envs.last_packet
        rig.reset(1)
        envs.reset([1])
        for number, (actual, expected) in enumerate(zip(rig.event_ids(), each)):
            assert len(expected) > 50 and set(expected) == {0, 1}
            np.testing.assert_array_equal(actual, np.full_like(expected, -1) if number == 1 else expected)
        expected = all_ids.copy()
        expected[packet.offsets[1] : packet.offsets[2]] = -1
        np.testing.assert_array_equal(envs.event_ids(), expected)
        # The packet is that of the last step nevertheless.
        assert len(rig.last_packets[1]) == len(each[1]) and len(packet) == len(all_ids)
        rig.reset()
        envs.reset()
        for cameras in (rig, envs):
            with pytest.raises(esaac.ArgumentError, match="since all cameras were reset"):
                cameras.event_ids()


def test_a_reset_of_many_environments_leaves_the_ids_of_the_others():
    # More than one of the engine's rigs takes, and all that the first of them has are reset.
    count, first = 258, 256
    small = {**SENSOR, "synthesis": "rigid"}
    together = esaac.Poses(TIMES_NS, np.stack([CAMERA] * count, axis=1), BODIES)
    with esaac.TiledEventCamera("dvs128", count, intrinsics=LENS, **small) as envs:
        for index in range(2):
            hdr, depth, ids = (np.stack([image] * count) for image in IMAGES[index])
            packet = envs.step(hdr, t_ns=index * FRAME_NS, depth=depth, ids=ids, poses=together)
        expected = envs.event_ids()
        envs.reset(range(first))
        end = packet.offsets[first]
        assert len(expected) - end > 50 and set(expected[end:]) == {0, 1}
        expected[:end] = -1
        np.testing.assert_array_equal(envs.event_ids(), expected)


def test_what_is_not_known_is_refused():
    cam = esaac.EventCamera("dvs128", synthesis="auto", **SENSOR)
    with pytest.raises(esaac.ArgumentError, match="no frame has been stepped yet"):
        cam.event_ids()
    for index in range(2):
        cam.step(*bars(40, 24, index), t_ns=index * FRAME_NS)
    with pytest.raises(esaac.ArgumentError, match="camera 0 has synthesis `motion`, expected `rigid`"):
        cam.event_ids()
    cam = camera()
    step(cam, 0)
    step(cam, 1)
    cam.reset()
    with pytest.raises(
        esaac.ArgumentError, match="since all cameras were reset.*expected a step right before"
    ):
        cam.event_ids()
    assert len(step(cam, 2)) == 0


def test_ids_may_be_any_that_32_bits_hold():
    expected, far = camera(), camera()
    poses = esaac.Poses(TIMES_NS, CAMERA, BODIES, ids={4_000_000_000: 0})
    for index in range(FRAMES):
        hdr, depth, ids = IMAGES[index]
        step(expected, index)
        many = np.where(ids == 1, np.uint32(4_000_000_000), ids)
        far.step(hdr, t_ns=index * FRAME_NS, depth=depth, ids=many, poses=poses)
        np.testing.assert_array_equal(far.event_ids(), expected.event_ids() * 4_000_000_000)
    assert 4_000_000_000 in far.event_ids()


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
def test_files_keep_them(tmp_path, suffix):
    cam, path, expected = camera(), tmp_path / f"events{suffix}", []
    with esaac.EventWriter(path, cam.sensor) as events:
        for index in range(FRAMES):
            events.write(step(cam, index), ids=cam.event_ids())
            expected.append(cam.event_ids())
    expected = np.concatenate(expected)
    if suffix == ".npz":
        actual = np.load(path)["id"]
    else:
        with h5py.File(path) as file:
            actual = file["events/id"][:]
    assert actual.dtype == np.int64 and len(actual) > 500
    np.testing.assert_array_equal(actual, expected)


def test_files_refuse_those_that_they_cannot_keep(tmp_path):
    cam = camera()
    step(cam, 0)
    packet = step(cam, 1)
    ids = cam.event_ids()
    writer = esaac.EventWriter(tmp_path / "events.raw", cam.sensor)
    with pytest.raises(esaac.ArgumentError, match="events.raw has no place for ids"):
        writer.write(packet, ids)
    writer = esaac.EventWriter(tmp_path / "events.npz", cam.sensor)
    with pytest.raises(esaac.ArgumentError, match=f"expected {len(packet)} integers"):
        writer.write(packet, ids[1:])
    with pytest.raises(esaac.ArgumentError, match="float64"):
        writer.write(packet, ids * 1.0)
    with pytest.raises(esaac.ArgumentError, match=rf"ids are int64 \(\), expected {len(packet)} integers"):
        writer.write(packet, 5)
    with pytest.raises(esaac.ArgumentError, match="packet is a ndarray, expected an esaac.Packet"):
        writer.write(ids)
    writer.write(packet, ids.tolist())
    with pytest.raises(esaac.ArgumentError, match="for all of a file or for none"):
        writer.write(step(cam, 2))
    writer.close()
    np.testing.assert_array_equal(np.load(tmp_path / "events.npz")["id"], ids)
    with pytest.raises(esaac.ArgumentError, match="ids have 9223372036854775808, expected at most"):
        beyond = np.array([1 << 63], np.uint64)
        esaac.files.save(tmp_path / "one.npz", [1], [2], [5], [1], ids=beyond, sensor=cam.sensor)
    with pytest.raises(esaac.ArgumentError, match="sensor is a str, expected a SensorModel"):
        esaac.files.save(tmp_path / "one.npz", [1], [2], [5], [1], sensor="dvs128")
    assert not (tmp_path / "one.npz").exists()
