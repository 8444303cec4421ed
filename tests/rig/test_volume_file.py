"""A volume file gives back the volume, appears whole or not at all, and never takes another file's place."""

import os

import h5py
import numpy as np
import pytest

from rig.errors import DataFileError, UsageError
from rig.files import Volume, read_volume, write_volume


def volume(**changes):
    rng = np.random.default_rng(3)
    depth_m = rng.uniform(1, 2, (5, 6)).astype("f4")
    depth_m[0, :3] = np.nan
    given = {
        "intensity": rng.random((4, 5, 6), "f4"),
        "x_m": np.linspace(-0.5, 0.5, 6),
        "y_m": np.linspace(-0.4, 0.4, 5),
        "z_m": np.linspace(1, 2, 4),
        "depth_m": depth_m,
        "parameters": {"wavelength_m": 0.04, "solver": "rsd"},
        "scan": "letters.h5",
        "scan_digest": "ab" * 32,
    }
    return Volume(**(given | changes))


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"depth_m": None},
        {"intensity": np.ones((3, 4, 5, 6), "f4"), "t_s": np.arange(3.0)},
        {"intensity": np.ones((3, 5, 6), "f4"), "t_s": np.arange(3.0)},
    ],
)
def test_what_is_written_is_read_back(tmp_path, changes):
    path = tmp_path / "v.h5"
    wrote = volume(**changes)
    write_volume(path, volume())
    write_volume(path, wrote)  # one of ours is replaced
    read = read_volume(path)
    for name in ("intensity", "x_m", "y_m", "z_m", "depth_m", "t_s"):
        if getattr(wrote, name) is None:
            assert getattr(read, name) is None
        else:
            np.testing.assert_array_equal(getattr(read, name), getattr(wrote, name))
    assert (read.parameters, read.scan, read.scan_digest) == (wrote.parameters, "letters.h5", "ab" * 32)
    assert os.listdir(tmp_path) == ["v.h5"]
    with h5py.File(path) as file:
        assert file["volume/intensity"].dtype == "f4"
        assert "depth" in file["volume/z_m"].attrs["description"]


def test_another_file_is_never_replaced(tmp_path):
    path = tmp_path / "v.h5"
    path.write_bytes(b"precious")
    with pytest.raises(UsageError, match="not overwritten"):
        write_volume(path, volume())
    assert path.read_bytes() == b"precious"
    with h5py.File(path, "w") as file:
        file.attrs["format"] = "rig-scan"
    with pytest.raises(UsageError, match="not overwritten"):
        write_volume(path, volume())


def test_a_failure_leaves_the_old_file(tmp_path):
    path = tmp_path / "v.h5"
    write_volume(path, volume())
    before = path.read_bytes()
    with pytest.raises(TypeError):
        write_volume(path, volume(parameters={"a": object()}))
    with pytest.raises(ValueError, match="intensity has shape"):
        write_volume(path, volume(z_m=np.arange(3.0)))
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["v.h5"]
    with pytest.raises(UsageError, match="does not exist"):
        write_volume(tmp_path / "nowhere" / "v.h5", volume())


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (lambda file: file.pop("volume/z_m"), "/volume/z_m is missing"),
        (lambda file: file.attrs.pop("format"), "no format attribute"),
        (lambda file: file.attrs.__setitem__("version", 9), "version 9"),
        (lambda file: file.attrs.__setitem__("parameters", "{"), "damaged"),
        (lambda file: (file.pop("volume/x_m"), file.__setitem__("volume/x_m", np.arange(3.0))), "shape"),
        (
            lambda file: (file.pop("volume/z_m"), file.__setitem__("volume/z_m", np.arange(3.0))),
            "is not consistent",
        ),
    ],
)
def test_what_is_wrong_is_named(tmp_path, edit, said):
    path = tmp_path / "v.h5"
    write_volume(path, volume())
    with h5py.File(path, "r+") as file:
        edit(file)
    with pytest.raises(DataFileError, match=said):
        read_volume(path)


def test_a_cut_file_is_refused(tmp_path):
    path = tmp_path / "v.h5"
    write_volume(path, volume())
    content = path.read_bytes()
    for length in range(0, len(content), 211):
        path.write_bytes(content[:length])
        with pytest.raises(DataFileError, match=r"v\.h5"):
            read_volume(path)
