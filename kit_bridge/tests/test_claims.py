"""Recordings whose headers claim more than the file has are refused before memory is taken for it."""

import io
import tracemalloc
import zipfile

import h5py
import numpy as np
import pytest
from test_loading import COLUMNS, written

import esaac
from esaac import claims, files

HUGE = 1 << 40
"""More elements than any memory holds."""


@pytest.fixture(autouse=True)
def little_memory():
    """No test of this file takes much memory, as NumPy reports its arrays' memory."""
    tracemalloc.start()
    yield
    _, most_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most_bytes < 1 << 27


def npy(shape, data=b"", dtype="<u2"):
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"shape": shape, "fortran_order": False, "descr": dtype})
    return header.getvalue() + data


def archive(path, compression=zipfile.ZIP_DEFLATED, **members):
    """A recording of one event in which some members are others."""
    one = npy((1,), bytes(2))
    with zipfile.ZipFile(path, "w", compression) as file:
        for name, content in {**dict.fromkeys("xytp", one), **members}.items():
            file.writestr(f"{name}.npy", content)
    return path


def refused(path, expected):
    with pytest.raises(esaac.ArgumentError, match=f"^{path.name}.*{expected}"):
        files.load(path)


@pytest.mark.parametrize("compression", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_an_array_has_as_many_bytes_as_its_header_claims(tmp_path, compression):
    path = tmp_path / "events.npz"
    assert len(files.load(archive(path, compression))) == 1
    for name in "xytp":
        refused(
            archive(path, compression, **{name: npy((HUGE,))}), f"{name}.npy claims {2 * HUGE} bytes of data"
        )
    refused(archive(path, compression, id=npy((3,), bytes(2))), "id.npy claims 6 bytes of data, and has 2")
    refused(archive(path, compression, id=npy((1,), bytes(4))), "id.npy claims 2 bytes of data, and has 4")
    refused(archive(path, compression, sensor=npy((), dtype=f"<U{HUGE >> 12}")), "sensor.npy claims")


def test_an_archive_does_not_claim_more_than_it_has(tmp_path):
    path = archive(tmp_path / "events.npz", x=npy((HUGE,)))
    whole = path.read_bytes()
    # The size of what `x` unpacks to, in the directory at the archive's end. It claims most that has 32 bits.
    at = whole.index(b"PK\x01\x02") + 24
    path.write_bytes(whole[:at] + (0xFFFF_FFFE).to_bytes(4, "little") + whole[at + 4 :])
    refused(path, "x.npy claims 4294967294 bytes, expected at most")


def test_columns_are_of_one_length_and_kind(tmp_path):
    path = tmp_path / "events.npz"
    refused(archive(path, t=npy((2,), bytes(4))), "columns of 1 to 2 events, expected all of one length")
    refused(archive(path, t=npy((1, 1), bytes(2))), "t.npy is uint16 with 2 axes, expected integers with 1")
    refused(
        archive(path, t=npy((1,), bytes(8), "<f8")), "t.npy is float64 with 1 axes, expected integers with 1"
    )
    refused(archive(path, t=npy((1,), bytes(8), "|O")), "t.npy is object with 1 axes")
    refused(archive(path, zipfile.ZIP_BZIP2), r"x.npy has compression 12, expected 0 \(none\) or 8")
    refused(archive(path, y=b"no array at all"), "is damaged: .*magic")


def dsec(path, **others):
    """A recording of DSEC's layout in which some datasets are others."""
    written(path, {name: column[:100] for name, column in COLUMNS.items()})
    with h5py.File(path, "a") as file:
        for name, how in others.items():
            place = name if name in file else f"events/{name}"
            del file[place]
            file.create_dataset(place, **how)
    return path


@pytest.mark.parametrize("name", ["x", "y", "t", "p", "id", "ms_to_idx"])
def test_a_dataset_has_the_data_that_it_claims(tmp_path, name):
    path = tmp_path / "events.h5"
    assert len(files.load(dsec(path))) == 100
    refused(
        dsec(path, **{name: {"shape": (HUGE,), "dtype": "u8", "chunks": (1 << 20,), "compression": "gzip"}}),
        f"{name} claims {HUGE >> 20} chunks of data, and the file has 0",
    )
    refused(
        dsec(path, **{name: {"shape": (HUGE,), "dtype": "u8"}}),
        f"{name} claims {8 * HUGE} bytes, and the file has 0 of them",
    )


def test_data_are_not_of_a_compression_that_no_recording_has(tmp_path, monkeypatch):
    path = tmp_path / "events.h5"
    monkeypatch.setattr(claims, "FEW_BYTES", 1 << 10)
    same = {"data": np.zeros(100, np.int64), "chunks": (100,), "compression": "gzip"}
    assert len(files.load(dsec(path, id=same))) == 100
    monkeypatch.setattr(claims, "MOST_PER_BYTE", 0)
    monkeypatch.setattr(claims, "FEW_BYTES", 799)
    refused(dsec(path, id=same), "id claims 800 bytes, expected at most 799 of the")


def test_datasets_are_columns_of_one_length(tmp_path):
    path = tmp_path / "events.h5"
    refused(dsec(path, t={"data": np.zeros(99, np.uint32)}), "columns of 99 to 100 events")
    refused(
        dsec(path, t={"data": np.zeros((100, 1), np.uint32)}), "events/t is .*expected a dataset of integers"
    )
    refused(dsec(path, t={"data": np.zeros(100)}), "events/t is .*expected a dataset of integers")
    refused(dsec(path, t_offset={"shape": (HUGE,), "dtype": "i8"}), "t_offset is .*expected one number")
    with h5py.File(dsec(path), "a") as file:
        del file["events"]
        file["events"] = [1]
    refused(path, "has no events, expected x, y, t, p")


def test_a_cut_file_of_hdf5_is_told(tmp_path):
    path = written(tmp_path / "events.h5")
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    refused(path, "is damaged: .*truncated")
