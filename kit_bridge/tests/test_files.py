"""Files of events, read back by libraries that know nothing of this one."""

import contextlib
import gc
import os
import pathlib
import resource
import tempfile
import warnings

import aedat
import faery
import h5py
import numpy as np
import pytest
from conftest import FRAME_NS, bars

import esaac


@pytest.fixture(scope="module")
def recording():
    """A camera's sensor and packets."""
    camera = esaac.EventCamera("dvs128", width=40, height=24, contrast_on=0.15, contrast_off=0.15)
    start_ns = 7_000_000_000
    packets = [camera.step(*bars(40, 24, i), t_ns=start_ns + FRAME_NS * i) for i in range(4)]
    return camera.sensor, packets


def write(path, recording):
    sensor, packets = recording
    with esaac.EventWriter(path, sensor) as events:
        for packet in packets:
            events.write(packet)
        assert len(events) == sum(map(len, packets)) > 500
    names = ("x", "y", "t_ns", "p")
    return [np.concatenate([getattr(packet, name) for packet in packets]) for name in names]


def test_npz_is_as_the_command_writes_it(tmp_path, recording):
    x, y, t_ns, p = write(tmp_path / "events.npz", recording)
    file = np.load(tmp_path / "events.npz")
    for name, column in (("x", x), ("y", y), ("t", t_ns), ("p", p.astype(np.int8) * 2 - 1)):
        assert file[name].dtype == column.dtype
        np.testing.assert_array_equal(file[name], column)
    assert esaac.SensorModel.from_toml(str(file["sensor"])) == recording[0]


