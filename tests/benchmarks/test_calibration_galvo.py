"""How well `rig calibrate galvo` finds the truth, over 20 seeds with all faults and misalignments: a table.

    pytest -n 0 --timeout 0 --benchmark-only -s tests/benchmarks/test_calibration_galvo.py

Each mount takes some ten minutes with cameras, and one by times of flight.
"""

import numpy as np
import pytest

from rig.acquire.acquisition import Watch
from rig.calibrate.galvo.flight import FlightRoutine
from rig.calibrate.galvo.mirror import spot_covariances_m2
from rig.calibrate.galvo.routine import CameraRoutine
from rig.calibrate.run import measured
from rig.commands.operator import ConsoleOperator
from rig.model.plan import ScanPlan
from rig.model.state import RigState
from support.misaligned import errors_m, misaligned, true_spots_m

SEEDS = 20


@pytest.mark.parametrize("incidence", [None, "22.5deg", "45deg"])
@pytest.mark.parametrize("routine", [FlightRoutine(), CameraRoutine()], ids=["flight", "cameras"])
def test_accuracy_of_the_mirror(benchmark, routine, incidence, tmp_path):
    """Errors of the default scan's spots [mm], and the rms of errors in their standard errors."""
    rows = benchmark.pedantic(
        lambda: [accuracy(routine, misaligned(seed, incidence=incidence), tmp_path) for seed in range(SEEDS)],
        rounds=1,
    )
    before_mm = 1e3 * np.linalg.norm(errors_as_configured_m(misaligned(incidence=incidence)), axis=1)
    print(f"\nbefore: {np.sqrt((before_mm**2).mean()):.0f} mm rms, {before_mm.max():.0f} mm worst")
    print(f"{'seed':>4} {'rms mm':>7} {'worst mm':>8} {'pull':>5}")
    for seed, row in enumerate(rows):
        print(f"{seed:4d} {row[0]:7.3f} {row[1]:8.3f} {row[2]:5.2f}")
    rms, worst, pull = np.array(rows).T
    print(f" all {np.sqrt((rms**2).mean()):7.3f} {worst.max():8.3f} {np.sqrt((pull**2).mean()):5.2f}")


def errors_as_configured_m(config):
    """How far the beam is from the scan's spots without a calibration."""
    spots_m = ScanPlan.grid(config).spots_m[::23]
    return true_spots_m(config, RigState(config).pointing.angles_rad(spots_m)) - spots_m[:, :2]


def accuracy(routine, config, folder):
    """Measure and fit one rig."""
    files = measured(routine, config, ConsoleOperator(), folder, Watch())
    found = routine.fit(files, RigState(config))
    for path in files:
        path.unlink()
    spots_m = ScanPlan.grid(config).spots_m[::23]
    off_m = errors_m(found, config, spots_m)
    pointing = found.pointing()
    spread_m2 = spot_covariances_m2(pointing, np.array(found.covariance), pointing.angles_rad(spots_m))
    pulls = off_m / np.sqrt(np.einsum("nii->ni", spread_m2))
    apart_mm = 1e3 * np.linalg.norm(off_m, axis=1)
    return np.sqrt((apart_mm**2).mean()), apart_mm.max(), np.sqrt((pulls**2).mean())
