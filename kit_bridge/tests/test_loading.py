"""Recordings that are read back: whole or in part, with labels and without, ours and DSEC's; and what is none."""

import h5py
import numpy as np
import pytest

import esaac
from esaac import files

SENSOR = esaac.SensorModel("dvs128", width=40, height=24)
RANDOM = np.random.default_rng(3)
COUNT = 4000
START_NS = 7_000_123_000
COLUMNS = {
    "x": RANDOM.integers(0, 40, COUNT).astype(np.uint16),
    "y": RANDOM.integers(0, 24, COUNT).astype(np.uint16),
    # Whole microseconds, as HDF5 has them, with a gap of 20 ms and many events at once.
    "t_ns": START_NS
    + np.sort(RANDOM.integers(0, 30_000, COUNT)) * 1000
    + (np.arange(COUNT) > 2500) * 20_000_000,
    "p": RANDOM.integers(0, 2, COUNT).astype(np.uint8),
    "ids": RANDOM.choice([-1, 0, 7, 70_000, 4_000_000_000], COUNT),
}
SUFFIXES = (".npz", ".h5")


def written(path, columns=COLUMNS, **more):
    files.save(path, **columns, sensor=SENSOR, **more)
    return path


def assert_columns(actual, expected):
    for name, column in expected.items():
        assert getattr(actual, name).dtype == column.dtype
        np.testing.assert_array_equal(getattr(actual, name), column)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_was_written_is_read_back(tmp_path, suffix):
    events = files.load(written(tmp_path / f"events{suffix}"))
    assert_columns(events, COLUMNS)
    assert len(events) == COUNT and events.sensor == SENSOR and events.size_px == (40, 24)
    # It can be written again as it is.
    columns = {name: getattr(events, name) for name in COLUMNS}
    files.save(tmp_path / f"again{suffix}", **columns, sensor=events.sensor)
    assert_columns(files.load(tmp_path / f"again{suffix}"), COLUMNS)


