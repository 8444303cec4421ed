"""``rig recon`` with the earlier methods: a hidden point in, its place out; what is approximate is said."""

import json

import h5py
import numpy as np
import pytest

from recon.capture import C_M_PER_S
from rig.files import read_volume

POINT = np.array([0.06, -0.03, 0.55])


@pytest.fixture
def scan(rig, tmp_path):
    """Make a scan file of a hidden point on a 17 x 17 grid, confocal or with one detector spot."""

    def make(confocal):
        axis = np.linspace(-0.2, 0.2, 17)
        x, y = (values.ravel() for values in np.meshgrid(axis, axis))
        laser_m = np.stack([x, y, np.zeros(x.size)], axis=1)
        detector_m = laser_m if confocal else np.array([[0.02, 0.01, 0.0]])
        path_m = np.linalg.norm(laser_m - POINT, axis=1) + np.linalg.norm(detector_m - POINT, axis=1)
        counts = np.zeros((x.size, 500), np.uint32)
        counts[np.arange(x.size), (path_m / C_M_PER_S / 16e-12).astype(int)] = 100
        with h5py.File(tmp_path / "point.h5", "w") as file:
            file["counts"] = counts
            file["laser_position_m"], file["detector_position_m"] = laser_m, detector_m
            file["time_s"] = (np.arange(500) + 0.5) * 16e-12
            file.attrs.update(bin_width_s=16e-12, time_origin="wall", confocal=confocal)
        assert rig("import", "point.h5", "scan.h5").code == 0
        return tmp_path / "scan.h5"

    return make


@pytest.mark.parametrize("solver", ["bp", "laplacian-fbp", "log-fbp", "lct", "fk"])
@pytest.mark.parametrize("confocal", [True, False])
def test_point_is_found(rig, scan, solver, confocal):
    path = scan(confocal)
    done = rig("recon", path, "--solver", solver, "--depth", "0.45m:0.65m:1cm", "--json")
    assert done.code == 0, done.err
    told = json.loads(done.out)
    assert told["solver"] == solver
    assert not [key for key in told if "wavelength" in key]
    assert told.get("snr") == (0.8 if solver == "lct" else None)
    approximate = solver in ("lct", "fk") and not confocal
    assert any("approximation" in sentence for sentence in told["warnings"]) == approximate
    volume = read_volume(told["volume"])
    k, j, i = np.unravel_index(volume.intensity.argmax(), volume.intensity.shape)
    # A voxel of 2.5 cm across; in depth a plane, and for midpoints the 1 cm that moveout is short by.
    assert [volume.x_m[i], volume.y_m[j]] == pytest.approx(POINT[:2], abs=0.025)
    assert volume.z_m[k] == pytest.approx(POINT[2], abs=0.021 if approximate else 0.011)


def test_what_the_record_does_not_hold_is_said_of_each_method(rig, scan):
    """The record ends at 2.4 m of path, which is 1.2 m of depth."""
    path = scan(True)
    told = json.loads(rig("recon", path, "--solver", "bp", "--depth", "1m:1.3m:10cm", "--json").out)
    assert any("the record ends at 2.40 m of path" in sentence for sentence in told["warnings"])


def test_ratio_is_taken_where_it_has_a_meaning(rig, scan):
    path = scan(True)
    assert json.loads(rig("recon", path, "--solver", "lct", "--snr", "3", "--json").out)["snr"] == 3
    for solver in ("fk", "rsd"):
        refused = rig("recon", path, "--solver", solver, "--snr", "3")
        assert refused.code == 2
        assert "--snr is for --solver lct" in refused.err


def test_summary_names_the_solver(rig, scan):
    done = rig("recon", scan(True), "--solver", "fk")
    assert done.code == 0
    assert "solver" in done.out
    assert "cycles" not in done.out


@pytest.mark.parametrize("solver", ["bp", "lct"])
@pytest.mark.parametrize("option", [("--memory", "2GB"), ("--device", "cuda")])
def test_what_only_virtual_waves_have_is_refused(rig, scan, solver, option):
    refused = rig("recon", scan(True), "--solver", solver, *option)
    assert refused.code == 2
    assert f"{option[0]} would have no effect" in refused.err
