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
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import norm

from rig.acquire.acquisition import Watch, record
from rig.acquire.connect import Station
from rig.calibrate.counts import (
    counts_of,
    live_s,
    passes_of,
    period_s,
    refuse_saturated,
    settings_of,
    sound_scans,
)
from rig.calibrate.routine import Routine, changed, origin
from rig.errors import CalibrationError
from rig.files.scan import ScanFile
from rig.model.calibrations.kinds import BinWidths
from rig.model.config import RigConfig
from rig.model.devices import Preparation
from rig.model.plan import Pass, ScanPlan, Spots
from rig.model.state import RigState

#: Fewer counts a bin say nothing: their noise of 10 % is far above any instrument's non-linearity.
LEAST_COUNTS = 100
#: Bins taken together to see whether the light follows the laser, and what no instrument's bins do together.
TOGETHER, TOGETHER_OFF = 64, 0.01


@dataclass(frozen=True)
class DnlRoutine(Routine[BinWidths]):
    """Measures the widths of the bins that scans use.

    Attributes
    ----------
    exposure_s
        Of the whole measurement.
    exposures
        In how many parts it is taken.
    """

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
        path = folder / "dnl.h5"
        record(ScanPlan(passes=(lamp,)), state.nominal, station.devices, path, watch, station.operator)
        return [path]

    def fit(self, files: Sequence[Path], state: RigState) -> BinWidths:
        """Return the widths of the bins, counts of several files taken together."""
        with sound_scans(files) as scans:
            first = scans[0]
            covered = _covered(first)
            counts = np.sum([_counts(scan, first) for scan in scans], axis=0)[covered]
            counted, mean = _widths(files[0], counts, np.flatnonzero(covered))
            off = counted - 1
            variance = off.var()
            error = np.sqrt(((off**2).var()) / len(off))  # of a variance, whatever the distribution
            real = max(variance - 1 / mean, 0.0)
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
        """Draw widths over bins, their distribution, and what is left when neighbours are taken together."""
        return dnl_figure(found)


