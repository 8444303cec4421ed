"""The registry of solvers and cameras: what it says is so, and the page shows it."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hidden_points import histograms, wall

from recon.camera import PhotoCamera
from recon.capture import ArrayHistograms, Capture
from recon.errors import ReconError
from recon.grid import VoxelGrid
from recon.imaging import image
from recon.registry import CAMERAS, SOLVERS, as_markdown
from recon.solvers.classic.solve import baseline_image
from recon.wave import VirtualPulse

ROOT = Path(__file__).parents[2]
BIN_S = 16e-12
POINT_M = [0.1, 0.05, 0.7]
GRID = VoxelGrid.from_spec(0.6, 0.6, 0.05, (0.5, 0.9, 0.05))


@pytest.fixture(scope="module")
def confocal():
    laser_m = wall(16, 16, 0.06)
    counts = histograms([POINT_M], laser_m, laser_m, 800, BIN_S)
    return Capture(ArrayHistograms(counts), BIN_S, np.zeros(1), laser_m, laser_m)


def test_the_page_shows_the_table():
    assert as_markdown() in (ROOT / "docs" / "cameras.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", SOLVERS)
def test_every_solver_finds_the_point_and_gives_one_type_of_picture(confocal, name):
    info = SOLVERS[name]
    if info.wave:
        found = image(confocal, VirtualPulse(0.12), GRID, solver=name)
    else:
        found = baseline_image(confocal, GRID, solver=name)
    assert (found.solver, found.falloff_power) == (name, info.falloff_power)
    assert found.intensity.dtype == np.float32
    np.testing.assert_allclose(found.intensity, found.amplitude**2, rtol=1e-5)
    z, y, x = np.unravel_index(found.intensity.argmax(), found.intensity.shape)
    at_m = [GRID.x_m[x], GRID.y_m[y], GRID.z_m[z]]
    # voxels are 5 cm apart, and of the earlier methods bp is blurred by as much
    assert np.abs(np.subtract(at_m, POINT_M)).max() <= 0.051


@pytest.mark.parametrize("name", [name for name, info in SOLVERS.items() if info.wave])
def test_the_photo_camera_is_served_where_the_registry_says_so(confocal, name):
    def taken():
        return image(confocal, VirtualPulse(0.12), GRID, solver=name, camera=PhotoCamera())

    if "photo" in SOLVERS[name].cameras:
        assert taken().intensity.max() > 0
    else:
        with pytest.raises(ReconError):
            taken()


@pytest.mark.parametrize("name", [name for name, info in SOLVERS.items() if info.wave])
def test_a_bound_on_memory_is_kept_where_the_registry_says_so(confocal, name):
    def bounded():
        return image(confocal, VirtualPulse(0.12), GRID, solver=name, memory_bytes=2**30)

    if SOLVERS[name].takes("memory"):
        assert bounded().intensity.max() > 0
    else:
        with pytest.raises(ReconError, match="cannot keep to a bound"):
            bounded()


def test_names_are_known_without_anything_heavy():
    script = "import sys, recon.registry; print('numpy' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, timeout=60
    )
    assert done.stdout.strip() == "False", done.stderr
    assert all(camera in CAMERAS for info in SOLVERS.values() for camera in info.cameras)
