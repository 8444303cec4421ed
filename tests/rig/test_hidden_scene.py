"""The main job, whole: scan the simulated rig through its drivers, image the file, find the hidden letters.

The picture is compared with the scene's truth, not with a stored picture.
"""

import subprocess
import sys
from dataclasses import replace

import h5py
import numpy as np
import pytest
from matplotlib.image import imread

from recon.depth import compensate_falloff
from rig.files.volume import read_volume
from rig.show.saving import save
from rig.show.volume import volume_figure
from simulators.scenes import scene
from support.thorough import THOROUGH

#: Bytes that a scan of the whole wall may take at most, whatever the number of positions.
SCAN_MEMORY = 500e6


#: Runs the command, and at its end tells the most memory that it held, as Linux counts it for the program
#: alone (what `wait4` tells begins with the memory of the process that was forked).
COMMAND = """
import atexit, pathlib, sys
from rig.__main__ import main
status = pathlib.Path("/proc/self/status")  # Linux has it; elsewhere the memory is not looked at
atexit.register(lambda: print(status.read_text() if status.exists() else "VmHWM: 0 kB", file=sys.stderr))
main()
"""


def rig(*arguments, folder):
    """Run a command and return the most memory that it held [bytes]."""
    done = subprocess.run(
        [sys.executable, "-c", COMMAND, *arguments], cwd=folder, capture_output=True, text=True, timeout=280
    )
    assert done.returncode == 0, done.stderr
    most = next(line for line in done.stderr.splitlines() if line.startswith("VmHWM"))
    return int(most.split()[1]) * 1024


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The whole wall at 10 ms a position, scanned and imaged as a user would; every third row and column."""
    folder = tmp_path_factory.mktemp("main-job")
    grid = () if THOROUGH else ("--grid", "60x44", "--spacing", "3cm")
    assert rig("scan", "--exposure", "10ms", *grid, "--out", "scan.h5", folder=folder) < SCAN_MEMORY
    rig("recon", "scan.h5", "--image", "picture.png", folder=folder)
    return folder


@pytest.fixture(scope="module")
def volume(folder):
    return read_volume(folder / "scan-volume.h5")


def overlap(a, b):
    return (a & b).sum() / (a | b).sum()


def test_the_photons_are_as_many_as_the_papers(folder):
    with h5py.File(folder / "scan.h5") as file:
        photons = file["stop"].attrs["photons"]
        positions = file["transients/counts"].shape[0]
    # Table 1, office at 10 ms: 48 017 499 photons over 23 400 positions; the default bench is tuned to it
    assert photons / positions == pytest.approx(48_017_499 / 23_400, rel=0.05)


def test_the_letters_stand_where_they_are_and_read_right(volume):
    truth = scene("letters").truth(volume.x_m, volume.y_m)
    seen, hidden = np.isfinite(volume.depth_m), np.isfinite(truth.depth_m)
    # Strokes are 9 cm wide. An edge is blurred over 0.61 lambda L/d, 1.5 cm (F) to 2.8 cm (R) with the wall's
    # height; half of that on both sides of a stroke would leave an overlap of about (9 - 2)/(9 + 2) = 0.64.
    assert overlap(seen, hidden) > 0.75
    # a mirrored or upside-down picture overlaps far less
    assert overlap(seen[:, ::-1], hidden) < 0.5
    assert overlap(seen[::-1], hidden) < 0.6
    assert overlap(np.roll(seen, 5, axis=1), hidden) < overlap(seen, hidden) - 0.1


@pytest.mark.parametrize("letter", [0, 1])
def test_each_letter_is_at_its_depth(volume, letter):
    truth = scene("letters").truth(volume.x_m, volume.y_m)
    of_letter = truth.mesh == letter
    found = of_letter & np.isfinite(volume.depth_m)
    error_m = volume.depth_m[found] - truth.depth_m[found]
    assert found.sum() > 0.8 * of_letter.sum()
    assert abs(np.median(error_m)) < 0.02
    assert np.percentile(np.abs(error_m), 90) < 0.02


def test_the_picture_is_that_of_the_volume(folder, volume):
    seen = replace(volume, intensity=compensate_falloff(volume.intensity, volume.z_m, 4))
    save(volume_figure(seen, compensation="z⁴"), folder / "again.png")
    np.testing.assert_array_equal(imread(folder / "picture.png"), imread(folder / "again.png"))
