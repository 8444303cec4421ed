"""Scan files as calibrations measure them, with counts that a test chooses."""

import json

import numpy as np

from rig.calibrate.routine import changed
from rig.files import ScanDescription, ScanWriter
from rig.model.config import built_in


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
        detector_m=np.array([config.spad.spot_m]),
        bins=bins,
        bin_width_s=config.hydraharp.bin_width_s,
        first_bin_s=config.hydraharp.offset_s,
        plan=json.dumps({"exposure_s": exposure_s}),
        configuration=config.model_dump_json(),
        simulated=True,
        devices={
            "spad": {
                "identity": "a detector",
                "hold_off_s": config.spad.hold_off_s,
                "gate_delay_s": config.spad.gate_delay_s,
                "gate_width_s": config.spad.gate_width_s,
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
