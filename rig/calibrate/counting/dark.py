"""Dark counts, ambient light and afterpulses.

Rates are those of a ready detector: R counts a second with a hold-off h come from R / (1 - R h), since the
detector is off for h after each (non-paralysable dead time, Knoll, Radiation Detection and Measurement, ch.
4), less the afterpulses among them. Afterpulses are seen in time: see `rig.calibrate.counting.afterpulses`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter

from rig.acquire.acquisition import Watch
from rig.acquire.connect import Station
from rig.calibrate import Floats, figures, require
from rig.calibrate.counting.afterpulses import USUAL_DECAY_S, Record, expected, fitted, fitted_alone
from rig.calibrate.raw import Raw, origin, reading
from rig.calibrate.routine import Routine, changed, histogram_limits, recorded
from rig.model.calibrations.kinds import DarkRates
from rig.model.config import RigConfig
from rig.model.devices import Preparation
from rig.model.plan import Pass, ScanPlan, Spots
from rig.model.quantities import show
from rig.model.state import RigState

#: Fewer counts make a rate of no use: its error is above 15 %.
MIN_COUNTS = 50
#: So far from counting noise is no chance, and some fault in the measurement [standard errors].
NO_CHANCE = 5.0
#: Parts of a measurement, whose rates must agree.
PARTS = 10
#: Parts of the time between pulses, in which steady light has equal rates.
PHASES = 100
#: Where the laser lights the wall meanwhile, if it is not blocked.
ASIDE_M = (-0.045, 0.0, 0.0)
#: Points of a drawn histogram, about.
DRAWN = 250


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
        slow = changed(config, detector={"gated": False}, laser={"repetition_hz": self.repetition_hz})
        period_s = RigState(slow).sync_period_s
        width_s = histogram_limits(config).bin_width_covering(period_s, finest_s=64e-12)
        bins = int(np.ceil(period_s / width_s - 1e-6))
        return changed(slow, tcspc={"offset_s": 0.0, "bin_width_s": width_s, "bins": bins})

    def measure(self, station: Station, state: RigState, folder: Path, watch: Watch) -> list[Path]:
        """Count in the dark, in the room's light, and after the laser's pulses at each hold-off."""
        passes = [
            self._pass("covered", self.dark_s, Preparation.COVER),
            self._pass("uncovered", self.ambient_s, Preparation.BLOCK),
        ]
        for hold_s in self.hold_offs_s:
            name = f"pulsed, hold-off {show(hold_s, 's')}"
            passes.append(self._pass(name, self.afterpulse_s, Preparation.ATTENUATE, hold_s))
        plan = ScanPlan(passes=tuple(passes))
        return [recorded(folder / "dark.h5", plan, state.nominal, station, watch)]

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
        with reading(files) as (scans, passes):
            require(
                len(passes) >= 3,
                f"{len(passes)} of at least 3 measurements were given: "
                "the first must be with the lens covered, "
                "then uncovered with the beam blocked, then at least one with the attenuated beam",
            )
            covered, uncovered, *pulsed = passes
            records = [_record(one) for one in pulsed]
            after = fitted(records)
            alone = [fitted_alone(one, after.decay_s) for one in records]
            dark, both = (_steady(one, after.outlasting) for one in (covered, uncovered))
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
                afterpulse_decay_s=after.decay_s if after.detected else None,
                afterpulse_decay_error_s=after.decay_error_s if after.detected else None,
                chi2_per_bin=after.chi2_per_bin,
                hold_off_s=[one.hold_off_s for one in pulsed],
                after_hold_off=[outlasting for outlasting, _ in alone],
                after_hold_off_error=[error for _, error in alone],
            )

    def figure(self, files: Sequence[Path], found: DarkRates) -> Figure:
        """Draw the parts' rates, the afterpulses in time with residuals, and against hold-off."""
        with reading(files) as (_, passes):
            rates = [one.counts.sum(axis=1) / one.live_s for one in passes[:2]]
            records = [_record(one) for one in passes[2:]]
        percent = (100 * found.afterpulse_probability, 100 * found.afterpulse_probability_error)
        decay = ""
        if found.afterpulse_decay_s and found.afterpulse_decay_error_s:
            decay = _with_error(1e9 * found.afterpulse_decay_s, 1e9 * found.afterpulse_decay_error_s)
            decay = f", decay {decay} ns"
        figure, axes = figures.panels(
            f"dark counts {_with_error(found.dark_hz, found.dark_error_hz)} Hz, ambient light "
            f"{_with_error(found.ambient_hz, found.ambient_error_hz)} Hz, afterpulses "
            f"{_with_error(*percent)} %{decay}",
            [["rates", "decay"], ["outlasting", "residuals"]], (13, 8),
            width_ratios=(1, 1.5), height_ratios=(1.4, 1),
        )  # fmt: skip
        _draw_rates(axes["rates"], rates)
        _draw_decay(axes["decay"], axes["residuals"], records, found)
        _draw_outlasting(axes["outlasting"], found)
        return figure


