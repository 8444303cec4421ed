"""The RSD solver in plain array operations gives the fused solver's numbers, in every library there is."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from recon.aperture import recognise
from recon.errors import ParameterError
from recon.grid import VoxelGrid
from recon.solvers.rsd import array as rsd_array
from recon.solvers.rsd.regular import LatticePropagator
from recon.wave import VirtualPulse
from support.hidden_points import C, wall

BAND = VirtualPulse(0.08).band(4e-9)
DETECTOR = np.array([0.03, -0.05, 0.0])
GRIDS = {
    "on the lattice": VoxelGrid(
        -0.15 + 0.02 * np.arange(12), -0.13 + 0.02 * np.arange(9), np.array([0.4, 0.61])
    ),
    "between": VoxelGrid(0.013 * np.arange(11), -0.1 + 0.031 * np.arange(7), np.array([0.4, 0.61])),
}


def emitted(laser_m):
    random = np.random.default_rng(5)
    shape = (len(BAND), len(laser_m))
    values = random.normal(size=shape) + 1j * random.normal(size=shape)
    return (values * BAND.weights[:, None]).astype(np.complex64)


def times_s(grid, confocal):
    """Moments (1, y, x) for each plane; or any one moment for a whole plane."""
    if confocal:
        return [np.full((1, 1, 1), 0.3e-9) for _ in grid.z_m]
    across = (grid.x_m - DETECTOR[0]) ** 2 + (grid.y_m[:, None] - DETECTOR[1]) ** 2
    return [np.sqrt(across + (z_m - DETECTOR[2]) ** 2)[None] / C for z_m in grid.z_m]


@pytest.mark.parametrize("library", ["numpy", "torch"])
@pytest.mark.parametrize("confocal", [False, True])
@pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS)
def test_equals_the_fused_solver(library, confocal, grid):
    pytest.importorskip(library, reason=f"{library} is not installed")
    laser_m = wall(16, 14, 0.02)
    arguments = recognise(laser_m), emitted(laser_m), BAND, grid, 2 if confocal else 1
    moments_s = times_s(grid, confocal)
    fused = LatticePropagator(*arguments)
    wanted = np.concatenate([fused.focus(*plane) for plane in zip(grid.z_m, moments_s, strict=True)])
    parts = []
    on = rsd_array.backend("cpu", library)
    # Few frequencies at a time, so that batches are added up too.
    planes = rsd_array.focus_block(*arguments, moments_s, parts.append, on=on, batch_bytes=5 * 64 * 40 * 40)
    found = np.concatenate(list(planes))
    # Both are single precision: 1e-7 for each of some 30 frequencies and as many FFT stages.
    assert np.abs(found - wanted).max() < 3e-5 * np.abs(wanted).max()
    assert parts == sorted(parts)
    assert parts[-1] == pytest.approx(1)


@pytest.mark.parametrize("library", ["numpy", "torch"])
@pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS)
def test_many_frames_equal_those_of_the_fused_solver(library, grid):
    pytest.importorskip(library, reason=f"{library} is not installed")
    laser_m = wall(16, 14, 0.02)
    arguments = recognise(laser_m), emitted(laser_m), BAND, grid, 1
    frames_s = np.linspace(2e-9, 4e-9, 7)[:, None, None]
    fused = LatticePropagator(*arguments)
    wanted = np.stack([fused.focus(z_m, frames_s) for z_m in grid.z_m])
    on = rsd_array.backend("cpu", library)
    planes = rsd_array.focus_block(*arguments, [frames_s] * 2, on=on, batch_bytes=5 * 64 * 40 * 40)
    found = np.stack(list(planes))
    assert found.shape == (2, 7, *grid.shape[1:])
    assert np.abs(found - wanted).max() < 3e-5 * np.abs(wanted).max()  # as above


def test_one_position_is_the_spherical_wave():
    grid = GRIDS["on the lattice"]
    laser_m = wall(16, 14, 0.02)
    spectra = np.zeros((len(BAND), len(laser_m)), np.complex64)
    spectra[:, 37] = BAND.weights
    found = np.concatenate(
        list(rsd_array.focus_block(recognise(laser_m), spectra, BAND, grid, 1, times_s(grid, False)))
    )
    z, y, x = np.meshgrid(grid.z_m, grid.y_m, grid.x_m, indexing="ij")
    voxels = np.stack([x, y, z], axis=-1)
    r_p, r_c = (np.linalg.norm(voxels - spot, axis=-1)[..., None] for spot in (laser_m[37], DETECTOR))
    wanted = np.exp(1j * BAND.frequencies_rad_per_s * (r_p + r_c) / C) / r_p @ BAND.weights
    assert np.abs(found - wanted).max() < 3e-5 * np.abs(wanted).max()


def test_what_is_missing_is_said_once_and_clearly(monkeypatch):
    with pytest.raises(ParameterError, match="Choose cpu"):
        rsd_array.backend("tpu")
    with pytest.raises(ParameterError, match="Choose cpu"):
        rsd_array.backend("cpu", "cupy")
    for name in ("torch", "cupy"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ParameterError, match=r"torch is not installed, cupy is not installed.* use cpu"):
        rsd_array.backend("cuda")


def test_needs_numpy_alone():
    script = "import sys; [sys.modules.__setitem__(n, None) for n in ('numba', 'ducc0', 'scipy', 'h5py')]; "
    script += (
        "from recon import aperture, capture, grid, sampling, spectrum, wave; import recon.solvers.rsd.array"
    )
    root = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=root, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
