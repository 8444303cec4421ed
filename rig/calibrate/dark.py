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

from drivers.hydraharp.limits import LIMITS
from rig.acquire.acquisition import Watch, record
from rig.acquire.connect import Station
from rig.calibrate import require
from rig.calibrate.afterpulses import Record, fitted, fitted_alone
from rig.calibrate.counts import (
    counts_of,
    hold_off_s,
    live_s,
    passes_of,
    period_s,
    refuse_saturated,
    settings_of,
    sound_scans,
)
from rig.calibrate.routine import Routine, changed, origin
from rig.errors import CalibrationError
from rig.files.scan import ScanPass
from rig.model.calibrations.kinds import DarkRates
from rig.model.config import RigConfig
from rig.model.devices import Preparation
from rig.model.plan import Pass, ScanPlan, Spots
from rig.model.quantities import show
from rig.model.state import RigState

#: Fewer counts make a rate of no use: its error is above 15 %.
LEAST_COUNTS = 50
#: So far from counting noise is no chance, and some fault in the measurement [standard errors].
NO_CHANCE = 5.0
#: Parts of a measurement, whose rates must agree.
PARTS = 10
#: Where the laser lights the wall meanwhile, if it is not blocked.
ASIDE_M = (-0.045, 0.0, 0.0)


@dataclass(frozen=True)
class Rate:
    """Counts a second of a ready detector, afterpulses among them, and the standard error."""

    hz: float
    error_hz: float


@dataclass(frozen=True)
class DarkRoutine(Routine[DarkRates]):
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

    makes = DarkRates

    def setup(self, config: RigConfig) -> RigConfig:
        """Return a free-running detector, and bins over the whole time between slow pulses."""
        period = RigState(changed(config, laser={"repetition_hz": self.repetition_hz})).sync_period_s
        width_s = LIMITS.bin_width_covering(period, finest_s=64e-12)
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
        passes = [
            self._pass("covered", self.dark_s, Preparation.COVER),
            self._pass("uncovered", self.ambient_s, Preparation.BLOCK),
        ]
        for hold_s in self.hold_offs_s:
            name = f"pulsed, hold-off {show(hold_s, 's')}"
            passes.append(self._pass(name, self.afterpulse_s, Preparation.ATTENUATE, hold_s))
        path = folder / "dark.h5"
        plan = ScanPlan(passes=tuple(passes))
        record(plan, state.nominal, station.devices, path, watch, station.operator)
        return [path]

    def _pass(
        self, name: str, exposure_s: float, preparation: Preparation, hold_s: float | None = None
    ) -> Pass:
        """Return `PARTS` exposures at one spot beside the wall's centre."""
        return Pass(
            name=name,
            positions=Spots(spots=(ASIDE_M,)),
            frames=PARTS,
            exposure_s=max(round(exposure_s / PARTS, 3), 1e-3),
            preparation=preparation,
            hold_off_s=hold_s,
        )

    def fit(self, files: Sequence[Path], state: RigState) -> DarkRates:
        """Return rates and afterpulses; passes in the order in which they are measured."""
        with sound_scans(files) as scans:
            passes = passes_of(scans)
            require(
                len(passes) >= 3,
                f"{len(passes)} of at least 3 measurements were given: first the one with the lens covered, "
                "then uncovered with the beam blocked, then at least one with the attenuated beam",
            )
            covered, uncovered, *pulsed = passes
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
                hold_off_s=[hold_off_s(one) for one in pulsed],
                after_hold_off=[one[0] for one in alone],
                after_hold_off_error=[one[1] for one in alone],
            )

    def figure(self, files: Sequence[Path], found: DarkRates) -> Figure:
        """Draw the parts' rates, the afterpulses in time with residuals, and against hold-off."""
        from rig.calibrate.pictures_dark import dark_figure

        with sound_scans(files) as scans:
            passes = passes_of(scans)
            rates = [counts_of(one).sum(axis=1) / one.live_time_s for one in passes[:2]]
            return dark_figure(rates, [_record(one) for one in passes[2:]], found)