def _record(one: Raw) -> Record:
    """Return what the fit of afterpulses needs of a pass with the attenuated beam."""
    _refuse_gated(one)
    counts, live_s = one.counts.sum(axis=0), one.total_live_s
    one.refuse_saturated(float(counts.sum()) / live_s)
    return Record(one.label, counts, one.bin_width_s, one.period_s, live_s / one.period_s, one.hold_off_s)


def _steady(one: Raw, outlasting: Callable[[float], float]) -> Rate:
    """Return the rate of a steady light, after refusing what is none."""
    _refuse_gated(one)
    counts = one.counts
    total = float(counts.sum())
    require(
        total >= MIN_COUNTS,
        f"{one.label} has {total:.0f} counts, but {MIN_COUNTS} are needed: measure longer, "
        "and check that the "
        "detector is on",
    )
    counted_hz = total / one.total_live_s
    one.refuse_saturated(counted_hz)
    _refuse_unsteady(one, counts.sum(axis=1))
    _refuse_pulsed(one, counts.sum(axis=0))
    ready_hz = counted_hz / (1 - counted_hz * one.hold_off_s)
    light_hz = ready_hz * (1 - outlasting(one.hold_off_s))
    return Rate(light_hz, light_hz / np.sqrt(total))  # the hold-off thins counts and their noise alike


def _ambient(dark: Rate, both: Rate, covered: Raw, uncovered: Raw) -> Rate:
    ambient = Rate(both.hz - dark.hz, float(np.hypot(both.error_hz, dark.error_hz)))
    require(
        ambient.hz >= 3 * ambient.error_hz,
        f"{covered.label} has {show(dark.hz, 'Hz')} and {uncovered.label} {show(both.hz, 'Hz')}: covering "
        "the lens makes no difference. Either it was not covered, or a light was on during the "
        "measurement, or the files "
        "are not in the order covered, uncovered. In a room without any light, leave a weak light on",
    )
    return ambient


def _refuse_gated(one: Raw) -> None:
    one.refuse_gated()
    end_s = one.edges_s[-1]
    require(
        one.first_bin_s <= 0 and end_s >= one.period_s * (1 - 1e-9),
        f"{one.label} has bins from {show(one.first_bin_s, 's')} to {show(end_s, 's')}, which is not the "
        f"whole time of {show(one.period_s, 's')} between pulses: choose offset 0 and wider bins",
    )


def _refuse_unsteady(one: Raw, parts: Floats) -> None:
    """Refuse rates that change from part to part: somebody switched a light or lifted the cover."""
    due = parts.sum() * one.live_s / one.total_live_s
    off = np.abs(parts - due) / np.sqrt(due)
    part = int(off.argmax())
    require(
        off[part] <= NO_CHANCE,
        f"{one.label}: part {part + 1} of {len(parts)} has {parts[part]:.0f} counts, "
        f"{due[part]:.0f} are expected from the others: a light went on or off, or the cover moved. "
        "Keep the light as it is and "
        "measure again",
    )


def _refuse_pulsed(one: Raw, counts: Floats) -> None:
    """Refuse counts that follow the laser's pulses: the beam was not blocked."""
    phase = np.arange(len(counts)) * PHASES // len(counts)
    due = counts.mean() * np.bincount(phase, minlength=PHASES)
    off = (np.bincount(phase, counts, PHASES) - due) / np.sqrt(np.maximum(due, 1))
    at_s = one.first_bin_s + (off.argmax() + 0.5) / PHASES * len(counts) * one.bin_width_s
    require(
        off.max() <= NO_CHANCE + 2,
        f"{one.label}: counts are synchronous with the laser, most of them {show(at_s, 's')} after its "
        "pulse. "
        "Block the beam and measure again",
    )


