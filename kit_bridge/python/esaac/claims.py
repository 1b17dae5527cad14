"""What a file says that it holds, against what it has: a few bytes may claim more than the memory can take."""

from __future__ import annotations

import math
import pathlib
import zipfile
from typing import IO, Any

from numpy.lib import format as npy

from esaac.errors import ArgumentError

MOST_PER_BYTE = 1032
"""Most bytes that a byte of deflated data stands for."""

FEW_BYTES = 1 << 24
"""A column of HDF5 may have so many in any case: there are compressions that are better than deflate."""

_KINDS = {"iub": "integers", "U": "text"}
_NPY_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


def check_member(path: pathlib.Path, member: zipfile.ZipInfo) -> None:
    """Raises if a member of an archive cannot have as many bytes as it says."""
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ArgumentError(
            f"{path.name}: {member.filename} has compression {member.compress_type}, expected 0 (none) or 8 (deflate)"
        )
    packed = min(member.compress_size, path.stat().st_size)
    most = packed * (1 if member.compress_type == zipfile.ZIP_STORED else MOST_PER_BYTE)
    if member.file_size > most:
        raise ArgumentError(
            f"{path.name}: {member.filename} claims {member.file_size} bytes, expected at most {most} of the "
            f"{packed} bytes that the file has for it"
        )


def check_array(
    path: pathlib.Path, member: zipfile.ZipInfo, stream: IO[bytes], kinds: str, axes: int
) -> None:
    """Raises if the array of a member is of other kinds or axes, or claims more or less than the member has."""
    version = npy.read_magic(stream)
    if version not in _NPY_HEADERS:
        raise ArgumentError(
            f"{path.name}: {member.filename} is of version {version}, expected (1, 0) or (2, 0)"
        )
    shape, _, dtype = _NPY_HEADERS[version](stream)
    if dtype.kind not in kinds or len(shape) != axes:
        raise ArgumentError(
            f"{path.name}: {member.filename} is {dtype} with {len(shape)} axes, expected {_KINDS[kinds]} with {axes}"
        )
    claimed, has = math.prod(shape) * dtype.itemsize, member.file_size - stream.tell()
    if claimed != has:
        raise ArgumentError(f"{path.name}: {member.filename} claims {claimed} bytes of data, and has {has}")


def check_dataset(path: pathlib.Path, dataset: Any, name: str) -> None:
    """Raises if an array of an HDF5 file is no column of integers, or has less data than it claims."""
    if not hasattr(dataset, "shape") or dataset.dtype.kind not in "iub" or len(dataset.shape) != 1:
        raise ArgumentError(
            f"{path.name}: {name} is {dataset!r}, expected a dataset of integers with one axis"
        )
    count, each = dataset.shape[0], dataset.dtype.itemsize
    stored = min(dataset.id.get_storage_size(), path.stat().st_size)
    if dataset.chunks is None:
        if stored < count * each:
            raise ArgumentError(
                f"{path.name}: {name} claims {count * each} bytes, and the file has {stored} of them"
            )
        return
    (of_chunk,) = dataset.chunks
    # HDF5 makes up what is in chunks that are not there, and that takes memory too.
    chunks, expected = dataset.id.get_num_chunks(), -(-count // of_chunk)
    if chunks < expected:
        raise ArgumentError(
            f"{path.name}: {name} claims {expected} chunks of data, and the file has {chunks}"
        )
    claimed, most = expected * of_chunk * each, FEW_BYTES + MOST_PER_BYTE * stored
    if claimed > most:
        raise ArgumentError(
            f"{path.name}: {name} claims {claimed} bytes, expected at most {most} of the {stored} bytes that the "
            "file has for it"
        )
