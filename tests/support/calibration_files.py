"""Scan files as calibrations measure them, with counts that a test chooses."""

import numpy as np

from rig.calibrate.routine import changed
from rig.files import ScanDescription, ScanWriter
from rig.model.config import built_in
from rig.model.plan import ScanPlan
from rig.model.state import RigState


def config_with(folder, **sections):
    """The built-in rig with a store of its own."""
    return changed(built_in(), calibration={"folder": folder / "calibrations"}, **sections)


def write_counts(path, counts, config, *, exposure_s=1.0, status="complete", warnings=(), live_s=None):
    """(positions, bins) counts, measured with ``config``, as a scan file."""
    counts = np.atleast_2d(counts)
    positions, bins = counts.shape
    laser_m = np.zeros((positions, 3))
    laser_m[:, 0] = 0.01 * (np.arange(positions) + 1)
    description = ScanDescription(
        laser_m=laser_m,
        detector_m=np.array([config.channels[0].spot_m]),
        bins=bins,
        bin_width_s=config.tcspc.bin_width_s,
        first_bin_s=config.tcspc.offset_s,
        plan=ScanPlan.grid(config, columns=positions, rows=1, exposure_s=exposure_s, skip_m=0.0),
        state=RigState(config),
        simulated=True,
        devices={
            "spad": {
                "identity": "a detector",
                "hold_off_s": config.detector.hold_off_s,
                "gate_delay_s": config.detector.gate_delay_s,
                "gate_width_s": config.detector.gate_width_s,
            },
            "laser": {"identity": "a laser"},
            "tcspc": {"identity": "a timing instrument"},
        },
    )
    with ScanWriter.create(path, description) as writer:
        for row in counts:
            writer.append(row.astype("u4"), exposure_s if live_s is None else live_s)
        writer.close(status, "", list(warnings))
    return path
