"""Walls that are not flat keep their depth: a hidden point is imaged where it is."""

import numpy as np
import pytest
import scipy.io
from imported import brightest, load, point_signal

from rig.errors import UsageError
from rig.importers import import_scan

POINT_M = np.array([0.1, -0.08, 0.7])
AROUND = ("--wavelength", "12cm", "--depth", "0.5m:0.9m:1cm")
#: Within this of the point: a voxel across (the spots' spacing is 4 cm), and two along z.
WITHIN_M = np.array([0.041, 0.041, 0.021])


def bulging(count=20):
    """(n, n, 3) whole numbers: depth index 0 to 12, x and y index of a wall that bulges into the room."""
    x, y = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
    from_middle = ((x - (count - 1) / 2) ** 2 + (y - (count - 1) / 2) ** 2) / count**2
    return np.stack([np.rint(12 * np.exp(-8 * from_middle)).astype(int), x, y], axis=-1)


@pytest.mark.parametrize("confocal", [True, False])
def test_depth_indices_of_the_wall_are_kept(rig, tmp_path, confocal):
    lit = bulging().reshape(-1, 3)
    seen = lit if confocal else np.tile([12, 10, 9], (len(lit), 1))
    lit_m, seen_m = (
        np.column_stack([(one[:, 1] - 9.5) * 0.04, (one[:, 2] - 9.5) * 0.04, one[:, 0] * 0.01])
        for one in (lit, seen)
    )
    signal = point_signal(POINT_M, lit_m, seen_m, 450, 16e-12)
    for name, value in {"sub_Sig": signal, "C_i": lit, "C_d": seen}.items():
        scipy.io.savemat(tmp_path / f"{name}.mat", {name: value})
    given = ("--bin-width", "16ps", "--wall-size", "76cm")
    asked = rig("import", "sub_Sig.mat", "a.h5", *given)
    assert asked.code == 2
    assert "depth indices up to 12; give it with --depth-pitch" in asked.err
    done = rig("import", "sub_Sig.mat", "a.h5", *given, "--depth-pitch", "1cm")
    assert (done.code, "reaches z = 0.12 m" in done.out) == (0, True)
    capture, _ = load(tmp_path / "a.h5")
    np.testing.assert_allclose(capture.laser_m, lit_m, atol=1e-12)
    np.testing.assert_allclose(capture.detector_m, seen_m if confocal else seen_m[:1], atol=1e-12)
    assert (np.abs(brightest(rig, "a.h5", *AROUND) - POINT_M) < WITHIN_M).all()


def test_a_flat_wall_needs_no_depth_pitch(tmp_path):
    lit = bulging().reshape(-1, 3) * [0, 1, 1]
    for name, value in {"sub_Sig": np.ones((400, 5)), "C_i": lit, "C_d": lit}.items():
        scipy.io.savemat(tmp_path / f"{name}.mat", {name: value})
    report = import_scan(tmp_path / "sub_Sig.mat", tmp_path / "a.h5", bin_width_s=16e-12, wall_size_m=0.76)
    assert any("flat" in line for line in report.assumed)
    assert not load(tmp_path / "a.h5")[0].laser_m[:, 2].any()


def test_a_depth_pitch_must_be_a_length(tmp_path):
    lit = bulging().reshape(-1, 3)
    for name, value in {"sub_Sig": np.ones((400, 5)), "C_i": lit, "C_d": lit}.items():
        scipy.io.savemat(tmp_path / f"{name}.mat", {name: value})
    given = {"bin_width_s": 16e-12, "wall_size_m": 0.76}
    with pytest.raises(UsageError, match="must be positive"):
        import_scan(tmp_path / "sub_Sig.mat", tmp_path / "a.h5", **given, depth_pitch_m=-0.01)
