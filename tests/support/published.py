"""What others measured: in ``RIG_TEST_DATA``, or in ``shared/data`` beside the project.

A test that asks for what is not there is skipped. `fetch_published.py` fetches what is public.
"""

import os
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from recon.capture import ArrayHistograms, Capture
from recon.window import Window
from rig.files import ScanFile
from support.fetch_published import SCENES
from support.scan_files import dense

DATA = Path(os.environ.get("RIG_TEST_DATA") or Path(__file__).parents[3] / "shared" / "data").resolve()


def published(path: str) -> Path:
    """Return where a file is, or skip the test."""
    if not (DATA / path).exists():
        pytest.skip(f"{path} is not in {DATA}; see tests/support/fetch_published.py")
    return DATA / path


def importable(name: str) -> tuple[Path, tuple[str, ...]]:
    """Return the file of a scene that ``rig import`` takes, and its options: as published, or neutral."""
    original = DATA / "original" / next(iter(SCENES[name].files))
    if original.exists():
        return original, SCENES[name].importing
    return published(f"{name}.h5"), ()


def load(name: str) -> tuple[Capture, Window]:
    """Return a scene with the window that it needs: of the fetched scan file, or of the neutral file."""
    if (DATA / "scans" / f"{name}.h5").exists():
        with ScanFile(DATA / "scans" / f"{name}.h5") as scan:
            capture = scan.capture()
            whole = replace(capture, histograms=ArrayHistograms(dense(capture)))
            return whole, Window(start_s=scan.fade_from_s)
    with h5py.File(published(f"{name}.h5")) as file:
        counts = file["counts" if "counts" in file else "transient"][:]
        bin_width_s = float(file.attrs["bin_width_s"])
        capture = Capture(
            ArrayHistograms(counts),
            bin_width_s,
            np.array([file["time_s"][0] - bin_width_s / 2]),
            file["laser_position_m"][:].astype(float),
            file["detector_position_m"][:].astype(float),
        )
        return capture, Window(start_s=float(file.attrs["gate_start_s"]) or None)