def test_hdf5_has_the_layout_of_dsec(tmp_path, recording):
    x, y, t_ns, p = write(tmp_path / "events.h5", recording)
    with h5py.File(tmp_path / "events.h5") as file:
        events, offset_us, index = file["events"], int(file["t_offset"][()]), file["ms_to_idx"][:]
        assert [events[name].dtype for name in "xytp"] == [np.uint16, np.uint16, np.uint32, np.uint8]
        t_us = events["t"][:].astype(np.int64)
        np.testing.assert_array_equal(events["x"][:], x)
        np.testing.assert_array_equal(events["y"][:], y)
        np.testing.assert_array_equal(events["p"][:], p)
        np.testing.assert_array_equal(t_us + offset_us, t_ns // 1000)
        for ms, first in enumerate(index):
            assert (t_us[:first] < ms * 1000).all() and (t_us[first:] >= ms * 1000).all()
    read = esaac.files.load_dsec(tmp_path / "events.h5")
    np.testing.assert_array_equal(read[2], t_ns // 1000 * 1000)


def test_aedat4_is_read_by_another_library(tmp_path, recording):
    x, y, t_ns, p = write(tmp_path / "events.aedat4", recording)
    packets = [packet["events"] for packet in aedat.Decoder(tmp_path / "events.aedat4") if "events" in packet]
    events = np.concatenate(packets)
    np.testing.assert_array_equal(events["t"], t_ns // 1000)
    np.testing.assert_array_equal(events["x"], x)
    np.testing.assert_array_equal(events["y"], y)
    np.testing.assert_array_equal(events["on"], p)


def read_evt3(path):
    """The file by faery: t in microseconds, x, y, p."""
    events = faery.events_stream_from_file(path).to_array()
    return [events[name].astype(np.int64) for name in ("t", "x", "y", "on")]


def decode_evt3(path):
    """Prophesee's published format, word by word: t in microseconds, x, y, p. As OpenEB does it, a wrap of the time
    is counted only where its upper half jumps from near its top to near 0."""
    data = path.read_bytes()
    while data.startswith(b"%"):
        line, data = data.split(b"\n", 1)
        if line == b"% end":
            break
    y = low = high = wraps = 0
    events = []
    for word in np.frombuffer(data, "<u2").tolist():
        kind, value = word >> 12, word & 0xFFF
        if kind == 0x0:
            y = value & 0x7FF
        elif kind == 0x2:
            events.append(((wraps << 24) | (high << 12) | low, value & 0x7FF, y, value >> 11))
        elif kind == 0x6:
            low = value
        else:
            assert kind == 0x8
            wraps += high - value >= 4095 - 10
            high = value
    return list(np.array(events, np.int64).T)


@pytest.mark.parametrize("read", [read_evt3, decode_evt3])
def test_evt3_is_the_published_format(tmp_path, recording, read):
    x, y, t_ns, p = write(tmp_path / "events.raw", recording)
    for column, expected in zip(read(tmp_path / "events.raw"), (t_ns // 1000, x, y, p), strict=True):
        np.testing.assert_array_equal(column, expected)
    assert faery.events_stream_from_file(tmp_path / "events.raw").dimensions() == (40, 24)


SECOND_NS = 1_000_000_000


@pytest.mark.parametrize("read", [read_evt3, decode_evt3])
@pytest.mark.parametrize(
    "times_ns",
    [
        [60 * SECOND_NS, 60 * SECOND_NS + 5000],
        np.array([0, 0.05, 1.05, 2.05, 22.05, 42.05, 142.05]) * SECOND_NS,
        np.arange(0, 60 * SECOND_NS, 1_000_000),
        [(1 << 24) * 1000 - 1, (1 << 24) * 1000, (2 << 24) * 1000, (3 << 24) * 1000 + 7000],
        [((1 << 40) - 1) * 1000],
    ],
    ids=["late", "gaps", "dense", "wraps", "last"],
)
def test_evt3_has_absolute_times_whatever_the_gaps(tmp_path, recording, read, times_ns):
    t_ns = np.array(times_ns, np.int64)
    x, y = np.arange(len(t_ns)) % 40, np.arange(len(t_ns)) % 24
    p = np.arange(len(t_ns)) % 3 == 0
    esaac.files.save(tmp_path / "events.raw", x, y, t_ns, p, sensor=recording[0])
    for column, expected in zip(read(tmp_path / "events.raw"), (t_ns // 1000, x, y, p), strict=True):
        np.testing.assert_array_equal(column, expected)


@pytest.mark.parametrize(
    ("name", "times_ns", "message"),
    [
        ("events.raw", [-1500, 0], r"first event is at -1500 ns, expected 0 or later"),
        ("events.aedat4", [-1500, 0], r"first event is at -1500 ns, expected 0 or later"),
        ("events.raw", [0, (1 << 40) * 1000], r"1099511627776 us, expected less than 2\^40 us"),
        ("events.h5", [-1000, ((1 << 32) - 1) * 1000], r"4294967296 us from .* expected less than 2\^32 us"),
    ],
)
def test_times_that_a_format_cannot_hold_are_refused(tmp_path, recording, name, times_ns, message):
    with pytest.raises(esaac.ArgumentError, match=message):
        esaac.files.save(tmp_path / name, [0, 0], [0, 0], times_ns, [0, 1], sensor=recording[0])
    assert not list(tmp_path.iterdir())


def test_a_sensor_that_is_too_wide_for_evt3_is_refused_before_anything_is_simulated(tmp_path):
    widest = esaac.SensorModel("davis240", width=2048, height=2048)
    esaac.files.save(tmp_path / "events.raw", [2047], [2047], [0], [1], sensor=widest)
    assert [int(column[0]) for column in read_evt3(tmp_path / "events.raw")] == [0, 2047, 2047, 1]
    for size in ({"width": 2049, "height": 10}, {"width": 10, "height": 2049}):
        sensor = esaac.SensorModel("davis240", **size)
        with pytest.raises(esaac.ArgumentError, match="2049.*expected at most 2048 a side"):
            esaac.EventWriter(tmp_path / "wide.raw", sensor)
        with pytest.raises(esaac.ArgumentError, match="2049.*expected at most 2048 a side"):
            esaac.files.save(tmp_path / "wide.raw", [], [], [], [], sensor=sensor)


def test_a_camera_that_was_reset_needs_another_file(tmp_path):
    camera = esaac.EventCamera("dvs128", width=40, height=24, contrast_on=0.15, contrast_off=0.15)
    with esaac.EventWriter(tmp_path / "events.h5", camera.sensor) as events:
        for i in range(3):
            events.write(camera.step(*bars(40, 24, i), t_ns=FRAME_NS * i))
        written = len(events)
        camera.reset()
        camera.step(*bars(40, 24, 0), t_ns=0)
        again = camera.step(*bars(40, 24, 1), t_ns=FRAME_NS)
        begin_ns, end_ns = int(again.t_ns[0]), int(events._last_ns)
        with pytest.raises(esaac.ArgumentError, match=f"at {begin_ns} ns, expected {end_ns} ns or later"):
            events.write(again)
        assert len(events) == written > 0
    assert len(esaac.files.load_dsec(tmp_path / "events.h5")[2]) == written


WRONG_COLUMNS = {
    "lengths": ({"x": [1, 2, 3]}, r"x has shape \(3,\), expected \(2,\)"),
    "axes": ({"p": [[0, 1]]}, r"p has shape \(1, 2\), expected \(2,\)"),
    "right": ({"x": [0, 40]}, "x has 40, expected 0 to 39"),
    "left": ({"x": [-1, 0]}, "x has -1, expected 0 to 39"),
    "below": ({"y": np.array([24, 0], np.uint16)}, "y has 24, expected 0 to 23"),
    "back": ({"t_ns": [2000, 1999]}, "t_ns goes back from 2000 to 1999"),
    "float": ({"t_ns": [1.0, 2.0]}, "t_ns is float64, expected integers"),
    "polarity": ({"p": [1, 2]}, "p has 2, expected -1 to 1"),
    "both": ({"p": [-1, 0]}, "expected 0 and 1, or -1 and 1"),
}


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".aedat4", ".raw"])
@pytest.mark.parametrize(("wrong", "message"), WRONG_COLUMNS.values(), ids=WRONG_COLUMNS.keys())
def test_columns_that_are_no_events_are_refused(tmp_path, recording, suffix, wrong, message):
    columns = {"x": [1, 2], "y": [3, 4], "t_ns": [1000, 2000], "p": [0, 1]}
    path = tmp_path / f"events{suffix}"
    with pytest.raises(esaac.ArgumentError, match=message):
        esaac.files.save(path, **(columns | wrong), sensor=recording[0])
    assert not path.exists()


@pytest.mark.parametrize("polarity", [[0, 1], [-1, 1], [False, True], np.array([-1, 1], np.int8)])
def test_polarity_is_written_as_each_format_has_it(tmp_path, recording, polarity):
    for suffix in (".npz", ".h5", ".aedat4", ".raw"):
        path = tmp_path / f"events{suffix}"
        esaac.files.save(path, [1, 2], [3, 4], [1000, 2000], polarity, sensor=recording[0])
    assert np.load(tmp_path / "events.npz")["p"].tolist() == [-1, 1]
    assert esaac.files.load_dsec(tmp_path / "events.h5")[3].tolist() == [0, 1]
    (packet,) = [
        packet["events"] for packet in aedat.Decoder(tmp_path / "events.aedat4") if "events" in packet
    ]
    assert packet["on"].tolist() == [False, True]
    assert read_evt3(tmp_path / "events.raw")[3].tolist() == [0, 1]


def test_wrong_files_are_refused_before_anything_is_simulated(tmp_path, recording):
    sensor, packets = recording
    with pytest.raises(esaac.ArgumentError, match=r"\.csv.*expected one of \.npz"):
        esaac.EventWriter(tmp_path / "events.csv", sensor)
    with pytest.raises(esaac.ArgumentError, match="expected a SensorModel"):
        esaac.EventWriter(tmp_path / "events.npz", "davis346")
    writer = esaac.EventWriter(tmp_path / "events.npz", sensor)
    writer.close()
    with pytest.raises(esaac.ArgumentError, match="closed"):
        writer.write(packets[1])
    tiled = esaac.TiledEventCamera(sensor, 2)
    both = tiled.step(np.stack([bars(40, 24, 0)[0]] * 2), np.stack([bars(40, 24, 0)[1]] * 2), t_ns=0)
    with pytest.raises(esaac.ArgumentError, match="several cameras"):
        esaac.EventWriter(tmp_path / "events.npz", sensor).write(both)


def test_a_packet_is_of_the_size_of_the_files_sensor(tmp_path, recording):
    _, packets = recording
    for size in ({"width": 1280, "height": 720}, {"width": 24, "height": 40}):
        with esaac.EventWriter(tmp_path / "events.npz", esaac.SensorModel("dvs128", **size)) as events:
            expected = f"packet is of 40 x 24 pixels, expected {size['width']} x {size['height']}"
            # One without events, too.
            for packet in packets[:2]:
                with pytest.raises(esaac.ArgumentError, match=expected):
                    events.write(packet)
        assert len(esaac.files.load(events.path)) == 0


def test_a_writer_that_is_closed_writes_no_other_file(tmp_path, recording):
    sensor, packets = recording
    with esaac.EventWriter(tmp_path / "events.npz", sensor) as events:
        events.write(packets[1])
    events.close()
    with pytest.raises(esaac.ArgumentError, match=r"events.npz is written and closed, .*: .*other.npz"):
        events.close(tmp_path / "other.npz")
    assert [file.name for file in tmp_path.iterdir()] == ["events.npz"]
    with pytest.raises(AttributeError, match="has no attribute 'ids'"):
        events.ids = True


def test_an_empty_recording_is_a_file_too(tmp_path, recording):
    for name in ("empty.npz", "empty.h5", "empty.raw"):
        esaac.EventWriter(tmp_path / name, recording[0]).close()
    assert len(read_evt3(tmp_path / "empty.raw")[0]) == 0
    assert len(np.load(tmp_path / "empty.npz")["t"]) == 0
    assert len(esaac.files.load_dsec(tmp_path / "empty.h5")[2]) == 0


def test_a_run_that_fails_leaves_no_file_and_says_so(tmp_path, recording):
    sensor, packets = recording
    path, count = tmp_path / "events.npz", len(packets[1])
    told = f"{count} events are not written to .*events.npz: the run failed"
    with pytest.raises(RuntimeError, match="on the way"), pytest.warns(RuntimeWarning, match=told):
        with esaac.EventWriter(path, sensor) as events:
            events.write(packets[1])
            raise RuntimeError("on the way")
    assert not path.exists()
    events.close()
    assert len(np.load(path)["t"]) == count


@pytest.mark.parametrize("end", [KeyboardInterrupt, SystemExit])
def test_a_run_that_is_ended_early_is_written(tmp_path, recording, end):
    sensor, packets = recording
    with pytest.raises(end):
        with esaac.EventWriter(tmp_path / "events.npz", sensor) as events:
            events.write(packets[1])
            raise end
    assert len(np.load(tmp_path / "events.npz")["t"]) == len(packets[1])


def test_a_writer_that_is_never_closed_says_what_is_lost(tmp_path, recording):
    sensor, packets = recording
    events = esaac.EventWriter(tmp_path / "events.npz", sensor)
    events.write(packets[1])
    told = f"{len(packets[1])} events are not written to .*events.npz: the writer was never closed"
    with pytest.warns(RuntimeWarning, match=told):
        del events
        gc.collect()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        esaac.EventWriter(tmp_path / "empty.npz", sensor)
        gc.collect()


@contextlib.contextmanager
def full_disk():
    """No file may grow beyond a few bytes: writes fail on the way, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@contextlib.contextmanager
def unwritable_folder():
    """A folder that this user may not write to. Root may write everywhere, so it becomes somebody else."""
    folder = pathlib.Path(tempfile.mkdtemp())
    folder.chmod(0o555)
    root = os.geteuid() == 0
    if root:
        os.seteuid(65534)
    try:
        yield folder
    finally:
        if root:
            os.seteuid(0)
        assert not list(folder.iterdir())
        folder.rmdir()


def read_times(path):
    if path.suffix == ".npz":
        return np.load(path)["t"] // 1000
    if path.suffix == ".h5":
        return esaac.files.load_dsec(path)[2] // 1000
    if path.suffix == ".aedat4":
        packets = [packet["events"]["t"] for packet in aedat.Decoder(path) if "events" in packet]
        return np.concatenate(packets)
    return read_evt3(path)[0]


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".aedat4", ".raw"])
def test_a_full_disk_costs_no_events_and_spoils_no_earlier_file(tmp_path, recording, suffix):
    sensor, packets = recording
    path = tmp_path / f"events{suffix}"
    path.write_bytes(b"an earlier recording")
    events = esaac.EventWriter(path, sensor)
    for packet in packets:
        events.write(packet)
    with full_disk(), pytest.raises(OSError):
        events.close()
    assert not events.closed and path.read_bytes() == b"an earlier recording"
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
    events.close()
    assert events.closed
    expected = np.concatenate([packet.t_ns for packet in packets]) // 1000
    np.testing.assert_array_equal(read_times(path), expected)
    with pytest.raises(esaac.ArgumentError, match="closed"):
        events.write(packets[1])


def test_a_recording_that_cannot_be_written_may_go_elsewhere(tmp_path, recording):
    sensor, packets = recording
    (tmp_path / "gone").mkdir()
    events = esaac.EventWriter(tmp_path / "gone/events.npz", sensor)
    events.write(packets[1])
    (tmp_path / "gone").rmdir()
    with pytest.raises(OSError, match="no folder"):
        events.close()
    with pytest.raises(esaac.ArgumentError, match=r"\.csv"):
        events.close(tmp_path / "events.csv")
    events.close(tmp_path / "events.h5")
    assert len(read_times(events.path)) == len(packets[1]) == len(events)


def test_a_folder_that_cannot_be_written_is_told_before_anything_is_simulated(tmp_path, recording):
    with unwritable_folder() as folder:
        with pytest.raises(PermissionError, match=f"user [0-9]+ cannot write recordings there.*{folder}"):
            esaac.EventWriter(folder / "events.npz", recording[0])
    with pytest.raises(FileNotFoundError, match="there is no folder to write events into.*missing"):
        esaac.EventWriter(tmp_path / "missing/events.npz", recording[0])
