"""Damaged, foreign and incomplete files at the command line: one message, the right code, nothing left."""

import h5py
import numpy as np
import pytest
import scipy.io

from rig.files import ScanDescription, ScanWriter


def write_scan(path):
    x, y = np.meshgrid(np.arange(8) * 0.05, np.arange(6) * 0.05)
    laser_m = np.stack([x.ravel(), y.ravel(), np.zeros(48)], axis=1)
    with ScanWriter.create(path, ScanDescription(laser_m, np.zeros((1, 3)), 2000, 16e-12, 0.0)) as writer:
        for _ in range(48):
            writer.append(np.ones(2000, np.uint32))


def truncated(path):
    write_scan(path)
    path.write_bytes(path.read_bytes()[:3000])


def foreign(path):
    with h5py.File(path, "w") as file:
        file["temperature"] = [1.0, 2.0]


def text(path):
    path.write_text("not a measurement\n")


def mat_without_arrays(path):
    scipy.io.savemat(path, {"something": np.eye(3)})


def without_geometry(path):
    write_scan(path)
    with h5py.File(path, "r+") as file:
        del file["geometry/laser_m"]


@pytest.mark.parametrize("make", [truncated, foreign, text, mat_without_arrays, without_geometry])
@pytest.mark.parametrize("verb", ["recon", "resume", "import"])
def test_a_file_that_cannot_be_read_is_named(rig, tmp_path, make, verb):
    path = tmp_path / ("bad.mat" if make is mat_without_arrays else "bad.h5")
    make(path)
    before = path.read_bytes()
    done = rig(verb, path, *(["out.h5"] if verb == "import" else []))
    assert done.code == 5, done.err
    assert path.name in done.err
    assert done.err.count("\n") == 1  # one message
    assert "Traceback" not in done.err
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    assert path.read_bytes() == before


@pytest.mark.parametrize("verb", ["recon", "resume", "import"])
def test_a_file_that_is_not_there_is_named(rig, tmp_path, verb):
    done = rig(verb, "nowhere.h5", *(["out.h5"] if verb == "import" else []))
    assert done.code == 5
    assert "nowhere.h5" in done.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "code", "told"),
    [
        (("--wavelength", "4"), 2, "4cm"),
        (("--depth", "1m:2m"), 2, "--depth 0.5m:3m:2cm"),
        (("--depth", "2m:1m:1cm"), 2, "depths must start in front of the wall"),
        (("--depth", "20m:21m:1cm"), 2, "the record holds"),
        (("--solver", "guess"), 2, "guess"),
        (("--out", "nowhere/v.h5"), 2, "nowhere"),
    ],
)
def test_an_image_that_cannot_be_made_is_refused(rig, tmp_path, arguments, code, told):
    write_scan(tmp_path / "a.h5")
    done = rig("recon", "a.h5", *arguments)
    assert done.code == code, done.err
    assert told in done.err
    assert "Traceback" not in done.err
    assert [p.name for p in tmp_path.iterdir()] == ["a.h5"]


def test_errors_are_json_when_asked(rig, tmp_path):
    import json

    done = rig("recon", "nowhere.h5", "--json")
    assert json.loads(done.out)["exit_code"] == 5


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--voxel", "0.0001mm", "--depth", "0.5m:1m:1cm"), "Voxels of"),
        (("--voxel", "5cm", "--depth", "0.5m:3m:0.01nm"), "Steps in depth of"),
        (("--voxel", "1nm", "--depth", "0.5m:3m:1nm"), "and steps in depth of"),
        (("--voxel", "0m"), "must be finite and positive"),
        (("--width", "1e300m", "--voxel", "1e-300m"), "would fit"),
        (("--wavelength", "1e300m"), "not between"),
        (("--cycles", "1e308"), "a pulse has"),
        (("--camera", "transient", "--frames", "0ns:1s:1fs"), "100,000 at most"),
    ],
)
def test_more_voxels_than_there_can_be_are_refused_with_the_least_change(rig, tmp_path, arguments, told):
    write_scan(tmp_path / "a.h5")
    done = rig("recon", "a.h5", *arguments)
    assert done.code == 2, done.err
    assert told in done.err
    assert [p.name for p in tmp_path.iterdir()] == ["a.h5"]


def test_the_change_that_is_told_fits(rig, tmp_path):
    import re

    write_scan(tmp_path / "a.h5")
    told = rig("recon", "a.h5", "--depth", "0.5m:1m:0.00001mm", "--voxel", "5cm").err
    step = re.search(r"Steps in depth of (\S+) would", told)[1]
    from recon.grid import VoxelGrid
    from rig.model.quantities import parse

    grid = VoxelGrid.from_spec(0.4, 0.3, 0.05, (0.5, 1.0, parse(step, "length")))
    # two digits are told, rounded up: a tenth too coarse at most
    assert 900_000 < len(grid.z_m) <= 1_000_000
