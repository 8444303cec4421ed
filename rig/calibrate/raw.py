"""Raw data as calibrations read it: passes of scan files, counted by the one channel, and their origin."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TypedDict

import numpy as np
from numpy.typing import NDArray

from rig.calibrate import Floats, require
from rig.errors import CalibrationError
from rig.files.recorded import RecordedFile
from rig.files.scan import ScanFile, ScanPass
from rig.model.calibrations.base import Calibration
from rig.model.quantities import show
from rig.model.state import RigState

#: What the timing instrument says where counts are missing; all else that it says is a matter of degree.
SPOILT = ("sync was lost", "No sync pulses", "is full")


class Raw:
    """One pass of S steps; its file must stay open.

    Raises CalibrationError if the file does not say how it was measured.

    Attributes
    ----------
    label, alone
        File and pass, for messages; and whether the file has no other.
    config
        As it was set for this pass.
    bins, bin_width_s, first_bin_s
        The time axis, in the file's time.
    done, live_s, laser_m, mirror_rad
        (S,) which steps were measured, (S,) how long, (S, 3) spots, and (S, 2) commanded mirror angles, None
        where the file does not say.
    detector_spot_m
        (3,) where the detector looks at the wall.
    hold_off_s, gate_delay_s, gate_width_s
        Of the detector, as it said itself.
    period_s
        Between the sync pulses that the timing instrument sees.
    """

    def __init__(self, one: ScanPass) -> None:
        self.label = one.label
        if one.config is None:
            raise CalibrationError(
                f"{self.label} does not hold how it was measured: give files of this program"
            )
        self._pass, self.config = one, one.config
        self.alone = len(one.steps) == one.scan.steps
        steps = slice(one.steps.start, one.steps.stop)
        self.bins, self.bin_width_s, self.first_bin_s = one.time_axis
        self.done, self.live_s, self.laser_m = one.scan.done[steps], one.live_time_s, one.laser_m
        self.mirror_rad = None if one.scan.mirror_rad is None else one.scan.mirror_rad[steps]
        self.detector_spot_m: Floats = one.scan.detector_m[0, 0]
        self.hold_off_s, self.gate_delay_s, self.gate_width_s = (
            float(one.devices.get("spad", {}).get(name, getattr(one.config.detector, name)))
            for name in ("hold_off_s", "gate_delay_s", "gate_width_s")
        )
        self.period_s = RigState(one.config).sync_period_s

    @property
    def counts(self) -> Floats:
        """(S, bins) counts, read now; calibrations have few steps."""
        return np.asarray(self._pass.counts[:, 0], dtype=np.float64)

    @property
    def edges_s(self) -> Floats:
        """(bins + 1,) edges of the bins, in the file's time."""
        return np.asarray(self.first_bin_s + np.arange(self.bins + 1) * self.bin_width_s, dtype=np.float64)

    @property
    def centres_s(self) -> Floats:
        """(bins,) centres of the bins."""
        return self.edges_s[:-1] + self.bin_width_s / 2

    @property
    def total_live_s(self) -> float:
        """Measurement time of all steps together."""
        return float(self.live_s.sum())

    def refuse_gated(self) -> None:
        """Refuse counts that were shaped by the gate."""
        require(
            not self.config.detector.gated,
            f"{self.label} was measured through the gate, which shapes the counts and keeps the first bounce "
            "out: let the detector be free-running (detector.gated = false), as rig calibrate does",
        )

    def refuse_saturated(self, rate_hz: float) -> None:
        """Refuse light that keeps the detector off half of the time: corrections for it grow too large."""
        off = rate_hz * self.hold_off_s
        require(
            off <= 0.5,
            f"{self.label}: {show(rate_hz, 'Hz')} keep the detector off for {100 * off:.0f} % of the time: "
            "it is saturated. Attenuate the light and measure again",
        )


@contextmanager
def reading(files: Sequence[Path], *, whole: bool = True) -> Iterator[tuple[list[ScanFile], list[Raw]]]:
    """Open scan files; give them, and the passes of all: it does not matter how many files they are in.

    Raises CalibrationError if counts are missing that are needed.

    Parameters
    ----------
    files
        In the order in which they were measured.
    whole
        Whether all counts are needed.
    """
    with ExitStack() as stack:
        scans = [stack.enter_context(ScanFile(path)) for path in files]
        for scan in scans if whole else ():
            _refuse_unsound(scan)
        yield scans, [Raw(one) for scan in scans for one in scan.passes()]


def _refuse_unsound(scan: ScanFile) -> None:
    require(scan.status == "complete", f"{scan.path} is not complete ({scan.reason}): measure it again")
    require(not scan.altered.any(), f"{'; '.join(scan.doubts)}")
    for warning in scan.warnings:
        spoilt = any(sign in warning for sign in SPOILT)
        require(not spoilt, f"{scan.path}: {warning} Correct that and measure it again")
    asked_s = scan.plan.exposures_s if scan.plan else np.zeros(scan.steps)
    short: NDArray[np.bool_] = scan.live_time_s < 0.999 * asked_s
    require(
        not short.any(),
        f"{scan.path}: {short.sum()} of {len(short)} exposures ended early, perhaps at a full bin: "
        "attenuate, or use a shorter exposure",
    )


class Origin(TypedDict):
    """Where a calibration comes from, as `Calibration` wants it."""

    rig_name: str
    devices: dict[str, str]
    measured_from: dict[str, str]
    simulated: bool


def origin(kind: type[Calibration], files: Sequence[RecordedFile]) -> Origin:
    """Return rig, devices and digests of the files that a calibration of this kind is computed from.

    Raises CalibrationError if the files are of different devices.
    """
    devices: dict[str, str] = {}
    for file in files:
        for name in kind.belongs_to:
            identity = str(file.devices.get(name, {}).get("identity", "unknown"))
            require(
                devices.setdefault(name, identity) == identity,
                f"{file.path} was measured with the {name} '{identity}', the files before it with "
                f"'{devices[name]}': give files of one rig",
            )
    return {
        "rig_name": files[0].config.name if files[0].config else "unknown rig",
        "devices": devices,
        "measured_from": {file.path.name: file.digest for file in files},
        "simulated": files[0].simulated,
    }