def _draw_rates(axes: Axes, rates: Sequence[Floats]) -> None:
    names = ("lens covered", "uncovered, beam blocked")
    for hz, name, colour in zip(rates, names, figures.SERIES, strict=False):
        axes.plot(np.arange(1, len(hz) + 1), hz, "o", color=colour, label=name)
        axes.axhline(hz.mean(), color=colour, linewidth=0.8)
    axes.set(yscale="log", xlabel="part of the measurement", ylabel="counts a second")
    axes.legend(loc="center right")


def _draw_decay(axes: Axes, below: Axes, records: Sequence[Record], found: DarkRates) -> None:
    """Draw counts after the first light and the fit where it is quiet, bins taken together."""
    p, decay_s = found.afterpulse_probability, found.afterpulse_decay_s or USUAL_DECAY_S
    usual = []
    for record, colour in zip(records, figures.SERIES * len(records), strict=False):
        size, quiet = max(len(record.counts) // DRAWN, 1), record.quiet
        first = int(quiet[0] - (np.ceil(record.hold_off_s / record.bin_width_s) + 16))
        counts = _together(np.roll(record.counts, -first), size)
        bin_ns = 1e9 * record.bin_width_s
        time_ns = (np.arange(len(counts)) + 0.5) * size * bin_ns
        label = f"hold-off {show(record.hold_off_s, 's')}"
        axes.plot(time_ns, counts, ".", markersize=3, color=colour, alpha=0.6, label=label)
        due, counted = _together(expected(record, p, decay_s), size), _together(record.counts[quiet], size)
        due_ns = time_ns[: len(due)] + (quiet[0] - first) % len(record.counts) * bin_ns
        axes.plot(due_ns, due, color=colour, linewidth=1.2)
        figures.residuals(below, due_ns, (counted - due) / np.sqrt(due), color=colour, markersize=3)
        usual.append(record.counts[quiet].mean() * size)
    axes.set(yscale="log", ylim=(0.5 * min(usual), 8 * max(usual)), ylabel="counts a bin",
             title="counts after the laser's pulse, with the fit where it is quiet")  # fmt: skip
    for formatted in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
        formatted(LogFormatter(minor_thresholds=(2, 0.5)))
    axes.legend(loc="upper right", fontsize="small")
    below.set(xlim=axes.get_xlim(), xlabel="time after the first light (ns)",
              ylabel="residual (standard errors)", title=f"chi² a bin {found.chi2_per_bin:.2f}")  # fmt: skip


def _draw_outlasting(axes: Axes, found: DarkRates) -> None:
    hold_ns = 1e9 * np.array(found.hold_off_s)
    measured, error = 100 * np.array([found.after_hold_off, found.after_hold_off_error])
    axes.errorbar(hold_ns, measured, error, fmt="o", color=figures.BLUE, capsize=3,
                  label="measured, one by one")  # fmt: skip
    grid_ns = np.linspace(0, 1.2 * hold_ns.max(), 200)
    decay_ns = 1e9 * (found.afterpulse_decay_s or USUAL_DECAY_S)
    due = 100 * found.afterpulse_probability * np.exp(-grid_ns / decay_ns)
    axes.plot(grid_ns, due, color=figures.RED, linewidth=1, label="p exp(-h / tau), all together")
    axes.set(xlabel="hold-off h (ns)", ylabel="afterpulses a detection (%)", yscale="log",
             xlim=grid_ns[[0, -1]], title="probability that a carrier outlasts the hold-off")  # fmt: skip
    axes.legend(loc="upper right", fontsize="small")


def _together(values: Floats, size: int) -> Floats:
    whole = len(values) // size * size
    return values[:whole].reshape(-1, size).sum(axis=1)


def _with_error(value: float, error: float) -> str:
    """Write a value and its error to two digits of the error, e.g. ``10.02 ± 0.22``."""
    digits = max(1 - int(np.floor(np.log10(error))), 0) if error > 0 else 3
    return f"{value:.{digits}f} ± {error:.{digits}f}"
