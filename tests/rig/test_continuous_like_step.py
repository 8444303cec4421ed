"""A mirror that never stops sees what one sees that rests at each position."""

import numpy as np
import pytest

from recon.accumulate import likeness
from recon.depth import front_view
from rig.acquire.acquisition import acquire
from rig.files.scan import ScanFile
from rig.image.drawing import Drawing
from rig.image.reconstruct import reconstruct
from rig.image.request import Request
from rig.model.config import built_in_with
from rig.model.plan import ScanPlan
from rig.model.state import RigState


def seen(folder, motion, galvo=None):
    """Scan the letters at 10 ms; return photons of each position, and the front view of the image."""
    config = built_in_with(
        {
            "scan": {"columns": 36, "rows": 26, "spacing": "5cm"},
            "galvo": galvo or {},
            "calibration": {"use": False},
            "simulation": {"scene": "letters", "seed": 3},
        }
    )
    plan = ScanPlan.grid(config, exposure_s=10e-3, motion=motion)
    path = folder / "scan.h5"
    acquire(plan, RigState(config), path)
    with ScanFile(path) as scan:
        photons = scan.counts(range(len(plan))).sum(axis=(1, 2), dtype=np.int64)
    request = Request(wavelength_m=0.12, depth_m=(0.8, 1.6, 0.04), voxel_m=0.04)
    volume = reconstruct(path, request, folder / "volume.h5", Drawing(folder / "volume.png")).volume
    return photons, front_view(volume.intensity)


@pytest.fixture(scope="module")
def step(tmp_path_factory):
    return seen(tmp_path_factory.mktemp("step"), "step")


def test_step_and_continuous_scans_agree(tmp_path, step):
    (photons, front), (of_moving, front_of_moving) = step, seen(tmp_path, "continuous")
    # two draws of the same means: four standard deviations, of the sum and of what is left of each position
    assert abs(int(of_moving.sum()) - int(photons.sum())) < 4 * np.sqrt(of_moving.sum() + photons.sum())
    chi2 = ((of_moving - photons) ** 2 / (of_moving + photons)).mean()
    assert abs(chi2 - 1) < 4 * np.sqrt(2 / len(photons))
    assert likeness(front_of_moving, front) > 0.98


def test_a_wrong_lag_would_be_seen(tmp_path, step):
    """Windows that are late by a whole point: lines there and back are two points apart."""
    _, front = seen(tmp_path, "continuous", {"lag": "10.8ms"})
    assert likeness(front, step[1]) < 0.9
