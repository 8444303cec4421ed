"""Bin widths: light that knows nothing of the laser fills all bins alike, but for their widths.

With N counts a bin a width is known to 1/sqrt(N), and an instrument's non-linearity is often less than that:
a correction by counted widths would add more noise than it takes away. So the non-linearity's variance S is
estimated over all bins, and each deviation is shrunk by S / (S + 1/N), the mean of what it can be given the
count (Wiener's filter; James and Stein's empirical Bayes, see Efron and Morris, J. Am. Stat. Assoc. 68, 117
(1973)).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import norm

from rig.acquire.acquisition import Watch
from rig.acquire.connect import Station
from rig.calibrate import Floats, figures, require
from rig.calibrate.raw import Raw, origin, reading
from rig.calibrate.routine import Routine, changed, recorded
from rig.errors import CalibrationError
from rig.model.calibrations.kinds import BinWidths
from rig.model.config import RigConfig
from rig.model.devices import Preparation
from rig.model.plan import Pass, ScanPlan, Spots
from rig.model.state import RigState

#: Fewer counts a bin say nothing: their noise of 10 % is far above any instrument's non-linearity.
MIN_COUNTS = 100
#: Bins taken together to see whether the light follows the laser, and what no instrument's bins do together.
TOGETHER, MAX_TOGETHER = 64, 0.01


@dataclass(frozen=True)
class DnlRoutine(Routine[BinWidths]):
    """Measures the widths of the bins that scans use, in so many exposures of so long all together."""

    exposure_s: float = 20.0
    exposures: int = 4

    makes = BinWidths

    def setup(self, config: RigConfig) -> RigConfig:
        """Return the scan's own bins, the detector free running: a gate follows the sync pulses."""
        return changed(config, detector={"gated": False})

    def measure(self, station: Station, state: RigState, folder: Path, watch: Watch) -> list[Path]:
        """Count a steady lamp."""
        lamp = Pass(
            name="lamp",
            positions=Spots(spots=((0.0, 0.0, 0.0),)),
            frames=self.exposures,
            exposure_s=max(round(self.exposure_s / self.exposures, 3), 1e-3),
            preparation=Preparation.LAMP,
        )
        plan = ScanPlan(passes=(lamp,))
        return [recorded(folder / "dnl.h5", plan, state.nominal, station, watch)]

    def fit(self, files: Sequence[Path], state: RigState) -> BinWidths:
        """Return the widths of the bins, counts of several files taken together."""
        with reading(files) as (scans, passes):
            first = passes[0]
            covered = _covered(first)
            counts = np.sum([_counts(one, first) for one in passes], axis=0)[covered]
            counted, mean = _widths(files[0], counts, np.flatnonzero(covered))
            off = counted - 1
            error = np.sqrt((off**2).var() / len(off))  # of a variance, whatever the distribution
            real = max(off.var() - 1 / mean, 0.0)
            widths = np.full(first.bins, np.nan)
            widths[covered] = counted
            return BinWidths(
                **origin(BinWidths, scans),
                valid_days=365,
                bin_width_s=first.bin_width_s,
                first_bin_s=first.first_bin_s,
                measured=[None if np.isnan(width) else round(float(width), 6) for width in widths],
                counts_per_bin=mean,
                nonlinearity=float(np.sqrt(real)),
                nonlinearity_at_most=float(np.sqrt(real + 2 * error)),
                kept=float(real / (real + 1 / mean)),
            )

    def figure(self, files: Sequence[Path], found: BinWidths) -> Figure:
        """Draw widths over time, their distribution beside counting noise, and neighbours taken together."""
        off = np.array([np.nan if width is None else 100 * (width - 1) for width in found.measured])
        time_ns = 1e9 * (
            found.first_bin_s + (np.arange(len(off), dtype=np.float64) + 0.5) * found.bin_width_s
        )
        figure, axes = figures.panels(
            f"bin widths: {found.counts_per_bin:,.0f} counts a bin, non-linearity "
            f"{100 * found.nonlinearity:.3f} % rms (at most {100 * found.nonlinearity_at_most:.3f} %), "
            f"{100 * found.kept:.1f} % of a deviation kept",
            [["widths", "widths"], ["spread", "together"]], (12, 7.5),
        )  # fmt: skip
        known = np.isfinite(off)
        _draw_widths(axes["widths"], time_ns, off, found.widths)
        _draw_spread(axes["spread"], off[known], 100 * found.noise)
        _draw_together(axes["together"], time_ns[known], off[known], 100 * found.noise)
        return figure


