"""Where a picture comes from, in the few facts that let a printed one be traced."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.errors import printable
from rig.files.scan import ScanFile


def origin(scan: ScanFile) -> dict[str, Any]:
    """Return what a scan's file says of its making, as far as it does: what JSON can hold.

    ``positions`` measured, ``photons`` counted, ``exposure_s`` of a position, ``measured`` (when, UTC), the
    ``rig``: its devices by what they call themselves, or that it is simulated, or whose file it was; and
    ``wall_m``, least and greatest x and y of the laser spots.
    """
    live_s = scan.live_time_s[np.asarray(scan.done)]
    exposure_s = float(np.nanmedian(live_s)) if np.isfinite(live_s).any() else 0.0
    laser_m = scan.laser_m[np.asarray(scan.done)]
    facts: dict[str, Any] = {
        "positions": int(np.count_nonzero(scan.done)),
        "photons": scan.photons,
        "exposure_s": float(f"{exposure_s:.6g}"),  # of a float32
        "measured": "" if scan.imported else scan.created,
        "rig": _rig(scan),
        "wall_m": [
            float(edge) for axis in (0, 1) for edge in (laser_m[:, axis].min(), laser_m[:, axis].max())
        ],
    }
    return {name: fact for name, fact in facts.items() if fact}


def _ends(values: NDArray[np.float64]) -> tuple[np.float64, ...]:
    return (values.min(), values.max()) if len(values) else ()


def _rig(scan: ScanFile) -> str:
    if scan.imported:
        return f"imported from {printable(str(scan.imported.get('file', 'another file')))}"
    if scan.simulated:
        scene = scan.config.simulation.scene if scan.config and scan.config.simulation else ""
        return f"simulated rig, scene {printable(Path(scene).name)}" if scene else "simulated rig"
    names = [str(settings.get("identity", "")) for settings in scan.devices.values()]
    return printable("; ".join(name for name in names if name))
