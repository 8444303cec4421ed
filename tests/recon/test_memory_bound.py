"""The memory of imaging stays below its bound, as the system counts it, and the image is the same."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from recon.camera import TransientCamera
from recon.capture import ArrayHistograms, Capture
from recon.errors import MemoryBoundError, ParameterError
from recon.filming import video
from recon.grid import VoxelGrid
from recon.imaging import image
from recon.sampling import CONFOCAL
from recon.wave import VirtualPulse
from support.hidden_points import histograms, wall
from support.thorough import some

PULSE = VirtualPulse(0.06, 6)
BIN = 16e-12


def capture(side, pitch_m, shape="grid"):
    laser_m = wall(side, side, pitch_m)
    random = np.random.default_rng(4)
    if shape != "grid":
        laser_m[:, :2] += random.uniform(-pitch_m / 3, pitch_m / 3, (len(laser_m), 2))
    if shape == "curved":
        laser_m[:, 2] = 0.1 * laser_m[:, 0] ** 2
    detector_m = np.array([[0.1, -0.05, 0.0]])
    counts = histograms([[0.1, 0.05, 0.7]], laser_m, detector_m, 800, BIN)
    return Capture(ArrayHistograms(counts), BIN, np.zeros(1), laser_m, detector_m)


def voxels(side, planes, width_m=1.0):
    axis = np.linspace(-width_m / 2, width_m / 2, side)
    return VoxelGrid(axis, axis, np.linspace(0.5, 0.9, planes))


SCRIPT = """
import json, sys
sys.path[:0] = ["tests", "tests/recon"]
from test_memory_bound import PULSE, capture, image, moments, video, voxels
def status(name):
    with open("/proc/self/status") as status:
        return next(1024 * int(line.split()[1]) for line in status if line.startswith(name))
side, voxel_side, planes, width_m, shape, bound, *frames = json.loads(sys.argv[1])
taken, grid = capture(side, 1.5 / side, shape), voxels(voxel_side, planes, width_m)
for fft in {"grid": (True,), "jittered": (False, True), "curved": (False,)}[shape]:
    # libraries, compiled code, threads are not imaging's
    image(capture(8, 0.05, shape), PULSE, voxels(4, 2), fft=fft)
with open("/proc/self/clear_refs", "w") as peak:
    peak.write("5")  # the peak begins anew
before = status("VmRSS")
if frames:
    video(taken, PULSE, grid, moments(*frames), memory_bytes=bound)
else:
    image(taken, PULSE, grid, memory_bytes=bound)
print(status("VmHWM") - before)
"""


def peak_bytes(*arguments):
    """Peak of resident memory while imaging, above what was resident before."""
    if not Path("/proc/self/clear_refs").exists():
        pytest.skip("only Linux tells the peak of a part of a run")
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, json.dumps(arguments)],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return int(done.stdout)


def moments(count):
    return TransientCamera(2e-9 + 40e-12 * np.arange(count))


def least_bytes(taken, grid, frames=1):
    camera = moments(frames) if frames > 1 else CONFOCAL
    make = video if frames > 1 else image
    with pytest.raises(MemoryBoundError, match="image fewer voxels") as refusal:
        make(taken, PULSE, grid, camera=camera, memory_bytes=1000)
    return int(re.search(r"Allow (\d+) MB", str(refusal.value)).group(1)) * 10**6


SMALL, LARGE = (64, 40, 12, 1.0), (96, 64, 2, 6.0)


@pytest.mark.parametrize(
    ("shape", "size"),
    some(("grid", LARGE), ("jittered", SMALL), ("grid", SMALL), ("jittered", LARGE), short=3),
)
def test_peak_stays_below_the_bound(size, shape):
    side, voxel_side, planes, width_m = size
    least = least_bytes(capture(side, 1.5 / side, shape), voxels(voxel_side, planes, width_m))
    assert peak_bytes(*size, shape, least) <= least
    if width_m > 1:
        assert peak_bytes(*size, shape, None) > least


def test_tables_stay_below_the_bound():
    least = least_bytes(capture(48, 1.5 / 48, "curved"), voxels(32, 6))
    assert peak_bytes(48, 32, 6, 1.0, "curved", least) <= least


@pytest.mark.parametrize("shape", ["grid", "jittered", "curved"])
def test_a_video_stays_below_the_bound(shape):
    side, size = (32, (48, 3)) if shape != "curved" else (16, (24, 3))
    frames = 100
    taken, grid = capture(side, 1.5 / side, shape), voxels(*size)
    least = least_bytes(taken, grid, frames)
    assert peak_bytes(side, *size, 1.0, shape, least, frames) <= least
    whole, cut = (video(taken, PULSE, grid, moments(frames), memory_bytes=b) for b in (None, least))
    assert np.array_equal(whole.intensity, cut.intensity)


@pytest.mark.parametrize("shape", ["grid", "jittered", "curved"])
def test_a_bound_changes_no_number(shape):
    taken, grid = capture(24, 1.5 / 24, shape), voxels(24, 12)
    least = least_bytes(taken, grid)
    parts = []
    whole = image(taken, PULSE, grid).field
    cut = image(taken, PULSE, grid, memory_bytes=least, progress=parts.append).field
    # Runs share the whole band's lattice. Single precision: 1e-7 for each of a hundred frequencies.
    assert np.abs(cut - whole).max() < 1e-5 * np.abs(whole).max()
    assert parts == sorted(parts)
    assert parts[-1] == pytest.approx(1)


def test_the_fresnel_solver_keeps_to_a_bound_too():
    taken = capture(24, 1.5 / 24)
    # On the wall's lattice: between its points the paraxial wave is read rightly only up to 45 degrees.
    axis_m = taken.laser_m[:24, 0]
    grid = VoxelGrid(axis_m, axis_m, np.linspace(0.5, 0.9, 12))
    least = least_bytes(taken, grid)
    whole, cut = (image(taken, PULSE, grid, solver="fresnel", memory_bytes=b).field for b in (None, least))
    # Single precision: 1e-7 for each of some 30 frequencies and as many FFT stages.
    assert np.abs(cut - whole).max() < 3e-5 * np.abs(whole).max()


@pytest.mark.parametrize("solver", ["direct", "backprojection"])
def test_solvers_that_keep_to_no_bound_say_so(solver):
    with pytest.raises(ParameterError, match=f"solver {solver}: .*has no limit of memory.* rsd or fresnel"):
        image(capture(8, 0.05), PULSE, voxels(4, 2), solver=solver, memory_bytes=10**9)
    with pytest.raises(ParameterError, match=f"solver {solver}: asked for device cuda"):
        image(capture(8, 0.05), PULSE, voxels(4, 2), solver=solver, device="cuda")
