"""Packets read where the device wrote them (`packets="mapped"`)."""

import gc

import numpy as np
import pytest
from conftest import FRAME_NS, assert_same, bars, join, run

import esaac
from esaac import ros

SIZE = {"width": 40, "height": 24, "contrast_on": 0.15, "contrast_off": 0.15}
COLUMNS = ("x", "y", "t_ns", "p")


def camera(**parameters):
    return esaac.EventCamera("dvs128", **{**SIZE, **parameters})


def step(cam, index):
    return cam.step(*bars(40, 24, index), t_ns=FRAME_NS * index)


def address(array):
    return array.__array_interface__["data"][0]


def copies(packet):
    return [np.array(getattr(packet, name)) for name in COLUMNS]


def test_mapped_packets_have_the_same_bits_in_arrays_that_own_nothing_and_cannot_be_written():
    assert_same(run(camera(packets="mapped")), run(camera()))
    cam, host = camera(packets="mapped"), camera()
    for index in range(3):
        packet, expected = step(cam, index), step(host, index)
        assert (packet.base_ns, packet.watermark_ns, packet.sequence) == (
            expected.base_ns,
            expected.watermark_ns,
            expected.sequence,
        )
    assert len(packet) == len(expected) > 100 and packet.offsets is None
    for array in (packet.x, packet.y, packet.p, packet.t_offset_ns):
        assert not array.flags.owndata and not array.flags.writeable
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
        with pytest.raises(ValueError, match="WRITEABLE"):
            array.setflags(write=True)
    np.testing.assert_array_equal(cam.event_frame(), host.event_frame())
    np.testing.assert_array_equal(cam.voxel_grid(3), host.voxel_grid(3))


@pytest.mark.parametrize("ring", [2, 3, 5])
def test_the_buffers_of_the_ring_are_written_in_turn(ring):
    cam = camera(packets="mapped", packet_ring=ring)
    kept, seen = [], []
    for index in range(6 * ring):
        packet = step(cam, index)
        seen.append(address(packet.t_offset_ns))
        kept = [*kept, packet][-(ring - 1) :]
    # The first buffers were too small for what came.
    steady = seen[-2 * ring :]
    assert len(set(steady)) == ring and steady[:ring] == steady[ring:]
    uses = cam.memory()
    for index in range(6 * ring, 8 * ring):
        step(cam, index)
    assert cam.memory() == uses


def test_what_is_kept_stays_as_it_was_however_many_steps_follow():
    cam = camera(packets="mapped")
    packets = [step(cam, index) for index in range(8)]
    then = [copies(packet) for packet in packets]
    # One array alone keeps its packet's memory too.
    alone = packets[3].y
    y = packets[3].y.copy()
    for index in range(8, 12):
        step(cam, index)
    cam.close()
    del cam
    gc.collect()
    for packet, expected in zip(packets, then):
        for array, wanted in zip(copies(packet), expected):
            np.testing.assert_array_equal(array, wanted)
    del packets, packet
    gc.collect()
    np.testing.assert_array_equal(alone, y)
    assert_same(join_columns(then), run(camera(), count=8))


def join_columns(packets):
    return tuple(np.concatenate(column) for column in zip(*packets))


def test_what_is_kept_stays_as_it_was_when_the_buffers_grow():
    """A flash sends more events than there is room for at first."""

    def frames():
        for level in (1.0, 1.0, 1.1, 50.0, 50.0, 0.02, 0.02):
            hdr = np.full((24, 40, 4), level, np.float32)
            hdr *= np.linspace(0.5, 1, 40, dtype=np.float32)[None, :, None]
            yield hdr, np.zeros((24, 40, 2), np.float32)

    parameters = {"contrast_on": 0.02, "contrast_off": 0.02, "refractory_ns": 0}
    cam, host = camera(packets="mapped", **parameters), camera(**parameters)
    packets, expected = [], []
    for index, frame in enumerate(frames()):
        packets.append(cam.step(*frame, t_ns=FRAME_NS * index))
        expected.append(host.step(*frame, t_ns=FRAME_NS * index))
    assert max(map(len, packets)) > 40 * 24 * 20
    assert_same(join(packets), join(expected))


def test_a_restored_camera_leaves_earlier_packets_alone():
    cam = camera(packets="mapped")
    first = [step(cam, index) for index in range(3)]
    then, state = [copies(packet) for packet in first], cam.save()
    again = [copies(step(cam, index)) for index in range(3, 5)]
    cam.restore(state)
    twice = [copies(step(cam, index)) for index in range(3, 5)]
    assert_same(join_columns(twice), join_columns(again))
    for packet, expected in zip(first, then):
        for array, wanted in zip(copies(packet), expected):
            np.testing.assert_array_equal(array, wanted)


