"""Memory of a scan of very many positions: ``python tests/benchmarks/long_scan.py 1000000``.

Histograms of 16 bins on the fast clock, in a room that is dark but for the laser. Printed is the memory of
the program (resident, MB) after each twentieth of the scan. A grid of 100 x 100 is scanned again and again:
the simulated bench remembers how often it has measured each position, which is how a resumed scan draws the
same photons, and this, which no real rig has, would grow with each new one.
"""

import sys
import tempfile
import time
from pathlib import Path

from rig.acquire.acquisition import Watch, record
from rig.acquire.connect import open_devices
from rig.acquire.events import Event, StepDone
from rig.model.config import built_in_with
from rig.model.plan import ScanPlan
from rig.model.state import RigState

#: Positions along each side of the grid.
GRID = 100


def resident_mb() -> float:
    """Return the memory that the program has in use now, as Linux tells it."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 1e6


def main() -> None:
    """Scan, and print."""
    frames = max(1, int(sys.argv[1]) // GRID**2)
    tcspc = {"kind": "hydraharp", "bins": 16, "bin_width": "4.096ns"}
    config = built_in_with({"tcspc": tcspc, "calibration": {"use": False}, "laser": {"power_setpoint": 0.5}})
    plan = ScanPlan.grid(
        config, columns=GRID, rows=GRID, spacing_m=1.2 / GRID, exposure_s=1e-3, skip_m=0.0, frames=frames
    )
    began_s = time.monotonic()

    def watch(event: Event) -> None:
        if isinstance(event, StepDone) and event.step.index % (len(plan) // 20) == 0:
            took_s = time.monotonic() - began_s
            print(f"{event.step.index:9d} positions {took_s:7.0f} s {resident_mb():8.1f} MB", flush=True)

    state = RigState(config)
    with tempfile.TemporaryDirectory() as folder, open_devices(config) as devices:
        result = record(
            plan, state.of_devices(devices.identities()), devices, Path(folder) / "a.h5", Watch([watch])
        )
    print(result.ended, f"{result.photons} photons")


if __name__ == "__main__":
    main()