def blocks_off(off: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (blocks,) mean deviations of `TOGETHER` neighbouring bins."""
    size = min(TOGETHER, max(len(off) // 16, 1))
    whole = len(off) // size * size
    return off[:whole].reshape(-1, size).mean(axis=1)


def _covered(scan: ScanFile) -> NDArray[np.bool_]:
    """Return (bins,) which bins lie inside the sync period; to those after it nothing is ever counted.

    Where a bin really ends differs from where it should by what all bins before it have too much or too
    little, so the last few are left out: four standard deviations of a non-linearity of 1 %, and two bins.
    """
    edges_s = scan.first_bin_s + np.arange(scan.bins + 1) * scan.bin_width_s
    margin_s = (2 + np.ceil(0.04 * np.sqrt(scan.bins))) * scan.bin_width_s
    period = period_s(settings_of(scan))
    return np.asarray(edges_s[1:] <= max(period - margin_s, 0.0))


def _counts(scan: ScanFile, first: ScanFile) -> NDArray[np.float64]:
    if settings_of(scan).detector.gated:
        raise CalibrationError(
            f"{scan.path} was measured through the gate, which shapes the counts: let the detector run freely"
        )
    mine, others = ((s.bins, s.bin_width_s, s.first_bin_s) for s in (scan, first))
    if mine != others:
        raise CalibrationError(f"{scan.path} has other bins than {first.path}: give files with the same bins")
    counts = counts_of(scan).sum(axis=0)
    part = _covered(scan).sum() * scan.bin_width_s / period_s(settings_of(scan))
    refuse_saturated(passes_of([scan])[0], float(counts.sum()) / live_s(scan) / part)
    return counts


def _widths(path: Path, counts: NDArray[np.float64], bins: NDArray) -> tuple[NDArray[np.float64], float]:
    """Return counted widths about 1, and the mean count, after refusing what is not steady light."""
    mean = float(counts.mean()) if len(counts) else 0.0
    if mean < LEAST_COUNTS:
        raise CalibrationError(
            f"{path}: {mean:.1f} counts a bin are too few, {LEAST_COUNTS} are the least and 1/(rms width "
            "deviation)^2 are wanted: measure longer with --exposure, or more light"
        )
    empty = bins[counts == 0]
    if len(empty):
        raise CalibrationError(
            f"{path}: {len(empty)} bins between {empty[0]} and {empty[-1]} are empty while the others have "
            f"{mean:.0f} counts: only part of them was lit. The light has to be steady and the detector free "
            "running; check lamp and gate"
        )
    counted = counts / mean
    together = blocks_off(counted - 1)
    size = len(counted) // len(together)
    far = np.abs(together).max()
    if far > max(TOGETHER_OFF, 6 * counted.std() / np.sqrt(size)):
        at = bins[int(np.abs(together).argmax()) * size]
        raise CalibrationError(
            f"{path}: bins {at} to {at + size - 1} have {100 * far:.1f} % more or less than the mean, all "
            "together: the light follows the laser. Block the beam, light the wall with a steady lamp that "
            "does not pulse, and measure again"
        )
    return counted, mean


def dnl_figure(found: BinWidths) -> Figure:
    """Draw widths over time, their distribution beside counting noise, and neighbours taken together."""
    counted = np.array([np.nan if width is None else 100 * (width - 1) for width in found.measured])
    known = np.isfinite(counted)
    centres_ns = 1e9 * (found.first_bin_s + (np.arange(len(counted)) + 0.5) * found.bin_width_s)
    noise = 100 * found.noise
    figure = Figure(figsize=(12, 7.5), dpi=100, facecolor="white", layout="constrained")
    axes = figure.subplot_mosaic([["widths", "widths"], ["spread", "together"]])
    figure.suptitle(
        f"bin widths: {found.counts_per_bin:,.0f} counts a bin, non-linearity "
        f"{100 * found.nonlinearity:.3f} % rms "
        f"(at most {100 * found.nonlinearity_at_most:.3f} %), {100 * found.kept:.1f} % of a deviation "
        "believed"
    )

    panel = axes["widths"]
    panel.plot(centres_ns, counted, ".", markersize=2, color="0.6", label="as counted")
    panel.plot(centres_ns[known], 100 * (found.widths[known] - 1), ".", markersize=2, color="#20639b",
               label="believed: shrunk towards 0")  # fmt: skip
    if not known.all():
        start = centres_ns[~known][0]
        panel.axvspan(start, centres_ns[-1], color="0.9", label="not measured: after the sync period")
    panel.set(xlabel="time after the sync pulse (ns)", ylabel="width, deviation from mean (%)")
    panel.legend(loc="upper right", markerscale=4)

    panel = axes["spread"]
    off = counted[known]
    edges = np.linspace(-1, 1, 61) * max(np.abs(off).max(), 3 * noise)
    panel.hist(off, edges, color="0.75", label="as counted")
    believed = norm.pdf(edges, scale=noise) * len(off) * (edges[1] - edges[0])
    panel.plot(edges, believed, color="#c1440e", label=f"counting noise alone, {noise:.3g} %")
    panel.set(xlabel="deviation (%)", ylabel="bins")
    panel.legend(loc="upper right", fontsize="small")

    panel = axes["together"]
    together = blocks_off(off)
    size = len(off) // len(together)
    error = noise / np.sqrt(size)
    middle_ns = centres_ns[known][: len(together) * size].reshape(-1, size).mean(axis=1)
    panel.axhspan(-2 * error, 2 * error, color="#c1440e", alpha=0.15, label="two standard errors of counting")
    panel.plot(middle_ns, together, ".-", linewidth=0.6, color="#20639b")
    panel.set(
        xlabel="time after the sync pulse (ns)",
        ylabel="mean deviation (%)",
        title=f"{size} neighbouring bins together: flat where the light is steady",
    )
    panel.legend(loc="upper right", fontsize="small")
    return figure
