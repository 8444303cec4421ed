"""What scan files hold, read whole."""

import numpy as np

from rig.files import ScanFile

C_M_PER_S = 299_792_458.0


def dense(capture):
    """(positions, bins) counts of all blocks, each put where it says it belongs."""
    blocks = list(capture.histograms.blocks())
    counts = np.zeros(capture.histograms.shape, blocks[0][1].dtype)
    for where, block in blocks:
        counts[where] = block
    return counts


def load(path):
    """Return capture and counts of a scan file."""
    with ScanFile(path) as scan:
        capture = scan.capture()
        return capture, dense(capture)
