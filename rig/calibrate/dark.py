"""Dark counts, ambient light and afterpulses.

Rates are those of a ready detector: R counts a second with a hold-off h come from R / (1 - R h), since the
detector is off for h after each (non-paralysable dead time, Knoll, Radiation Detection and Measurement, ch.
4), less the afterpulses among them. Afterpulses are seen in time: see `rig.calibrate.afterpulses`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from rig.acquire.acquisition import Watch, record
from rig.acquire.connect import Station
from rig.calibrate.afterpulses import Record, fitted, fitted_alone
from rig.calibrate.counts import (
    counts_of,
    hold_off_s,
    live_s,
    period_s,
    refuse_saturated,
    settings_of,
    sound_scans,
)
from rig.calibrate.routine import changed, origin
from rig.errors import CalibrationError
from rig.files.scan import ScanFile
from rig.model.calibrations.base import Calibration
from rig.model.calibrations.kinds import DarkRates
from rig.model.config import RigConfig
from rig.model.devices import Preparation
from rig.model.plan import ScanPlan
from rig.model.quantities import show
from rig.model.state import RigState

#: Fewer counts make a rate of no use: its error is above 15 %.
LEAST_COUNTS = 50
#: So far from counting noise is no chance, and some fault in the measurement [standard errors].
NO_CHANCE = 5.0
#: Parts of a measurement, whose rates must agree.
PARTS = 10


@dataclass(frozen=True)
class Rate:
    """Counts a second of a ready detector, afterpulses among them, and the standard error."""

    hz: float
    error_hz: float


@dataclass(frozen=True)
class DarkRoutine:
    """Measures rates with the beam blocked, and afterpulses with the beam attenuated.

    Attributes
    ----------
    dark_s, ambient_s
        Exposures with the lens covered and uncovered.
    afterpulse_s
        Exposure at each hold-off.
    hold_offs_s
        None shorter than the dead time of the timing instrument, which would lose what comes between.
    repetition_hz
        Of the laser during all of it: slow, so that afterpulses die away between pulses.
    """

    dark_s: float = 200.0
    ambient_s: float = 100.0
    afterpulse_s: float = 200.0
    hold_offs_s: tuple[float, ...] = (90e-9, 120e-9, 160e-9)
    repetition_hz: float = 2e6
    kind: str = DarkRates.kind

    def setup(self, config: RigConfig) -> RigConfig:
        """Return a free-running detector, and bins over the whole time between slow pulses."""
        period = RigState(changed(config, laser={"repetition_hz": self.repetition_hz})).sync_period_s
        width_s = 64e-12
        while period / width_s > 65_536:
            width_s *= 2
        return changed(
            config,
            detector={"gated": False},
            laser={"repetition_hz": self.repetition_hz},
            tcspc={
                "offset_s": 0.0,
                "bin_width_s": width_s,
                "bins": int(np.ceil(period / width_s - 1e-6)),
            },
        )

    def measure(self, station: Station, state: RigState, folder: Path, watch: Watch) -> list[Path]:
        """Count in the dark, in the room's light, and after the laser's pulses at each hold-off."""
        config = state.config
        steps = [
            (Preparation.COVER, config.detector.hold_off_s, self.dark_s, "covered"),
            (Preparation.BLOCK, config.detector.hold_off_s, self.ambient_s, "uncovered"),
        ]
        for hold_s in self.hold_offs_s:
            steps.append((Preparation.ATTENUATE, hold_s, self.afterpulse_s, f"pulsed-{hold_s * 1e9:.0f}ns"))
        files: list[Path] = []
        prepared = None
        for preparation, hold_s, exposure_s, name in steps:
            if preparation is not prepared:
                station.operator.prepare(preparation)
                prepared = preparation
            station.devices.spad.set_hold_off(hold_s)
            plan = ScanPlan.grid(
                config, columns=PARTS, rows=1, exposure_s=max(round(exposure_s / PARTS, 3), 1e-3), skip_m=0.0
            )
            path = folder / f"dark-{len(files)}-{name}.h5"
            held = RigState(changed(config, detector={"hold_off_s": hold_s}))
            record(plan, held, station.devices, path, watch)
            files.append(path)
            if watch.should_stop():
                break
        return files

    def fit(self, files: Sequence[Path], state: RigState) -> Calibration:
        """Return rates and afterpulses; files in the order in which they are measured."""
        if len(files) < 3:
            raise CalibrationError(
                f"{len(files)} of at least 3 files were given: first the one with the lens covered, then "
                "uncovered with the beam blocked, then at least one with the attenuated beam"
            )
        with sound_scans(files) as scans:
            covered, uncovered, *pulsed = scans
            after = fitted([_record(scan) for scan in pulsed])
            alone = [fitted_alone(_record(scan), after.decay_s) for scan in pulsed]
            dark, both = (_steady(scan, after.outlasting) for scan in (covered, uncovered))
            ambient = _ambient(dark, both, covered, uncovered)
            return DarkRates(
                **origin(DarkRates, scans),
                valid_days=90,
                dark_hz=dark.hz,
                dark_error_hz=dark.error_hz,
                ambient_hz=ambient.hz,
                ambient_error_hz=ambient.error_hz,
                afterpulse_probability=after.probability,
                afterpulse_probability_error=after.probability_error,
                afterpulse_decay_s=after.decay_s if after.seen else None,
                afterpulse_decay_error_s=after.decay_error_s if after.seen else None,
                chi2_per_bin=after.chi2_per_bin,
                hold_off_s=[hold_off_s(scan) for scan in pulsed],
                after_hold_off=[one[0] for one in alone],
                after_hold_off_error=[one[1] for one in alone],
            )

    def figure(self, files: Sequence[Path], calibration: Calibration) -> Figure:
        """Draw the parts' rates, the afterpulses in time with residuals, and against hold-off."""
        from rig.calibrate.pictures_dark import dark_figure

        assert isinstance(calibration, DarkRates)
        with sound_scans(files) as scans:
            rates = [counts_of(scan).sum(axis=1) / scan.live_time_s for scan in scans[:2]]
            return dark_figure(rates, [_record(scan) for scan in scans[2:]], calibration)