def blocks_off(off: Floats) -> Floats:
    """Return (blocks,) mean deviations of `TOGETHER` neighbouring bins."""
    size = min(TOGETHER, max(len(off) // 16, 1))
    whole = len(off) // size * size
    return off[:whole].reshape(-1, size).mean(axis=1)


def _covered(one: Raw) -> NDArray[np.bool_]:
    """Return (bins,) which bins lie inside the sync period; to those after it nothing is ever counted.

    Where a bin really ends differs from where it should by what all bins before it have too much or too
    little, so the last few are left out: four standard deviations of a non-linearity of 1 %, and two bins.
    """
    margin_s = (2 + np.ceil(0.04 * np.sqrt(one.bins))) * one.bin_width_s
    return one.edges_s[1:] <= max(one.period_s - margin_s, 0.0)


def _counts(one: Raw, first: Raw) -> Floats:
    one.refuse_gated()
    mine, others = ((each.bins, each.bin_width_s, each.first_bin_s) for each in (one, first))
    require(mine == others, f"{one.label} has other bins than {first.label}: give files with the same bins")
    counts = one.counts.sum(axis=0)
    part = _covered(one).sum() * one.bin_width_s / one.period_s
    one.refuse_saturated(float(counts.sum()) / one.total_live_s / part)
    return counts


def _widths(path: Path, counts: Floats, bins: NDArray) -> tuple[Floats, float]:
    """Return counted widths about 1, and the mean count, after refusing what is not steady light."""
    mean = float(counts.mean()) if len(counts) else 0.0
    require(
        mean >= MIN_COUNTS,
        f"{path}: {mean:.1f} counts a bin are too few, {MIN_COUNTS} are the least and 1/(rms width "
        "deviation)^2 are wanted: measure longer with --exposure, or more light",
    )
    empty = bins[counts == 0]
    if len(empty):
        raise CalibrationError(
            f"{path}: {len(empty)} bins between {empty[0]} and {empty[-1]} are empty while the others have "
            f"{mean:.0f} counts: only part of them was lit. The light must be steady and the detector "
            "free-running; check lamp and gate"
        )
    counted = counts / mean
    together = np.abs(blocks_off(counted - 1))
    size = len(counted) // len(together)
    far, at = together.max(), bins[int(together.argmax()) * size]
    require(
        far <= max(MAX_TOGETHER, 6 * counted.std() / np.sqrt(size)),
        f"{path}: bins {at} to {at + size - 1} have {100 * far:.1f} % more or less than the mean, all "
        "together: the light follows the laser. Block the beam, light the wall with a steady lamp that does "
        "not pulse, and measure again",
    )
    return counted, mean


def _draw_widths(axes: Axes, time_ns: Floats, off: Floats, widths: Floats) -> None:
    known = np.isfinite(off)
    for values, colour, label in (
        (off, figures.GREY, "as counted"),
        (100 * (widths - 1), figures.BLUE, "kept: shrunk towards 0"),
    ):
        axes.plot(time_ns[known], values[known], ".", markersize=2, color=colour, label=label)
    if not known.all():
        label = "not measured: after the sync period"
        axes.axvspan(time_ns[~known][0], time_ns[-1], color="0.9", label=label)
    axes.set(xlabel="time after the sync pulse (ns)", ylabel="width, deviation from mean (%)")
    axes.legend(loc="upper right", markerscale=4)


def _draw_spread(axes: Axes, off: Floats, noise: float) -> None:
    edges = np.linspace(-1, 1, 61) * max(np.abs(off).max(), 3 * noise)
    axes.hist(off, edges, color="0.75", label="as counted")
    due = norm.pdf(edges, scale=noise) * len(off) * (edges[1] - edges[0])
    axes.plot(edges, due, color=figures.RED, label=f"counting noise alone, {noise:.3g} %")
    axes.set(xlabel="deviation (%)", ylabel="bins")
    axes.legend(loc="upper right", fontsize="small")


def _draw_together(axes: Axes, time_ns: Floats, off: Floats, noise: float) -> None:
    together = blocks_off(off)
    size = len(off) // len(together)
    error = 2 * noise / np.sqrt(size)
    middle_ns = time_ns[: len(together) * size].reshape(-1, size).mean(axis=1)
    axes.axhspan(-error, error, color=figures.RED, alpha=0.15, label="two standard errors of counting")
    figures.residuals(axes, middle_ns, together, fmt=".-", linewidth=0.6)
    axes.set(xlabel="time after the sync pulse (ns)", ylabel="mean deviation (%)",
             title=f"{size} neighbouring bins together: flat if the light is steady")  # fmt: skip
    axes.legend(loc="upper right", fontsize="small")
