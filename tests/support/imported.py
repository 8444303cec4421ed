"""What the import tests share."""

from pathlib import Path

import numpy as np
import pytest

from rig.files import ScanFile

C_M_PER_S = 299_792_458.0
DATA = Path(__file__).parents[2].parent / "shared" / "data"
measured = pytest.mark.skipif(not DATA.is_dir(), reason=f"the published measurements are not at {DATA}")


def load(path):
    """Return capture and counts of a scan file."""
    with ScanFile(path) as scan:
        capture = scan.capture()
        return capture, np.concatenate([block for _, block in capture.histograms.blocks()])
