"""Rigs of different cameras, and tiled frames of many environments."""

import copy
import pathlib
import pickle
import time

import numpy as np
import pytest
from conftest import FRAME_NS, assert_same, bars, join, run

import esaac

SENSOR = esaac.SensorModel(
    "dvs128", width=24, height=16, contrast_on=0.15, contrast_off=0.15, profile="noisy"
)


def tiles(count, index, height=16, width=24):
    """Every environment sees the bars at another phase."""
    pairs = [bars(width, height, index + 0.3 * env) for env in range(count)]
    return np.stack([hdr for hdr, _ in pairs]), np.stack([motion for _, motion in pairs])


def test_a_rig_gives_what_its_cameras_give_alone():
    sensors = [SENSOR.replace(seed=3), SENSOR.replace(width=40, height=24, intensity="bayer_rggb")]
    with esaac.Rig(sensors) as rig:
        assert len(rig) == 2 and rig.sensors == sensors
        ticks = [rig.step([bars(24, 16, i), bars(40, 24, i)], FRAME_NS * i) for i in range(5)]
        frames = rig.event_frames()
        assert [frame.shape for frame in frames] == [(2, 16, 24), (2, 24, 40)]
        assert [int(frame.sum()) for frame in frames] == [len(packet) for packet in ticks[-1]]
        assert [grid.shape for grid in rig.voxel_grids(3)] == [(3, 16, 24), (3, 24, 40)]
        assert len(rig.statistics["cameras"]) == 2
    alone = run(esaac.EventCamera(sensors[0]), count=5, width=24, height=16)
    assert_same(join([tick[0] for tick in ticks]), alone)
    # The second camera has a number of its own in every random draw, so only its size can be compared.
    assert len(join([tick[1] for tick in ticks])[0]) > 500


def test_cameras_without_a_frame_wait():
    rig = esaac.Rig([SENSOR.replace(seed=1), SENSOR.replace(seed=2)])
    with pytest.raises(esaac.FrameError, match="first step needs a frame of every camera"):
        rig.step([bars(24, 16, 0), None], [0, None])
    rig.step([bars(24, 16, 0)] * 2, 0)
    first = rig.step([bars(24, 16, 1), None], [FRAME_NS, None])
    assert len(first[0]) > 0 and len(first[1]) == 0
    late = rig.step([None, bars(24, 16, 1)], [None, FRAME_NS])
    assert len(late[0]) == 0 and len(late[1]) > 0
    with pytest.raises(esaac.FrameError, match="1 frames and 2 times for 2 cameras"):
        rig.step([bars(24, 16, 2)], [0, 0])
    with pytest.raises(esaac.FrameError, match="camera 1: frame time 0 ns"):
        rig.step([bars(24, 16, 2)] * 2, [2 * FRAME_NS, 0])
    # That tick did not happen for any camera.
    assert len(rig.step([bars(24, 16, 2)] * 2, 2 * FRAME_NS)[0]) > 0
    with pytest.raises(esaac.ArgumentError, match="camera is 2, expected a number from 0 to 1"):
        rig.reset([2])
    with pytest.raises(esaac.ArgumentError, match="at least one"):
        esaac.Rig([])
    for alone in ("davis346", SENSOR):
        with pytest.raises(esaac.ArgumentError, match="expected a list of sensors"):
            esaac.Rig(alone)


def test_an_environment_may_have_a_sensor_of_its_own():
    count, other = 3, SENSOR.replace(contrast_on=0.3, contrast_off=0.25)
    with esaac.TiledEventCamera(SENSOR, count) as tiled, esaac.TiledEventCamera(other, count) as others:
        plain = esaac.TiledEventCamera(SENSOR, count)
        tiled.set_sensor(1, other)
        assert tiled.sensors == [SENSOR, other, SENSOR] and tiled.sensor == SENSOR
        for index in range(4):
            hdr, motion = tiles(count, index)
            if index == 2:
                # While it runs, too.
                for camera in (tiled, others):
                    camera.set_sensor(np.int64(1), SENSOR)
            packets = [cam.step(hdr, motion, t_ns=FRAME_NS * index) for cam in (tiled, others, plain)]
            for env, expected in ((0, packets[2]), (1, packets[1]), (2, packets[2])):
                np.testing.assert_array_equal(packets[0][env].t_ns, expected[env].t_ns)
                np.testing.assert_array_equal(packets[0][env].x, expected[env].x)
            if index == 1:
                assert 20 < len(packets[0][1]) < len(packets[2][1])
        with pytest.raises(esaac.ArgumentError, match="24x16 px and cannot become 40x16 px"):
            tiled.set_sensor(0, SENSOR.replace(width=40))
        for wrong in (3, -1, 1.0, "1", True):
            with pytest.raises(
                esaac.ArgumentError, match=r"environment is .*, expected a number from 0 to 2"
            ):
                tiled.set_sensor(wrong, SENSOR)