def _record(one: ScanPass) -> Record:
    """Return what the fit of afterpulses needs of a file with the attenuated beam."""
    _refuse_gated(one)
    settings = settings_of(one)
    counts = counts_of(one).sum(axis=0)
    refuse_saturated(one, float(counts.sum()) / live_s(one))
    pulses = live_s(one) / period_s(settings)
    return Record(one.label, counts, one.time_axis[1], period_s(settings), pulses, hold_off_s(one))


def _steady(one: ScanPass, outlasting: Callable[[float], float]) -> Rate:
    """Return the rate of a steady light, after refusing what is none."""
    _refuse_gated(one)
    counts = counts_of(one)
    total, live = float(counts.sum()), live_s(one)
    if total < LEAST_COUNTS:
        raise CalibrationError(
            f"{one.label} has {total:.0f} counts, {LEAST_COUNTS} are the least: measure longer, and check "
            "that the detector is on"
        )
    seen_hz = total / live
    refuse_saturated(one, seen_hz)
    _refuse_unsteady(one, counts.sum(axis=1))
    _refuse_pulsed(one, counts.sum(axis=0))
    ready_hz = seen_hz / (1 - seen_hz * hold_off_s(one))
    light_hz = ready_hz * (1 - outlasting(hold_off_s(one)))
    return Rate(light_hz, light_hz / np.sqrt(total))  # the hold-off thins counts and their noise alike


def _ambient(dark: Rate, both: Rate, covered: ScanPass, uncovered: ScanPass) -> Rate:
    ambient = Rate(both.hz - dark.hz, float(np.hypot(both.error_hz, dark.error_hz)))
    if ambient.hz < 3 * ambient.error_hz:
        raise CalibrationError(
            f"{covered.label} has {show(dark.hz, 'Hz')} and {uncovered.label} {show(both.hz, 'Hz')}: "
            "covering the lens makes no difference. Either it was not covered, or a light was on meanwhile, "
            "or the files are not in the order covered, uncovered. In a room without any light leave a weak "
            "one on"
        )
    return ambient


def _refuse_gated(one: ScanPass) -> None:
    if settings_of(one).detector.gated:
        raise CalibrationError(
            f"{one.label} was measured through the gate: let the detector run freely (spad.gated = false)"
        )
    bins, width_s, first_s = one.time_axis
    end_s = first_s + bins * width_s
    if first_s > 0 or end_s < period_s(settings_of(one)) * (1 - 1e-9):
        raise CalibrationError(
            f"{one.label} has bins from {show(first_s, 's')} to {show(end_s, 's')}, which is not "
            f"the whole time of {show(period_s(settings_of(one)), 's')} between pulses: choose offset 0 and "
            "wider bins"
        )


def _refuse_unsteady(one: ScanPass, parts: np.ndarray) -> None:
    """Refuse rates that change from part to part: somebody switched a light or lifted the cover."""
    expected = parts.sum() * one.live_time_s / live_s(one)
    off = (parts - expected) / np.sqrt(expected)
    if np.abs(off).max() > NO_CHANCE:
        part = int(np.abs(off).argmax())
        raise CalibrationError(
            f"{one.label}: part {part + 1} of {len(parts)} has {parts[part]:.0f} counts, "
            f"{expected[part]:.0f} are due as in the others: a light went on or off, or the cover moved. "
            "Keep the light as it is and measure again"
        )


def _refuse_pulsed(one: ScanPass, counts: np.ndarray) -> None:
    """Refuse counts that follow the laser's pulses: the beam was not blocked."""
    parts = 100
    each = np.bincount(np.arange(len(counts)) * parts // len(counts), counts, parts)
    share = np.bincount(np.arange(len(counts)) * parts // len(counts), minlength=parts) / len(counts)
    expected = counts.sum() * share
    off = (each - expected) / np.sqrt(np.maximum(expected, 1))
    if off.max() > NO_CHANCE + 2:
        _, width_s, first_s = one.time_axis
        at_s = first_s + (off.argmax() + 0.5) / parts * len(counts) * width_s
        raise CalibrationError(
            f"{one.label}: counts come in step with the laser, most of them {show(at_s, 's')} after its "
            "pulse. Block the beam and measure again"
        )