def test_a_filter_that_is_not_there_is_named(tmp_path):
    # Of those numbers that HDF5 leaves to whoever tests. An optional filter may lack when the dataset is made.
    number, path = 300, written(tmp_path / "events.h5")
    with h5py.File(path, "a") as file:
        t = file["events/t"][:]
        del file["events/t"]
        packing = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        packing.set_chunk(t.shape)
        packing.set_filter(number, h5py.h5z.FLAG_OPTIONAL)
        space, kind = h5py.h5s.create_simple(t.shape), h5py.h5t.py_create(t.dtype)
        dataset = h5py.h5d.create(file["events"].id, b"t", kind, space, packing)
        # No bit of its mask: every filter was used.
        dataset.write_direct_chunk((0,), t.tobytes(), 0)
    with pytest.raises(esaac.ArgumentError, match=rf"events.h5 needs the HDF5 filter .*\({number}\): pip"):
        files.load(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("ids", [None, []])
def test_an_empty_recording_and_one_without_labels_are_read_back(tmp_path, suffix, ids):
    events = files.load(
        written(tmp_path / f"none{suffix}", {name: [] for name in ("x", "y", "t_ns", "p")}, ids=ids)
    )
    assert len(events) == 0 and (events.ids is None) == (ids is None)
    assert ids is None or events.ids.dtype == np.int64
    assert len(files.load(tmp_path / f"none{suffix}", from_ns=5, to_ns=10)) == 0
    one = {name: column[:1] for name, column in COLUMNS.items()}
    assert_columns(files.load(written(tmp_path / f"one{suffix}", one)), one)


def part(from_ns, to_ns):
    t_ns = COLUMNS["t_ns"]
    kept = np.ones(COUNT, bool) if from_ns is None else t_ns >= from_ns
    kept &= True if to_ns is None else t_ns < to_ns
    return {name: column[kept] for name, column in COLUMNS.items()}


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_part_is_what_lies_in_its_interval(tmp_path, suffix):
    path = written(tmp_path / f"events{suffix}")
    last_ns = int(COLUMNS["t_ns"][-1])
    times = [None, 0, START_NS, last_ns, last_ns + 1, 2 * last_ns, int(COLUMNS["t_ns"][1234])]
    times += RANDOM.integers(START_NS - 3_000_000, last_ns + 3_000_000, 12).tolist()
    # On the borders of the index's milliseconds.
    times += [START_NS // 1_000_000 * 1_000_000 + 1_000_000 * k for k in (0, 3, 45)]
    begin_ns = int(COLUMNS["t_ns"][0])
    times += [begin_ns + 1_000_000 * k for k in (1, 2, 33)]
    seen = set()
    for from_ns in times:
        for to_ns in times:
            expected = part(from_ns, to_ns)
            assert_columns(files.load(path, from_ns=from_ns, to_ns=to_ns), expected)
            seen.add(len(expected["x"]))
    assert 0 in seen and COUNT in seen and len(seen) > 50


def test_of_hdf5_no_more_is_read_than_a_part_takes(tmp_path, monkeypatch):
    path, read = written(tmp_path / "events.h5"), []
    get = h5py.Dataset.__getitem__

    def counted(dataset, index):
        rows = get(dataset, index)
        read.append((dataset.name, np.size(rows)))
        return rows

    monkeypatch.setattr(h5py.Dataset, "__getitem__", counted)
    from_ns = START_NS + 5_000_000
    events = files.load(path, from_ns=from_ns, to_ns=from_ns + 2_000_000)
    near = part(from_ns - 1_000_000, from_ns + 3_000_000)
    of_columns = [count for name, count in read if name.startswith("/events/")]
    assert len(of_columns) == 5 and 0 < len(events) < COUNT / 10
    assert max(of_columns) <= len(near["x"])


@pytest.mark.parametrize("index", ["whole", "short", "none"])
def test_files_of_dsec_are_read_whatever_their_index(tmp_path, index):
    path = tmp_path / "dsec.h5"
    with h5py.File(path, "w") as file:
        relative_us = (COLUMNS["t_ns"] - START_NS) // 1000
        for name, column in (
            ("x", COLUMNS["x"]),
            ("y", COLUMNS["y"]),
            ("p", COLUMNS["p"]),
            ("t", relative_us),
        ):
            file[f"events/{name}"] = column.astype(np.uint32) if name == "t" else column
        file["t_offset"] = np.int64(START_NS // 1000)
        if index != "none":
            rows = np.searchsorted(relative_us, np.arange(51 if index == "whole" else 12) * 1000)
            file["ms_to_idx"] = rows.astype(np.uint64)
    events = files.load(path)
    assert events.ids is None and events.sensor is None and events.size_px is None
    for from_ns, to_ns in (
        (None, None),
        (START_NS + 9_500_000, START_NS + 41_000_000),
        (START_NS + 45_000_000, None),
    ):
        expected = part(from_ns, to_ns)
        del expected["ids"]
        assert len(expected["x"]) > 50
        assert_columns(files.load(path, from_ns=from_ns, to_ns=to_ns), expected)
    for actual, name in zip(files.load_dsec(path), ("x", "y", "t_ns", "p")):
        np.testing.assert_array_equal(actual, COLUMNS[name])


def mixed(path, order, **others):
    """A recording whose events are in another order, by libraries that know nothing of this one."""
    columns = {name: column[order] for name, column in COLUMNS.items()} | others
    if path.suffix == ".npz":
        t_ns, ids = columns.pop("t_ns"), columns.pop("ids")
        np.savez(path, **columns, t=t_ns, id=ids, sensor=SENSOR.to_toml())
        return path
    written(path)
    with h5py.File(path, "a") as file:
        columns["t"] = (columns.pop("t_ns") // 1000 - file["t_offset"][()]).astype(np.uint32)
        columns["id"] = columns.pop("ids")
        for name, column in columns.items():
            del file[f"events/{name}"]
            file[f"events/{name}"] = column
    return path


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("index", ["index", "none"])
def test_events_out_of_order_are_brought_into_it(tmp_path, suffix, index):
    order = np.random.default_rng(5).permutation(COUNT)
    path = mixed(tmp_path / f"events{suffix}", order)
    if index == "none" and suffix == ".h5":
        with h5py.File(path, "a") as file:
            del file["ms_to_idx"]
    # Those of one time stay in the file's order.
    stable = order[np.argsort(COLUMNS["t_ns"][order], kind="stable")]
    assert (stable != np.arange(COUNT)).any()
    from_ns = START_NS + 5_000_000
    for first_ns, end_ns in ((None, None), (from_ns, from_ns + 2_000_000), (None, from_ns), (from_ns, None)):
        t_ns = COLUMNS["t_ns"][stable]
        kept = (t_ns >= (first_ns or 0)) & (t_ns < (end_ns or t_ns[-1] + 1))
        expected = {name: column[stable][kept] for name, column in COLUMNS.items()}
        assert len(expected["x"]) > 100
        assert_columns(files.load(path, from_ns=first_ns, to_ns=end_ns), expected)


@pytest.mark.parametrize("entry", ["0", "last", "late", "beyond", "below"])
def test_an_index_that_does_not_fit_the_times_is_not_believed(tmp_path, entry):
    path = written(tmp_path / "events.h5")
    with h5py.File(path, "a") as file:
        index = file["ms_to_idx"][:].astype(np.int64)
        del file["ms_to_idx"]
        wrong = {"0": 0, "last": COUNT - 1, "late": index + 40, "beyond": 1 << 40, "below": -5}[entry]
        file["ms_to_idx"] = np.broadcast_to(wrong, index.shape)
    from_ns = START_NS + 5_000_000
    for first_ns, end_ns in ((from_ns, from_ns + 2_000_000), (from_ns, None), (None, from_ns), (from_ns, 0)):
        assert_columns(files.load(path, from_ns=first_ns, to_ns=end_ns), part(first_ns, end_ns))


WRONG_COLUMNS = {
    "polarity": ({"p": np.full(COUNT, 2, np.uint8)}, "p has 2, expected -1 to 1"),
    "unsigned": ({"p": np.array([255] * COUNT, np.uint8)}, "p has 255, expected -1 to 1"),
    "both": (
        {"p": (np.arange(COUNT) % 3 - 1).astype(np.int8)},
        "p has -1, 0 and perhaps 1, expected 0 and 1",
    ),
    "left": ({"x": COLUMNS["x"].astype(np.int16) - 1}, "x has -1, expected 0 to 39"),
    "right": ({"x": COLUMNS["x"].astype(np.int64) + 70_000}, "x has 70000, expected 0 to 39"),
    "below": ({"y": COLUMNS["y"] + 1}, "y has 24, expected 0 to 23"),
    "ids": ({"ids": np.full(COUNT, 1 << 63, np.uint64)}, "ids have 9223372036854775808, expected at most"),
}


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(("wrong", "message"), WRONG_COLUMNS.values(), ids=WRONG_COLUMNS.keys())
def test_columns_that_are_no_events_are_refused(tmp_path, suffix, wrong, message):
    path = mixed(tmp_path / f"events{suffix}", np.arange(COUNT), **wrong)
    for from_ns in (None, START_NS + 5_000_000):
        with pytest.raises(esaac.ArgumentError, match=f"^events{suffix}: {message}"):
            files.load(path, from_ns=from_ns)


def test_columns_of_other_integers_are_read_as_those_of_packets(tmp_path):
    signs = COLUMNS["p"].astype(np.int64) * 2 - 1
    others = {"x": COLUMNS["x"].astype(np.int64), "y": COLUMNS["y"].astype(np.uint8), "p": signs}
    for suffix in SUFFIXES:
        path = mixed(tmp_path / f"events{suffix}", np.arange(COUNT), **others)
        assert_columns(files.load(path), COLUMNS)
    np.savez(tmp_path / "bare.npz", x=[70_000], y=[0], t=[0], p=[True])
    with pytest.raises(esaac.ArgumentError, match="bare.npz: x has 70000, expected 0 to 65535"):
        files.load(tmp_path / "bare.npz")
    np.savez(tmp_path / "bare.npz", x=[3], y=[0], t=np.array([1 << 63], np.uint64), p=[True])
    with pytest.raises(esaac.ArgumentError, match="bare.npz: t has 9223372036854775808, expected -9223"):
        files.load(tmp_path / "bare.npz")


@pytest.mark.parametrize(
    ("name", "column", "message"),
    [
        (
            "t_offset",
            1 << 60,
            "t_offset is 1152921504606846976, expected -9223372036854775 to 9223372036854775 us",
        ),
        ("events/t", np.full(COUNT, 1 << 54, np.uint64), "t has 18014398509481984, expected"),
    ],
)
def test_times_that_are_no_nanoseconds_are_refused(tmp_path, name, column, message):
    path = written(tmp_path / "events.h5")
    with h5py.File(path, "a") as file:
        del file[name]
        file[name] = column
    with pytest.raises(esaac.ArgumentError, match=f"events.h5: {message}"):
        files.load(path)


def test_what_is_no_recording_is_told(tmp_path):
    with pytest.raises(
        esaac.ArgumentError, match="events.csv, expected one of .npz, .h5, .hdf5, .raw, .aedat4"
    ):
        files.load(tmp_path / "events.csv")
    for name in ("wrong.npz", "wrong.h5"):
        with pytest.raises(FileNotFoundError, match=name):
            files.load(tmp_path / name)
        (tmp_path / name).write_text("no events")
        with pytest.raises(esaac.ArgumentError, match=f"{name} is no "):
            files.load(tmp_path / name)
    np.savez(tmp_path / "other.npz", x=[1], t=[2])
    with pytest.raises(esaac.ArgumentError, match="other.npz has t, x, expected also y, p"):
        files.load(tmp_path / "other.npz")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["image"] = [1]
    with pytest.raises(esaac.ArgumentError, match="other.h5 has no events, expected x, y, t, p"):
        files.load(tmp_path / "other.h5")
    path = written(tmp_path / "events.npz")
    whole = path.read_bytes()
    path.write_bytes(whole[:-200])
    with pytest.raises(esaac.ArgumentError, match="events.npz is no .npz archive, or not a whole one"):
        files.load(path)
    path.write_bytes(whole[:500] + bytes(100) + whole[600:])
    with pytest.raises(esaac.ArgumentError, match="events.npz is damaged: .*CRC"):
        files.load(path)
    with pytest.raises(TypeError, match="to_ns is 0.5, expected an integer, nanoseconds"):
        files.load(written(path), to_ns=0.5)


def test_true_events_are_read_as_they_are(tmp_path):
    """The archive of `esaac render --truth`: of each pixel in row-major order, the time since its previous event."""
    of_pixel = {
        (1, 0): [(5, 1), (70_005, 0)],
        (2, 1): [(5, 0)],
        (0, 1): [(3_000_000_000, 1), (3_000_000_001, 1)],
    }
    sensor = esaac.SensorModel("dvs128", width=3, height=2)
    counts, steps, signs = [], [], []
    for y in range(2):
        for x in range(3):
            events = of_pixel.get((x, y), [])
            counts.append(len(events))
            steps += np.diff([0, *(t for t, _ in events)]).tolist()
            signs += [1 if p else -1 for _, p in events]
    dt_ns = np.array(steps, np.uint32)
    arrays = {
        "events_of_pixel": np.array(counts, np.uint16),
        "dt_ns_low": (dt_ns & 0xFFFF).astype(np.uint16),
        "dt_ns_high": (dt_ns >> 16).astype(np.uint16),
        "p": np.array(signs, np.int8),
        "end_ns": np.int64(4_000_000_000),
        "sensor": sensor.to_toml(),
    }
    np.savez_compressed(tmp_path / "truth.npz", **arrays)
    events = files.load(tmp_path / "truth.npz")
    expected = sorted((t, y, x, p) for (x, y), each in of_pixel.items() for t, p in each)
    found = zip(events.t_ns.tolist(), events.y.tolist(), events.x.tolist(), events.p.tolist(), strict=True)
    assert list(found) == expected
    assert (events.x.dtype, events.p.dtype, events.size_px) == (np.uint16, np.uint8, (3, 2))
    assert len(files.load(tmp_path / "truth.npz", from_ns=6, to_ns=3_000_000_001)) == 2
    for name, array, message in (
        ("events_of_pixel", arrays["events_of_pixel"][1:], r"has 5 pixels, expected 6 \(3 x 2\)"),
        (
            "events_of_pixel",
            arrays["events_of_pixel"] + np.uint16(1),
            "has 5 events, expected 11, the sum of",
        ),
        ("p", arrays["p"][1:], "columns of 4 to 5 events"),
        ("p", arrays["p"] * np.int8(2), "wrong.npz: p has -2, expected -1 to 1"),
        ("dt_ns_low", np.full(5, -1), "dt_ns_low has -1, expected 0 to 65535"),
    ):
        np.savez(tmp_path / "wrong.npz", **{**arrays, name: array})
        with pytest.raises(esaac.ArgumentError, match=message):
            files.load(tmp_path / "wrong.npz")
    del arrays["sensor"]
    np.savez(tmp_path / "wrong.npz", **arrays)
    with pytest.raises(esaac.ArgumentError, match="expected also sensor"):
        files.load(tmp_path / "wrong.npz")
