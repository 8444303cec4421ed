"""A scan file in words."""

from typing import TYPE_CHECKING

import numpy as np

from rig.model.quantities import show, show_duration, show_length

if TYPE_CHECKING:
    from rig.files.scan import ScanFile


def summarise(scan: "ScanFile") -> dict[str, str]:
    """Return what a person wants to know at a glance, label by label."""
    low, high = scan.laser_m.min(axis=0), scan.laser_m.max(axis=0)
    measured = int(np.count_nonzero(scan.done))
    last_s = scan.first_bin_s + scan.bins * scan.bin_width_s
    kind = "time-tagged photons" if scan.tagged else "histograms"
    lines = {
        "status": scan.status + (f" ({scan.reason})" if scan.reason else ""),
        "positions": f"{scan.positions:,}"
        + ("" if measured == scan.positions else f", {measured:,} measured"),
        "wall": f"{show_length(high[0] - low[0])} x {show_length(high[1] - low[1])}",
        "detector": "one spot" if len(scan.detector_m) == 1 else "a spot for each position",
        "bins": f"{scan.bins:,} of {show(scan.bin_width_s, 's', 4)}, from {show(scan.first_bin_s, 's', 4)} "
        f"to {show(last_s, 's', 4)}",
        "time origin": "pulse on the wall" if scan.time_origin == "wall" else "pulse leaves the laser",
        "content": "expectation values" if scan.expectation else kind,
    }
    live_s = float(np.nansum(scan.live_time_s))
    if live_s > 0:
        lines["exposure"] = (
            f"{show(live_s / max(1, measured), 's')} a position, {show_duration(live_s)} in all"
        )
    origin = ["simulated"] if scan.simulated else []
    if scan.imported:
        origin.append(f"imported from {scan.imported.get('file')} ({scan.imported.get('layout')})")
    elif scan.command:
        origin.append(scan.command)
    if origin:
        lines["source"] = ", ".join(origin)
    if scan.created:
        lines["created"] = f"{scan.created} by {scan.software or 'an unnamed program'}"
    if scan.warnings:
        lines["warnings"] = "; ".join(scan.warnings)
    return lines