def test_a_rigs_packets_are_mapped_each():
    sensors = [esaac.SensorModel("dvs128", **SIZE, seed=1), esaac.SensorModel("dvs128", **SIZE, seed=2)]
    mapped, host = esaac.Rig(sensors, packets="mapped", packet_ring=3), esaac.Rig(sensors)
    for index in range(3):
        frames = [bars(40, 24, index), bars(40, 24, 2 * index)]
        for packet, expected in zip(
            mapped.step(frames, FRAME_NS * index), host.step(frames, FRAME_NS * index)
        ):
            assert not packet.x.flags.writeable
            for array, wanted in zip(copies(packet), copies(expected)):
                np.testing.assert_array_equal(array, wanted)
    assert len(packet) > 100


@pytest.mark.parametrize("count", [3, 300])
def test_environments_are_mapped_each_and_joined_when_that_is_asked_for(count):
    sensor = esaac.SensorModel("dvs128", width=24, height=16, contrast_on=0.15, contrast_off=0.15)
    mapped = esaac.TiledEventCamera(sensor, count, packets="mapped")
    host = esaac.TiledEventCamera(sensor, count)
    for index in range(3):
        pairs = [bars(24, 16, index + 0.3 * env) for env in range(count)]
        hdr, motion = (np.stack(images) for images in zip(*pairs))
        packet = mapped.step(hdr, motion, t_ns=FRAME_NS * index)
        expected = host.step(hdr, motion, t_ns=FRAME_NS * index)
        assert len(packet) == len(expected)
        np.testing.assert_array_equal(packet.offsets, expected.offsets)
        for env in (0, 1, count - 1, -1):
            part, wanted = packet[env], expected[env]
            assert not part.x.flags.writeable and len(part) == len(wanted)
            for array, other in zip(copies(part), copies(wanted)):
                np.testing.assert_array_equal(array, other)
    for name in COLUMNS:
        whole = getattr(packet, name)
        np.testing.assert_array_equal(whole, getattr(expected, name))
        assert whole.flags.writeable and getattr(packet, name) is whole
    with pytest.raises(IndexError, match=f"camera {count} of {count}"):
        packet[count]


def test_aps_frames_of_a_camera_with_mapped_packets_are_those_of_any_other():
    parameters = {"aps_exposure_ns": 10_000_000, "aps_bits": 10}
    cam, host = camera(packets="mapped", **parameters), camera(**parameters)
    for index in range(2):
        step(cam, index), step(host, index)
    frame, expected = cam.aps, host.aps
    assert (frame.t_ns, frame.bits) == (expected.t_ns, expected.bits) and frame.pixels.max() > 0
    np.testing.assert_array_equal(frame.pixels, expected.pixels)


def test_a_file_does_not_keep_mapped_memory(tmp_path):
    cam = camera(packets="mapped")
    seen = []
    with esaac.EventWriter(tmp_path / "events.npz", cam.sensor) as events:
        for index in range(8):
            packet = step(cam, index)
            seen.append(address(packet.t_offset_ns))
            events.write(packet)
    assert len(set(seen[-4:])) == 2
    np.testing.assert_array_equal(np.load(tmp_path / "events.npz")["x"], run(camera(), count=8)[0])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"packets": "mapped", "packet_ring": 1}, "packet_ring is 1, expected 2 to 64"),
        ({"packets": "mapped", "packet_ring": 65}, "packet_ring is 65, expected 2 to 64"),
        ({"packet_ring": 2}, 'packet_ring is 2 and packets is `host`, expected packets="mapped"'),
        ({"packets": "map"}, "packets is `map`, expected `host`, `mapped` or `cuda`"),
    ],
)
def test_a_wrong_ring_is_told(arguments, message):
    with pytest.raises(esaac.ArgumentError, match=message):
        camera(**arguments)


def test_mapped_packets_are_published_without_another_copy(tmp_path):
    copies_of = {}
    for packets in ("host", "mapped"):
        cam = camera(packets=packets)
        bag = tmp_path / f"{packets}.mcap"
        with ros.Publisher([ros.Camera("eye", cam.sensor)], network=False, record=bag) as publisher:
            for index in range(3):
                publisher.publish(FRAME_NS * index, {"eye": ros.Frame(step(cam, index))})
            copies_of[packets] = publisher.close()["copies"]["packet"]
    assert copies_of == {"host": 1, "mapped": 0}