def test_environments_are_cameras_of_a_rig():
    count = 5
    with esaac.TiledEventCamera(SENSOR, count) as tiled, esaac.Rig([SENSOR] * count) as rig:
        for index in range(4):
            hdr, motion = tiles(count, index)
            packet = tiled.step(hdr, motion, t_ns=FRAME_NS * index)
            packets = rig.step(list(zip(hdr, motion)), FRAME_NS * index)
            assert packet.offsets.dtype == np.int64 and len(packet.offsets) == count + 1
            for env, expected in enumerate(packets):
                part = packet[env]
                for name in ("x", "y", "t_ns", "p"):
                    np.testing.assert_array_equal(getattr(part, name), getattr(expected, name))
            frames, grids = tiled.event_frames(), tiled.voxel_grids(4)
            assert frames.shape == (count, 2, 16, 24) and grids.shape == (count, 4, 16, 24)
            for env, (frame, grid) in enumerate(zip(rig.event_frames(), rig.voxel_grids(4))):
                np.testing.assert_array_equal(frames[env], frame)
                np.testing.assert_array_equal(grids[env], grid)
        assert len(packet) > 500
        np.testing.assert_array_equal(packet[-1].x, packet[count - 1].x)
        with pytest.raises(IndexError, match="camera 5 of 5"):
            packet[count]
        with pytest.raises(TypeError, match="one camera"):
            packet[0][0]


def header(packet):
    names = ("base_ns", "watermark_ns", "sequence", "dropped", "width", "height")
    return {name: getattr(packet, name) for name in names}


@pytest.mark.parametrize("packets", ["host", "mapped"])
def test_each_environment_has_the_header_of_its_own_packet(packets):
    sensor = SENSOR.replace(max_events_per_interval=60)
    tiled, rig = esaac.TiledEventCamera(sensor, 3, packets=packets), esaac.Rig([sensor] * 3)
    # The second waits while the others go on, for longer than a packet's 32 bits of nanoseconds reach.
    for index in range(12):
        hdr, motion = tiles(3, index)
        times = [400_000_000 * index, 0 if index == 0 else None, 400_000_000 * index]
        packet = tiled.step(hdr, motion, t_ns=times)
        alone = rig.step(list(zip(hdr, motion)), times)
    assert [header(part) for part in packet] == [header(each) for each in alone]
    assert packet.dropped == sum(each.dropped for each in alone) > alone[0].dropped > 0
    assert packet.watermark_ns == alone[1].watermark_ns < alone[0].watermark_ns
    for part, each in zip(packet, alone):
        np.testing.assert_array_equal(part.t_ns, each.t_ns)


@pytest.mark.parametrize("packets", ["host", "mapped"])
def test_one_environment_has_a_packet_as_several_have(packets):
    with esaac.TiledEventCamera(SENSOR, 1, packets=packets) as tiled, esaac.EventCamera(SENSOR) as camera:
        for index in range(3):
            hdr, motion = tiles(1, index)
            packet = tiled.step(hdr, motion, t_ns=FRAME_NS * index)
            alone = camera.step(hdr[0], motion[0], t_ns=FRAME_NS * index)
            assert packet.offsets.tolist() == [0, len(alone)] and alone.offsets is None
            assert header(packet[0]) == header(packet) == header(alone)
            for name in ("x", "y", "t_ns", "p"):
                np.testing.assert_array_equal(getattr(packet, name), getattr(alone, name))
                np.testing.assert_array_equal(getattr(packet[0], name), getattr(alone, name))
        assert len(packet) > 20 and tiled.last_packet is packet
        with pytest.raises(IndexError, match="camera 1 of 1"):
            packet[1]


@pytest.mark.parametrize("packets", ["host", "mapped"])
@pytest.mark.parametrize(
    "again", [copy.copy, copy.deepcopy, lambda packet: pickle.loads(pickle.dumps(packet))]
)
def test_packets_are_pickled_and_copied(packets, again):
    with esaac.TiledEventCamera(SENSOR, 3, packets=packets) as tiled, esaac.EventCamera(SENSOR) as camera:
        for index in range(3):
            hdr, motion = tiles(3, index)
            together = tiled.step(hdr, motion, t_ns=FRAME_NS * index)
            alone = camera.step(hdr[0], motion[0], t_ns=FRAME_NS * index)
        for packet in (together, together[1], alone):
            other = again(packet)
            assert other is not packet and len(other) == len(packet) > 20
            assert header(other) == header(packet) and repr(other) == repr(packet)
            for name in ("x", "y", "t_ns", "p", "t_offset_ns", "offsets"):
                np.testing.assert_array_equal(getattr(other, name), getattr(packet, name))
        other = again(together)
        assert [header(part) for part in other] == [header(part) for part in together]
        np.testing.assert_array_equal(other[2].t_ns, together[2].t_ns)


