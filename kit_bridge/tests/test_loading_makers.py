"""Recordings in the formats of cameras' makers, EVT3 and AEDAT 4, that are read back; and what is none."""

import numpy as np
import pytest
from test_loading import COLUMNS, COUNT, RANDOM, SENSOR, START_NS, assert_columns, part

import esaac
from esaac import files

SUFFIXES = (".raw", ".aedat4")
GIVEN = {name: column for name, column in COLUMNS.items() if name != "ids"}
HEADER = b"% evt 3.0\n% geometry 640x480\n% end\n"


def written(path, columns=GIVEN):
    files.save(path, **columns, sensor=SENSOR)
    return path


def words(*values):
    return np.array(values, "<u2").tobytes()


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_was_written_is_read_back(tmp_path, suffix):
    events = files.load(written(tmp_path / f"events{suffix}"))
    assert_columns(events, GIVEN)
    assert len(events) == COUNT and events.ids is None and events.sensor is None
    assert events.size_px == (SENSOR.width, SENSOR.height)
    none = files.load(written(tmp_path / f"none{suffix}", {name: [] for name in GIVEN}))
    assert_columns(none, {name: column[:0] for name, column in GIVEN.items()})
    assert none.size_px == events.size_px


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_part_is_what_lies_in_its_interval(tmp_path, suffix):
    path = written(tmp_path / f"events{suffix}")
    first_ns, last_ns = int(COLUMNS["t_ns"][0]), int(COLUMNS["t_ns"][-1])
    times = [None, -1, first_ns, last_ns, last_ns + 1, int(COLUMNS["t_ns"][1234])]
    times += RANDOM.integers(START_NS - 3_000_000, last_ns + 3_000_000, 6).tolist()
    seen = set()
    for from_ns in times:
        for to_ns in times:
            expected = part(from_ns, to_ns)
            del expected["ids"]
            assert_columns(files.load(path, from_ns=from_ns, to_ns=to_ns), expected)
            seen.add(len(expected["x"]))
    assert 0 in seen and COUNT in seen and len(seen) > 20


def test_files_of_evt3_as_real_cameras_write_them_are_read(tmp_path):
    path = tmp_path / "real.raw"
    header = b"% format EVT3;height=480;width=640\n% serial_number 7\n"
    # 4098 us, row 5: ON in columns 16, 27 of a vector; then a trigger, and 3 us OFF in column 639.
    path.write_bytes(header + words(0x8001, 0x6002, 0x0005, 0x3810, 0x4801, 0xA001, 0x6003, 0x227F))
    events = files.load(path)
    assert events.size_px == (640, 480)
    np.testing.assert_array_equal(events.x, [16, 27, 639])
    np.testing.assert_array_equal(events.y, [5, 5, 5])
    np.testing.assert_array_equal(events.t_ns, [4_098_000, 4_098_000, 4_099_000])
    np.testing.assert_array_equal(events.p, [1, 1, 0])


@pytest.mark.parametrize(
    "content, expected",
    [
        (b"no events", "not an EVT file"),
        (b"", "not an EVT file"),
        (b"% date today\n% end\n", "does not tell the encoding, expected `% evt 3.0`"),
        (b"% evt 2.0\n% geometry 640x480\n% end\n", "says `evt 2.0`, expected `evt 3.0`: EVT2"),
        (b"% evt 2.1\n% geometry 640x480\n% end\n", "says `evt 2.1`, expected `evt 3.0`: EVT2, EVT2.1"),
        (b"% format EVT21;height=480;width=640\n", "says `format EVT21;height=480;width=640`"),
        (b"% evt 3.0\n% end\n", "does not tell the sensor's size"),
        (
            b"% evt 3.0\n% geometry 4000000000x480\n% end\n",
            "says `geometry 4000000000x480`, expected .* 1 to 2048",
        ),
        (
            HEADER + words(0x8001, 0x6002) + b"\0",
            "5 bytes of events, expected an even number: a word is cut off",
        ),
        (HEADER + words(0x8001, 0x6002, 0x0005, 0x2280), r"\(640, 5\) on a sensor of 640x480 px"),
        (HEADER + words(0x8001, 0x9000), "is of kind 9, expected 0, 2 to 8"),
        (HEADER + words(0x8005, 0x8004), "takes the time back from 20480 to 16384 us"),
    ],
)
def test_what_is_no_evt3_is_told(tmp_path, content, expected):
    path = tmp_path / "wrong.raw"
    path.write_bytes(content)
    with pytest.raises(esaac.ArgumentError, match=f"^wrong.raw: .*{expected}"):
        files.load(path)


def test_what_is_no_aedat4_is_told(tmp_path):
    path = tmp_path / "wrong.aedat4"
    path.write_bytes(b"#!AER-DAT2.0\r\n")
    with pytest.raises(esaac.ArgumentError, match="^wrong.aedat4: not an AEDAT 4 file"):
        files.load(path)
    whole = written(path).read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    cut = rf"packets end at byte \d+, as the header says, and the file has {len(whole) // 2} bytes"
    with pytest.raises(esaac.ArgumentError, match=f"^wrong.aedat4: {cut}"):
        files.load(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_files_that_cannot_be_read_are_errors_of_the_system(tmp_path, suffix):
    path = tmp_path / f"missing{suffix}"
    with pytest.raises(FileNotFoundError, match=rf"No such file or directory: '.*{path.name}'") as raised:
        files.load(path)
    assert raised.value.filename == str(path)
    path.mkdir()
    with pytest.raises(IsADirectoryError, match=path.name):
        files.load(path)
