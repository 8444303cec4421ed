"""Chunks unpacked by this program hold what the HDF5 library unpacks from them."""

import h5py
import numpy as np
import pytest

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