@pytest.mark.parametrize(
    "chosen",
    [
        [1, 3],
        (3, 1),
        np.array([1, 3], np.int32),
        [np.int64(1), np.int64(3)],
        np.array([False, True, False, True]),
        [False, True, False, True],
        [np.False_, np.True_, np.False_, np.True_],
    ],
)
def test_environments_are_chosen_by_numbers_or_by_a_mask(chosen):
    tiled, rig = esaac.TiledEventCamera(SENSOR, 4), esaac.Rig([SENSOR] * 4)
    for index in range(2):
        hdr, motion = tiles(4, index)
        tiled.step(hdr, motion, t_ns=FRAME_NS * index)
        rig.step(list(zip(hdr, motion)), FRAME_NS * index)
    tiled.reset(chosen)
    rig.reset(chosen)
    hdr, motion = tiles(4, 2)
    packet = tiled.step(hdr, motion, t_ns=FRAME_NS * 2)
    packets = rig.step(list(zip(hdr, motion)), FRAME_NS * 2)
    for env, other in enumerate(packets):
        assert (len(packet[env]) > 0) == (len(other) > 0) == (env in (0, 2))


def test_one_environment_and_none_may_be_chosen():
    tiled = esaac.TiledEventCamera(SENSOR, 3)
    for index in range(2):
        tiled.step(*tiles(3, index), t_ns=FRAME_NS * index)
    for nothing in ([], np.array([]), np.zeros(3, bool)):
        tiled.reset(nothing)
    tiled.reset(np.int64(2))
    tiled.reset(0)
    packet = tiled.step(*tiles(3, 2), t_ns=FRAME_NS * 2)
    assert [len(packet[env]) > 0 for env in range(3)] == [False, True, False]


@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        ([True, False], "mask of {}s has 2 entries, expected 4"),
        (np.ones(5, bool), "mask of {}s has 5 entries, expected 4"),
        ([True, 2, 0, 1], "{} is True, expected a number from 0 to 3"),
        ([4], "{} is 4, expected a number from 0 to 3"),
        ([-1], "{} is -1, expected a number from 0 to 3"),
        ([1 << 70], "expected a number from 0 to 3"),
        ([1.0], "{} is 1.0, expected a number from 0 to 3"),
        (np.array([0.0, 1.0]), "{} is 0.0, expected"),
        ("12", "{} is '12', expected"),
        (["1"], "{} is '1', expected"),
        ([[0, 1]], r"{} is \[0, 1\], expected"),
        (1.5, "{} is 1.5, expected"),
    ],
)
def test_what_names_no_environment_is_refused(chosen, message):
    tiled, rig = esaac.TiledEventCamera(SENSOR, 4), esaac.Rig([SENSOR] * 4)
    with pytest.raises(esaac.ArgumentError, match=message.format("environment")):
        tiled.reset(chosen)
    with pytest.raises(esaac.ArgumentError, match=message.format("camera")):
        rig.reset(chosen)
    if not isinstance(chosen, (list, np.ndarray)):
        with pytest.raises(esaac.ArgumentError, match=message.format("environment")):
            tiled.set_sensor(chosen, SENSOR)


def test_chosen_environments_begin_anew():
    tiled = esaac.TiledEventCamera(SENSOR, 4)
    for index in range(2):
        tiled.step(*tiles(4, index), t_ns=FRAME_NS * index)
    tiled.reset(np.array([1, 3]))
    packet = tiled.step(*tiles(4, 2), t_ns=FRAME_NS * 2)
    assert [len(packet[env]) > 0 for env in range(4)] == [True, False, True, False]
    # Their clocks may begin anew as well.
    tiled.reset([0])
    packet = tiled.step(*tiles(4, 3), t_ns=[0, *[FRAME_NS * 3] * 3])
    assert [len(packet[env]) > 0 for env in range(4)] == [False, True, True, True]
    with pytest.raises(esaac.ArgumentError, match="3 times for 4"):
        tiled.step(*tiles(4, 4), t_ns=[1, 2, 3])
    with pytest.raises(esaac.FrameError, match=r"hdr has shape \[3, 16, 24, 4\], expected \(4, 16, 24"):
        tiled.step(*tiles(3, 4), t_ns=FRAME_NS * 4)


