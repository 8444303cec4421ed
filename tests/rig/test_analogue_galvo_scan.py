"""A simulated rig with an analogue galvo on a DAQ board: scans and calibrations as with any other mirror."""

import numpy as np
import pytest

from rig.acquire.acquisition import Watch, acquire
from rig.acquire.connect import open_station
from rig.calibrate.galvo.flight import FlightRoutine
from rig.files import ScanFile
from rig.model.config import built_in_with
from rig.model.plan import ScanPlan
from rig.model.state import RigState
from support.misaligned import errors_m, misaligned


def scanned(path, galvo: dict, gain: float = 1.0, motion: str = "step"):
    """Return counts (positions, 60) of each nanosecond, and what the file says of the galvo."""
    wrong = {"mirror_gain": [gain, gain]}
    config = built_in_with({"galvo": galvo, "simulation": {"seed": 4, "misalignment": wrong}})
    plan = ScanPlan.grid(config, columns=6, rows=5, spacing_m=0.2, exposure_s=0.05, motion=motion)
    acquire(plan, RigState(config), path)
    with ScanFile(path) as scan:
        counts = scan.counts(range(len(plan)))[:, 0]
        return counts.reshape(len(plan), 60, -1).sum(axis=2).astype(float), scan.devices["galvo"]


def sigmas(here, there) -> float:
    """Return by how many standard deviations two draws differ more than two of the same means do."""
    both = here + there
    cells = both >= 20  # where a difference is normally distributed
    squared = ((here - there)[cells] ** 2 / both[cells]).sum()  # chi squared of as many as there are cells
    return float((squared - cells.sum()) / np.sqrt(2 * cells.sum()))


@pytest.fixture(scope="module")
def with_optotune(tmp_path_factory):
    return scanned(tmp_path_factory.mktemp("optotune") / "scan.h5", {"kind": "optotune"})[0]


def test_a_scan_sees_what_it_sees_with_another_mirror(tmp_path, with_optotune):
    here, galvo = scanned(tmp_path / "scan.h5", {"kind": "analogue", "volts_per_degree": [0.8, -0.5]})
    assert galvo["volts_per_degree_x"] == 0.8
    assert here.sum() > 100_000
    assert not np.array_equal(here, with_optotune)  # a pair takes other angles, so other photons are drawn
    assert abs(sigmas(here, with_optotune)) < 5


def test_a_mirror_that_never_stops_sees_the_same(tmp_path, with_optotune):
    """Voltages and marks are of one clock; of each 50 ms the mirror is on its way for about 0.5 ms."""
    here, _ = scanned(tmp_path / "scan.h5", {"kind": "analogue"}, motion="continuous")
    assert abs(sigmas(here, with_optotune)) < 5


def test_a_mirror_that_turns_too_far_would_be_seen(tmp_path, with_optotune):
    here, _ = scanned(tmp_path / "scan.h5", {"kind": "analogue"}, gain=1.05)
    assert sigmas(here, with_optotune) > 50


def test_it_is_calibrated_without_cameras(tmp_path):
    """Servo boards that turn it half a percent too far; askew, off its place, before a tilted wall."""
    config = misaligned(seed=0, mirrors=2, kind="analogue")
    routine = FlightRoutine(columns=6, rows=5)
    with open_station(routine.setup(config), None) as station:
        files = routine.measure(station, RigState(routine.setup(config)), tmp_path, Watch())
    found = routine.fit(files, RigState(config))
    assert found.devices["galvo"].startswith("analogue galvo, 0.5 and 0.5 V per degree")
    spots_m = ScanPlan.grid(config, columns=19, rows=14, spacing_m=0.099).spots_m
    # as close as with another mirror: `test_without_cameras_the_beam_goes_where_it_is_asked_to`
    assert np.linalg.norm(errors_m(found, config, spots_m), axis=1).max() < 5e-3
