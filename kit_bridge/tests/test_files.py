"""Files of events, read back by libraries that know nothing of this one."""

import contextlib
import os
import pathlib
import resource
import tempfile

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


def decode_evt3(path):
    """Prophesee's published format, word by word, of single and vector events."""
    data = path.read_bytes()
    while data.startswith(b"%"):
        line, data = data.split(b"\n", 1)
        if line == b"% end":
            break
    words = np.frombuffer(data, "<u2")
    y = base = low = high = wraps = polarity = 0
    events = []
    for word in words.tolist():
        kind, value = word >> 12, word & 0xFFF
        if kind == 0x0:
            y = value & 0x7FF
        elif kind == 0x2:
            events.append(((wraps << 24) | (high << 12) | low, value & 0x7FF, y, value >> 11))
        elif kind == 0x3:
            base, polarity = value & 0x7FF, value >> 11
        elif kind in (0x4, 0x5):
            bits = 12 if kind == 0x4 else 8
            for bit in range(bits):
                if value >> bit & 1:
                    events.append(((wraps << 24) | (high << 12) | low, base + bit, y, polarity))
            base += bits
        elif kind == 0x6:
            low = value
        elif kind == 0x8:
            wraps += value < high
            high = value
    return np.array(events, np.int64).T


def test_evt3_is_the_published_format(tmp_path, recording):
    x, y, t_ns, p = write(tmp_path / "events.raw", recording)
    t, ex, ey, ep = decode_evt3(tmp_path / "events.raw")
    # The format orders events of one microsecond as it likes.
    order, expected = np.lexsort((ep, ex, ey, t)), np.lexsort((p, x, y, t_ns // 1000))
    np.testing.assert_array_equal((t - t[0])[order], (t_ns // 1000 - t_ns[0] // 1000)[expected])
    np.testing.assert_array_equal(ex[order], x[expected])
    np.testing.assert_array_equal(ey[order], y[expected])
    np.testing.assert_array_equal(ep[order], p[expected])
    assert faery.events_stream_from_file(tmp_path / "events.raw").dimensions() == (40, 24)


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


def test_an_empty_recording_is_a_file_too(tmp_path, recording):
    for name in ("empty.npz", "empty.h5"):
        esaac.EventWriter(tmp_path / name, recording[0]).close()
    assert len(np.load(tmp_path / "empty.npz")["t"]) == 0
    assert len(esaac.files.load_dsec(tmp_path / "empty.h5")[2]) == 0


def test_a_run_that_fails_leaves_no_file(tmp_path, recording):
    with pytest.raises(RuntimeError, match="on the way"):
        with esaac.EventWriter(tmp_path / "events.npz", recording[0]) as events:
            events.write(recording[1][1])
            raise RuntimeError("on the way")
    assert not (tmp_path / "events.npz").exists()


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
    t = decode_evt3(path)[0]
    return t - t[0]


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
    times = read_times(path)
    np.testing.assert_array_equal(times - times[0], expected - expected[0])
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
