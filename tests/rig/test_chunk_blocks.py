"""Chunks unpacked by this program hold what the HDF5 library unpacks from them."""

import struct

import h5py
import numpy as np
import pytest

from rig.errors import DataFileError
from rig.files.blocks import read


@pytest.mark.parametrize("most", [1, 255, 70_000], ids=["none", "bytes", "more"])
@pytest.mark.parametrize("dtype", ["u1", "<u2", "<u4", "<u8", "<i4", ">u4", "<f4", "<f8"])
def test_shuffled_numbers_of_every_kind_are_put_together(tmp_path, dtype, most):
    values = np.random.default_rng(3).integers(0, most, (37, 11)).astype(dtype)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("a", data=values, chunks=(8, 11), compression="gzip", shuffle=True)
    with h5py.File(tmp_path / "a.h5") as file:
        found = read(file["a"])
        assert found.dtype == values.dtype
        np.testing.assert_array_equal(found, file["a"][()])
        np.testing.assert_array_equal(read(file["a"], slice(5, 30)), values[5:30])


@pytest.mark.parametrize("packing", [{}, {"compression": "gzip"}], ids=["plain", "packed"])
@pytest.mark.parametrize("number", [50, 400])
@pytest.mark.parametrize("written", [0.0, 0.5, 1.0])
def test_chunks_that_were_never_written_are_found_however_many_there_are(tmp_path, packing, number, written):
    """Beyond a hundred their index is read once, in place of asking for each."""
    rng = np.random.default_rng(number)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        made = file.create_dataset("a", (2 * number, 9), "<u2", chunks=(2, 4), fillvalue=7, **packing)
        for first in 2 * np.flatnonzero(rng.random(number) < written):
            made[first : first + 2, 2:] = rng.integers(0, 1000, (2, 7))
        whole = made[()]
    with h5py.File(tmp_path / "a.h5") as file:
        np.testing.assert_array_equal(read(file["a"]), whole)
        np.testing.assert_array_equal(read(file["a"], slice(3, 90), slice(1, 9)), whole[3:90, 1:9])


def test_a_chunk_of_another_size_is_refused_among_many(tmp_path):
    """Of data that is not packed the library makes room for a chunk, and reads what the file says."""
    path, number, wrong = tmp_path / "a.h5", 400, 333
    with h5py.File(path, "w") as file:
        file.create_dataset("a", data=np.arange(2 * number, dtype="<u4"), chunks=(2,))
        info = file["a"].id.get_chunk_info(wrong)
    entry = struct.pack("<IIQQ", 8, 0, info.chunk_offset[0], 0) + struct.pack("<Q", info.byte_offset)
    content = path.read_bytes()
    assert content.count(entry) == 1
    path.write_bytes(content.replace(entry, struct.pack("<I", 800) + entry[4:]))
    with h5py.File(path) as file, pytest.raises(DataFileError, match="a chunk has 800 bytes of 8"):
        read(file["a"])
