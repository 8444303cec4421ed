"""What the counting calibrations ask of raw data before they use it."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.errors import CalibrationError
from rig.files.scan import ScanFile, ScanPass
from rig.model.config import RigConfig
from rig.model.quantities import show
from rig.model.state import RigState

#: What the timing instrument says where counts are missing; all else that it says is a matter of degree.
SPOILT = ("sync was lost", "No sync pulses", "is full")


@contextmanager
def sound_scans(files: Sequence[Path]) -> Iterator[list[ScanFile]]:
    """Open raw data, and refuse what lacks counts.

    Raises
    ------
    CalibrationError
        If a scan is not complete, or the timing instrument lost counts.
    """
    with ExitStack() as stack:
        scans = [stack.enter_context(ScanFile(path)) for path in files]
        for scan in scans:
            _refuse_unsound(scan)
        yield scans


def _refuse_unsound(scan: ScanFile) -> None:
    if scan.status != "complete":
        raise CalibrationError(f"{scan.path} is not complete ({scan.reason}): measure it again")
    for warning in scan.warnings:
        if any(sign in warning for sign in SPOILT):
            raise CalibrationError(f"{scan.path}: {warning} Mend that and measure it again")
    asked_s = scan.plan.exposures_s if scan.plan else np.zeros(scan.steps)
    lost = scan.live_time_s < 0.999 * asked_s
    if lost.any():
        raise CalibrationError(
            f"{scan.path}: {lost.sum()} of {len(lost)} exposures ended early, perhaps at a full bin: "
            "attenuate, or expose shorter"
        )


def passes_of(scans: Sequence[ScanFile]) -> list[ScanPass]:
    """Return the passes of all files, in order: it does not matter how many files they are in."""
    return [one for scan in scans for one in scan.passes()]


def settings_of(source: ScanFile | ScanPass) -> RigConfig:
    """Return the configuration with which a scan, or a pass of it, was measured.

    Raises
    ------
    CalibrationError
        If it does not say.
    """
    if source.config is None:
        name = source.label if isinstance(source, ScanPass) else source.path
        raise CalibrationError(f"{name} does not say how it was measured: give files of this program")
    return source.config


def counts_of(source: ScanFile | ScanPass) -> NDArray[np.float64]:
    """Return (steps, bins) counts of the one channel; calibrations have few steps."""
    counts = source.counts if isinstance(source, ScanPass) else source.counts(range(source.steps))
    measured = slice(None) if isinstance(source, ScanPass) else source.done
    return np.asarray(counts[measured, 0], dtype=np.float64)


def live_s(source: ScanFile | ScanPass) -> float:
    """Return the measurement time of all steps together [s]."""
    return float(source.live_time_s.astype(np.float64).sum())


def period_s(config: RigConfig) -> float:
    """Return the time between the sync pulses that the timing instrument sees [s]."""
    return RigState(config).sync_period_s


def hold_off_s(one: ScanPass) -> float:
    """Return the detector's hold-off, as it said itself [s]."""
    return float(one.devices.get("spad", {}).get("hold_off_s", settings_of(one).detector.hold_off_s))


def refuse_saturated(one: ScanPass, rate_hz: float) -> None:
    """Refuse light that keeps the detector off for half of the time: the corrections for it grow too large.

    Raises
    ------
    CalibrationError
        If ``rate_hz`` detections a second do.
    """
    off = rate_hz * hold_off_s(one)
    if off > 0.5:
        raise CalibrationError(
            f"{one.label}: {show(rate_hz, 'Hz')} keep the detector off for {100 * off:.0f} % of the time: it "
            "is saturated. Attenuate the light and measure again"
        )