def test_the_time_is_one_for_all_or_one_for_each_of_whatever_holds_them():
    kinds = (
        int,
        np.int64,
        lambda t: [t] * 3,
        lambda t: (t,) * 3,
        lambda t: np.full(3, t),
        lambda t: iter([t] * 3),
    )
    packets = []
    for kind in kinds:
        with esaac.TiledEventCamera(SENSOR, 3) as tiled:
            for index in range(3):
                packet = tiled.step(*tiles(3, index), t_ns=kind(FRAME_NS * index))
            for wrong in (0.5, [0.5] * 3, None, "now"):
                with pytest.raises(TypeError, match="t_ns is .*, expected an integer, nanoseconds"):
                    tiled.step(*tiles(3, 3), t_ns=wrong)
            for wrong in (1 << 63, [FRAME_NS * 3, FRAME_NS * 3, -(1 << 64)]):
                with pytest.raises(esaac.ArgumentError, match="t_ns is .*, expected -9223372036854775808 to"):
                    tiled.step(*tiles(3, 3), t_ns=wrong)
        packets.append(packet)
    assert len(packets[0]) > 100
    for packet in packets[1:]:
        np.testing.assert_array_equal(packet.t_ns, packets[0].t_ns)


def test_more_environments_than_a_rig_holds_are_one_camera_all_the_same():
    sensor = esaac.SensorModel("dvs128", width=8, height=8, contrast_on=0.15, contrast_off=0.15)
    count = 300
    many = esaac.TiledEventCamera(sensor, count)
    few = esaac.TiledEventCamera(sensor, 44)
    for index in range(3):
        hdr, motion = tiles(count, index, 8, 8)
        packet = many.step(hdr, motion, t_ns=FRAME_NS * index)
        last = few.step(hdr[256:], motion[256:], t_ns=FRAME_NS * index)
    np.testing.assert_array_equal(packet.x[packet.offsets[256] :], last.x)
    np.testing.assert_array_equal(packet.t_ns[packet.offsets[256] :], last.t_ns)
    assert many.event_frames().shape == (count, 2, 8, 8)
    np.testing.assert_array_equal(many.event_frames()[256:], few.event_frames())
    assert max(use["camera"] for use in many.memory() if use["camera"] is not None) == count - 1
    saved = many.save()
    again = esaac.TiledEventCamera(sensor, count)
    again.restore(saved)
    hdr, motion = tiles(count, 3, 8, 8)
    a, b = (c.step(hdr, motion, t_ns=FRAME_NS * 3) for c in (many, again))
    np.testing.assert_array_equal(a.t_ns, b.t_ns)


def test_cameras_whose_events_wait_for_a_bus_may_be_as_many_as_others():
    rows = SENSOR.replace(
        width=8, height=8, profile="clean", readout="rows", readout_row_ns=100, readout_event_ns=10
    )
    sensors = [rows.replace(seed=i) for i in range(140)]
    with esaac.Rig(sensors) as rig:
        ticks = [rig.step([bars(8, 8, i)] * len(sensors), FRAME_NS * i) for i in range(3)]
        saved = rig.save()
        last = rig.step([bars(8, 8, 3)] * len(sensors), FRAME_NS * 3)
        rig.restore(saved)
        again = rig.step([bars(8, 8, 3)] * len(sensors), FRAME_NS * 3)
    assert all(len(packet) > 0 for packet in ticks[-1])
    assert [len(packet) for packet in again] == [len(packet) for packet in last]
    assert_same(join(again), join(last))


def test_threads_for_many_environments_are_kept():
    def name_of(task):
        try:
            return (task / "comm").read_text()
        except OSError:
            # It has ended meanwhile.
            return ""

    def threads():
        tasks = pathlib.Path("/proc/self/task").iterdir()
        return {task.name for task in tasks if name_of(task).startswith("esaac cameras")}

    others, count = threads(), 300
    many = esaac.TiledEventCamera(SENSOR.replace(width=8, height=8), count)
    many.step(*tiles(count, 0, 8, 8), t_ns=0)
    kept = threads() - others
    assert len(kept) >= 2
    for index in range(1, 4):
        many.step(*tiles(count, index, 8, 8), t_ns=FRAME_NS * index)
        assert threads() - others == kept
    many.close()
    deadline = time.monotonic() + 10
    while threads() & kept:
        assert time.monotonic() < deadline, "the threads of a closed camera are still there"
        time.sleep(0.01)