def _record(scan: ScanFile) -> Record:
    """Return what the fit of afterpulses needs of a file with the attenuated beam."""
    _refuse_gated(scan)
    settings = settings_of(scan)
    counts = counts_of(scan).sum(axis=0)
    refuse_saturated(scan, float(counts.sum()) / live_s(scan))
    pulses = live_s(scan) / period_s(settings)
    return Record(str(scan.path), counts, scan.bin_width_s, period_s(settings), pulses, hold_off_s(scan))


def _steady(scan: ScanFile, outlasting: Callable[[float], float]) -> Rate:
    """Return the rate of a steady light, after refusing what is none."""
    _refuse_gated(scan)
    counts = counts_of(scan)
    total, live = float(counts.sum()), live_s(scan)
    if total < LEAST_COUNTS:
        raise CalibrationError(
            f"{scan.path} has {total:.0f} counts, {LEAST_COUNTS} are the least: measure longer, and check "
            "that the detector is on"
        )
    seen_hz = total / live
    refuse_saturated(scan, seen_hz)
    _refuse_unsteady(scan, counts.sum(axis=1))
    _refuse_pulsed(scan, counts.sum(axis=0))
    ready_hz = seen_hz / (1 - seen_hz * hold_off_s(scan))
    light_hz = ready_hz * (1 - outlasting(hold_off_s(scan)))
    return Rate(light_hz, light_hz / np.sqrt(total))  # the hold-off thins counts and their noise alike


def _ambient(dark: Rate, both: Rate, covered: ScanFile, uncovered: ScanFile) -> Rate:
    ambient = Rate(both.hz - dark.hz, float(np.hypot(both.error_hz, dark.error_hz)))
    if ambient.hz < 3 * ambient.error_hz:
        raise CalibrationError(
            f"{covered.path} has {show(dark.hz, 'Hz')} and {uncovered.path} {show(both.hz, 'Hz')}: covering "
            "the lens makes no difference. Either it was not covered, or a light was on meanwhile, or the "
            "files are not in the order covered, uncovered. In a room without any light leave a weak one on"
        )
    return ambient


def _refuse_gated(scan: ScanFile) -> None:
    if settings_of(scan).detector.gated:
        raise CalibrationError(
            f"{scan.path} was measured through the gate: let the detector run freely (spad.gated = false)"
        )
    end_s = scan.first_bin_s + scan.bins * scan.bin_width_s
    if scan.first_bin_s > 0 or end_s < period_s(settings_of(scan)) * (1 - 1e-9):
        raise CalibrationError(
            f"{scan.path} has bins from {show(scan.first_bin_s, 's')} to {show(end_s, 's')}, which is not "
            f"the whole time of {show(period_s(settings_of(scan)), 's')} between pulses: choose offset 0 and "
            "wider bins"
        )


def _refuse_unsteady(scan: ScanFile, parts: np.ndarray) -> None:
    """Refuse rates that change from part to part: somebody switched a light or lifted the cover."""
    expected = parts.sum() * scan.live_time_s / live_s(scan)
    off = (parts - expected) / np.sqrt(expected)
    if np.abs(off).max() > NO_CHANCE:
        part = int(np.abs(off).argmax())
        raise CalibrationError(
            f"{scan.path}: part {part + 1} of {len(parts)} has {parts[part]:.0f} counts, "
            f"{expected[part]:.0f} are due as in the others: a light went on or off, or the cover moved. "
            "Keep the light as it is and measure again"
        )


def _refuse_pulsed(scan: ScanFile, counts: np.ndarray) -> None:
    """Refuse counts that follow the laser's pulses: the beam was not blocked."""
    parts = 100
    each = np.bincount(np.arange(len(counts)) * parts // len(counts), counts, parts)
    share = np.bincount(np.arange(len(counts)) * parts // len(counts), minlength=parts) / len(counts)
    expected = counts.sum() * share
    off = (each - expected) / np.sqrt(np.maximum(expected, 1))
    if off.max() > NO_CHANCE + 2:
        at_s = scan.first_bin_s + (off.argmax() + 0.5) / parts * len(counts) * scan.bin_width_s
        raise CalibrationError(
            f"{scan.path}: counts come in step with the laser, most of them {show(at_s, 's')} after its "
            "pulse. Block the beam and measure again"
        )
