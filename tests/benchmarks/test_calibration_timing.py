"""Time zero and response against the bench's truth, 20 seeds, all faults and misalignment on.

    pytest tests/benchmarks/test_calibration_timing.py -n 0 --benchmark-only -s

prints a table; nothing is asserted.
"""

from pathlib import Path

import numpy as np
import pytest

from rig.acquire.acquisition import Watch
from rig.calibrate.run import measured
from rig.calibrate.timing.irf import ResponseRoutine
from rig.calibrate.timing.time_zero import TimeZeroRoutine
from rig.files.scan import ScanFile
from rig.model.calibrations.chosen import Calibrations
from rig.model.state import RigState
from support.misaligned import galvo_calibration, misaligned_at_random, true_delays_s, true_width_s

SEEDS = 20
#: Error of each measured spot along x and y.
SPOT_ERROR_M = 0.5e-3


def rectified_errors_s(found, config, known, mirror_rad) -> np.ndarray:
    """(N,) what a scan with this calibration subtracts, less what it should."""
    spots_m = RigState(config, known).pointing.spots_m(mirror_rad)
    return found.legs.delay_s(spots_m, np.array([found.detector_spot_m])) - true_delays_s(config, mirror_rad)


def one_seed(seed: int, folder: Path) -> dict:
    """Measure both calibrations on one rig, and return how wrong they are."""
    config = misaligned_at_random(seed, folder / "calibrations")
    routine, response = TimeZeroRoutine(), ResponseRoutine()
    files = measured(routine, config, None, folder, Watch())
    with ScanFile(files[0]) as scan:
        mirror_rad = scan.mirror_rad
    row = {"seed": seed}
    ways = {"": galvo_calibration(config, SPOT_ERROR_M, seed), "uncalibrated ": Calibrations()}
    for way, known in ways.items():
        found = routine.fit(files, RigState(config, known))
        errors_s = rectified_errors_s(found, config, known, mirror_rad)
        row[f"{way}median"] = float(np.median(np.abs(errors_s))) * 1e12
        row[f"{way}worst"] = float(np.abs(errors_s).max()) * 1e12
        row[f"{way}said"] = found.rectified_error_s * 1e12
        row[f"{way}pull"] = float(np.median(errors_s)) / found.rectified_error_s
        row[f"{way}chi2"] = found.chi2
        if way:
            row["warned"] = len(found.warnings)
        else:
            row["drift"] = found.drift_per_minute_s * 1e12
            row["drift pull"] = (found.drift_per_minute_s - 1e-12) / found.drift_per_minute_error_s
    got = response.fit(measured(response, config, None, folder, Watch()), RigState(config))
    row["width"] = (got.fwhm_s - true_width_s()) * 1e12
    row["width pull"] = (got.fwhm_s - true_width_s()) / got.fwhm_error_s
    return row


@pytest.mark.timeout(3600)
def test_timing_calibrations(benchmark, tmp_path):
    def run() -> list[dict]:
        rows = []
        for seed in range(SEEDS):
            folder = tmp_path / str(seed)
            folder.mkdir()
            rows.append(one_seed(seed, folder))
            if not seed:
                print("\n" + " | ".join(rows[0]))
            print(" | ".join(f"{value:.3g}" for value in rows[-1].values()), flush=True)
        return rows

    rows = benchmark.pedantic(run, rounds=1)
    for name in rows[0]:
        values = np.array([row[name] for row in rows])
        rms = np.sqrt((values**2).mean())
        print(f"{name}: median {np.median(values):.3g}, largest {np.abs(values).max():.3g}, rms {rms:.3g}")
