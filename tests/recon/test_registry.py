"""The registry names what exists, loads nothing until it is asked, and the pages show what it says."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from recon import registry
from recon.camera import PhotoCamera
from recon.capture import ArrayHistograms, Capture
from recon.errors import ReconError
from recon.grid import VoxelGrid
from recon.imaging import image
from recon.solvers.classic.solve import baseline_image
from recon.wave import VirtualPulse
from support.hidden_points import histograms, wall

ROOT = Path(__file__).parents[2]
BIN_S = 16e-12
POINT_M = [0.1, 0.05, 0.7]
GRID = VoxelGrid.from_spec(0.6, 0.6, 0.05, (0.5, 0.9, 0.05))


@pytest.fixture(scope="module")
def confocal():
    laser_m = wall(16, 16, 0.06)
    counts = histograms([POINT_M], laser_m, laser_m, 800, BIN_S)
    return Capture(ArrayHistograms(counts), BIN_S, np.zeros(1), laser_m, laser_m)


@pytest.mark.parametrize("name", registry.SOLVERS)
def test_every_place_is_there(name):
    entry = registry.SOLVERS[name]
    for place in (entry.place, entry.needs, entry.warnings):
        assert place is None or callable(registry.load(place))
    assert set(entry.refuses) <= set(registry.CAMERAS)


def test_the_pages_show_the_tables():
    assert registry.wave_table() in (ROOT / "docs" / "cameras.md").read_text(encoding="utf-8")
    assert registry.classic_table() in (ROOT / "docs" / "baselines.md").read_text(encoding="utf-8")


def test_names_are_offered_without_any_library():
    script = "import sys, recon.registry; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", script], cwd=ROOT, timeout=60).returncode == 0


@pytest.mark.parametrize("name", registry.SOLVERS)
def test_every_solver_finds_the_point_and_gives_one_type_of_picture(confocal, name):
    entry = registry.SOLVERS[name]
    if entry.virtual_wave:
        found = image(confocal, VirtualPulse(0.12), GRID, solver=name)
    else:
        found = baseline_image(confocal, GRID, solver=name)
    assert (found.solver, found.falloff_power) == (name, entry.falloff_power)
    np.testing.assert_allclose(found.intensity, found.amplitude**2, rtol=1e-5)
    z, y, x = np.unravel_index(found.intensity.argmax(), found.intensity.shape)
    at_m = [GRID.x_m[x], GRID.y_m[y], GRID.z_m[z]]
    # voxels are 5 cm apart, and of the earlier methods bp is blurred by as much
    assert np.abs(np.subtract(at_m, POINT_M)).max() <= 0.051


@pytest.mark.parametrize("name", registry.WAVE_SOLVERS)
def test_the_photo_camera_is_refused_where_the_registry_says_so(confocal, name):
    def taken():
        return image(confocal, VirtualPulse(0.12), GRID, solver=name, camera=PhotoCamera())

    if "photo" in registry.SOLVERS[name].refuses:
        with pytest.raises(ReconError):
            taken()
    else:
        assert taken().intensity.max() > 0


@pytest.mark.parametrize("name", registry.WAVE_SOLVERS)
def test_a_bound_on_memory_is_kept_where_the_registry_says_so(confocal, name):
    def bounded():
        return image(confocal, VirtualPulse(0.12), GRID, solver=name, memory_bytes=2**30)

    if registry.SOLVERS[name].needs:
        assert bounded().intensity.max() > 0
    else:
        with pytest.raises(ReconError, match="has no limit of memory"):
            bounded()
