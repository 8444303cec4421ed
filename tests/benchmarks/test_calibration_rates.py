"""How well dark counts, gate and bin widths are found with every fault on, over 20 benches.

Run with ``pytest tests/benchmarks/test_calibration_rates.py -n 0 --benchmark-only -s``: a quarter of an hour.
"""

import numpy as np
import pytest

from rig.acquire.acquisition import Watch
from rig.bench.simulated import true_geometry
from rig.calibrate.counting.dark import DarkRoutine
from rig.calibrate.counting.dnl import DnlRoutine
from rig.calibrate.gate.edge import passed
from rig.calibrate.gate.routine import MAY_PASS, GateRoutine
from rig.calibrate.run import measured
from rig.commands.operator import ConsoleOperator
from rig.model.config import built_in_with
from rig.model.plan import ScanPlan
from rig.model.state import RigState
from simulators.detector.first_bounce import direct_s
from simulators.wire.harp.timing import Nonlinearity

SEEDS = range(20)
FAULTS = {
    "dark_counts": "10Hz",
    "ambient_light": "500Hz",
    "afterpulse_probability": 0.02,
    "gate_ringing": 0.07,
    "memory": 1e-5,
    "reflections_per_pulse": 1e-4,
    "failed_gates": 0.01,
    "dead_time": "80ns",
    "nonlinearity": 0.002,
    "drift_per_minute": "1ps",
}
MISALIGNMENT = {
    "wall_tilt": ["5deg", "2deg"],
    "galvo_shift": ["2cm", "-1cm", "3cm"],
    "spad_shift": ["-1cm", "2cm", "-2cm"],
    "mirror_turn": ["1deg", "1deg", "1deg"],
    "mirror_offset": ["0.5deg", "-0.3deg"],
    "mirror_gain": [1.005, 0.996],
    "cable_delay": "3ns",
}


def faulty(seed, folder, **more):
    simulation = {"seed": seed, "faults": {**FAULTS, **more}, "misalignment": MISALIGNMENT}
    return built_in_with({"simulation": simulation, "calibration": {"folder": str(folder)}})


def found(routine, config, folder):
    files = measured(routine, config, ConsoleOperator(), folder, Watch())
    calibration = routine.fit(files, RigState(config))
    for file in files:
        file.unlink()
    return calibration


def true_opening_s(config):
    """The foot of the edge after the latest first bounce of the scan, with what the pulse's width adds."""
    geometry = true_geometry(config)
    mirror = RigState(config).pointing.angles_rad(ScanPlan.grid(config).spots_m)
    latest_s = max(direct_s(geometry.laser_spot_m((x, y)), geometry) for x, y in mirror)
    grid_s = np.arange(0, 400e-12, 1e-13)
    blocked = passed(grid_s, 200e-12 / 0.6, 35e-12 / 2.3548) <= MAY_PASS
    return latest_s, latest_s + float(grid_s[blocked.argmax()])


def test_dark(benchmark, tmp_path):
    def run():
        rows = []
        for seed in SEEDS:
            got = found(DarkRoutine(), faulty(seed, tmp_path), tmp_path)
            rows.append(
                [
                    (got.dark_hz - 10) / got.dark_error_hz,
                    (got.ambient_hz - 500) / got.ambient_error_hz,
                    (got.afterpulse_probability - 0.02) / got.afterpulse_probability_error,
                    (got.afterpulse_decay_s - 40e-9) / got.afterpulse_decay_error_s,
                ]
            )
        return np.array(rows)

    pulls = benchmark.pedantic(run, rounds=1)
    print("\npulls: mean, standard deviation, largest")
    for name, column in zip(("dark", "ambient", "afterpulses", "decay"), pulls.T, strict=True):
        print(f"{name:12} {column.mean():6.2f} {column.std(ddof=1):6.2f} {np.abs(column).max():6.2f}")


def test_gate(benchmark, tmp_path):
    def run():
        rows = []
        for seed in SEEDS:
            config = faulty(seed, tmp_path)
            got = found(GateRoutine(), config, tmp_path)
            latest_s, truth_s = true_opening_s(config)
            rows.append(
                [
                    got.gate_delay_s - truth_s,
                    got.gate_delay_s - latest_s,
                    got.edge_s - 200e-12,
                    got.edge_error_s,
                    got.gate_delay_error_s,
                ]
            )
        return 1e12 * np.array(rows)

    rows = benchmark.pedantic(run, rounds=1)
    print("\nps: mean, standard deviation, least, largest")
    names = ("opening less truth", "after last light", "edge less 200 ps", "edge's error", "opening's error")
    for name, column in zip(names, rows.T, strict=True):
        said = [column.mean(), column.std(ddof=1), column.min(), column.max()]
        print(f"{name:20}", *(f"{number:6.1f}" for number in said))


@pytest.mark.parametrize("rms", [0.0, 0.002, 0.01])
def test_dnl(benchmark, tmp_path, rms):
    """Bins of 256 ps, so that 3 s of lamp are 7000 counts a bin; then as much uniform light."""
    bins = 275

    def run():
        rows = []
        for seed in SEEDS:
            config = faulty(seed, tmp_path, nonlinearity=rms)
            harp = config.tcspc.model_copy(update={"bin_width_s": 256e-12, "bins": bins})
            got = found(DnlRoutine(exposure_s=3.0), config.model_copy(update={"tcspc": harp}), tmp_path)
            truth = Nonlinearity(rms=rms, seed=seed).widths()[:bins]
            counts = np.random.default_rng(seed).poisson(got.counts_per_bin * truth)
            mean = counts.mean()
            by_count = np.array(got.measured)
            left = counts / got.widths
            real = got.nonlinearity**2
            due = 1 / mean + real * got.noise**2 / (real + got.noise**2)
            rows.append(
                [
                    100 * got.nonlinearity,
                    100 * (by_count - truth).std(),
                    100 * (got.widths - truth).std(),
                    counts.var() / mean,
                    (counts / by_count).var() / mean,
                    left.var() / mean,
                    left.var() / mean**2 / due,
                ]
            )
        return np.array(rows)

    rows = benchmark.pedantic(run, rounds=1)
    print(f"\nnon-linearity {100 * rms:g} % rms: mean, standard deviation over benches")
    names = (
        "rms found (%)",
        "error of counted widths (%)",
        "error of widths believed (%)",
        "chi2/bin uncorrected",
        "chi2/bin by counted widths",
        "chi2/bin corrected",
        "chi2/bin by noise of both",
    )
    for name, column in zip(names, rows.T, strict=True):
        print(f"{name:30} {column.mean():8.3f} {column.std(ddof=1):8.3f}")
