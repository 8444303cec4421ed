"""What ``rig scan`` and ``rig resume`` share: progress, Ctrl-C, and the result."""

import time
from collections.abc import Callable
from pathlib import Path

from rig.acquire.acquisition import ScanResult, Watch
from rig.acquire.engine import Outcome
from rig.acquire.interrupt import StopRequest
from rig.commands import console
from rig.errors import InterruptedScanError
from rig.model.plan import ScanPlan
from rig.model.quantities import show, show_duration

Acquisition = Callable[[Watch], ScanResult]


def run(acquisition: Acquisition, plan: ScanPlan, target: Path, as_json: bool) -> None:
    """Run a scan into ``target`` and tell how it went.

    Raises
    ------
    rig.errors.InterruptedScanError
        If the person stopped it after a position.
    """
    began_s = time.monotonic()
    with StopRequest(console.say) as stop:
        result = acquisition(Watch([console.ScanProgress(len(plan))], stop))
    _show(result, plan, target, time.monotonic() - began_s, as_json)
    if result.ended.outcome is not Outcome.COMPLETE:
        raise InterruptedScanError(
            f"{target}: the scan was stopped after {result.ended.steps_done} of {len(plan)} "
            f"positions; these are safe in the file and can be imaged. Go on with: rig resume {target}"
        )


def _show(result: ScanResult, plan: ScanPlan, target: Path, took_s: float, as_json: bool) -> None:
    if as_json:
        console.print_json(
            {
                "file": str(target),
                "status": result.ended.outcome.value,
                "positions": result.ended.steps_done,
                "photons": result.photons,
                "live_time_s": result.live_time_s,
                "took_s": round(took_s, 2),
            }
        )
        return
    rate_hz = result.photons / result.live_time_s if result.live_time_s else 0.0
    console.print_facts(
        str(target),
        {
            "positions": f"{result.ended.steps_done:,} of {len(plan):,}",
            "photons": f"{result.photons:,} ({show(rate_hz, 'photons/s')})",
            "size": f"{target.stat().st_size / 1e6:.1f} MB",
            "took": show_duration(took_s),
        },
    )
    if result.ended.outcome is Outcome.COMPLETE:
        console.say(f"Next: rig recon {target}")
