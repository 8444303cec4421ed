"""What somebody's environment says to libraries stops no verb."""

import os
import subprocess
import sys

import pytest

from support.point_scans import write_point_scan


@pytest.mark.parametrize("threads", ["2,2", "-1"])
def test_words_that_a_library_does_not_understand(tmp_path, threads):
    """A list of threads is OpenMP's own form; the backend is one that matplotlib no longer has."""
    scan = tmp_path / "scan.h5"
    write_point_scan(scan, shape=(12, 10), spacing_m=0.06)
    said = {"OMP_NUM_THREADS": threads, "MPLBACKEND": "Qt4Agg"}
    asked = ["recon", str(scan), "--wavelength", "16cm", "--depth", "0.6m:0.8m:10cm"]
    done = subprocess.run(
        [sys.executable, "-m", "rig", *asked], capture_output=True, text=True, env=os.environ | said
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "scan.png").exists()
