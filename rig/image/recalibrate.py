"""Seeing a recorded scan with calibrations: those it was taken with, or others."""

import dataclasses
from dataclasses import dataclass

import numpy as np

from recon.capture import Capture
from recon.exhaustive import Exhaustive
from recon.relight import Relit
from rig.errors import DataFileError, UsageError
from rig.files.scan import ScanFile
from rig.image.even_bins import corrected
from rig.model.calibrations.chosen import Calibrations
from rig.model.calibrations.kinds import KINDS
from rig.model.calibrations.store import CalibrationStore
from rig.model.pointing import outside
from rig.model.quantities import show, show_length


@dataclass(frozen=True)
class Seen:
    """A scan as calibrations show it.

    Attributes
    ----------
    capture
        Its measured positions in rectified time.
    fade_from_s
        Rectified time before which the record holds the wall's own light; None where unknown.
    instrument_response_s
        Full width at half maximum; None where unknown.
    rendered
        Whether it was rendered by this program: expectation values, without noise.
    exhaustive
        All pairs, where they are imaged by runs of lasers; ``capture`` is then their outline, to plan with.
    relit
        The same with its lasers focused on a hidden point; ``capture`` is then its outline.
    notes
        What was changed, and what speaks against it, as sentences.
    """

    capture: Capture
    fade_from_s: float | None
    instrument_response_s: float | None
    rendered: bool = False
    notes: tuple[str, ...] = ()
    exhaustive: Exhaustive | None = None
    relit: Relit | None = None

    @property
    def positions(self) -> int:
        """Number of positions, or of pairs."""
        return self.exhaustive.pairs if self.exhaustive else self.capture.positions


def as_recorded(scan: ScanFile) -> Seen:
    """Return a scan with the calibrations that it was taken with."""
    # Others' files of fractions may be counts that were normalised, with all their noise.
    rendered = scan.expectation and scan.simulated
    return Seen(scan.capture(), scan.fade_from_s, scan.instrument_response_s, rendered)


def by_lasers(scan: ScanFile) -> Seen | None:
    """Return an exhaustive capture as it was recorded; None where it is none."""
    found = scan.exhaustive()
    if found is None:
        return None
    rendered = scan.expectation and scan.simulated
    response_s = scan.instrument_response_s
    return Seen(found.outline(), scan.fade_from_s, response_s, rendered, exhaustive=found)


def relit(scan: ScanFile, point_m: tuple[float, float, float]) -> Seen:
    """Return an exhaustive capture as if only one hidden point were lit.

    Raises
    ------
    UsageError
        If the scan is no exhaustive capture, or the point is not in front of the wall.
    """
    seen = by_lasers(scan)
    if seen is None or seen.exhaustive is None:
        raise UsageError(
            f"{scan.path} cannot be relit: that needs an exhaustive capture, many laser spots, each with as "
            "many or more pixels (docs/exhaustive.md); leave --relight out"
        )
    if not point_m[2] > 0:
        raise UsageError(f"--relight gives a point {point_m[2]:g} m from the wall; it must be in front of it")
    found = Relit(seen.exhaustive, np.array(point_m))
    return dataclasses.replace(seen, capture=found.outline(), relit=found)


def from_store(scan: ScanFile, store: CalibrationStore) -> Calibrations:
    """Return the newest calibrations of a store that belong to the devices of a scan.

    Raises
    ------
    UsageError
        If there are none.
    """
    identities = {name: str(settings.get("identity", "")) for name, settings in scan.devices.items()}
    found = [store.newest(kind, identities) for kind in KINDS]
    records = {one.calibration.kind: one.calibration for one in found if one}
    if not records:
        raise UsageError(f"{store.folder} holds no calibration of the devices of {scan.path}")
    return Calibrations(records)


def recalibrated(scan: ScanFile, calibrations: Calibrations) -> Seen:
    """Return a scan as if it had been taken with these calibrations.

    The spots follow from the commanded mirror angles, the rectified time from the legs to these spots.

    Raises
    ------
    DataFileError
        If the file does not hold what is needed for it.
    """
    seen = as_recorded(scan)
    notes = []
    laser_m, first_bin_s, fade_from_s = scan.laser_m, None, seen.fade_from_s
    if calibrations.galvo:
        if scan.mirror_rad is None:
            raise DataFileError(
                f"{scan.path} does not hold the commanded mirror angles (/geometry/mirror_rad), so that no "
                "later calibration of the galvo can be applied to it; scan again"
            )
        pointing = calibrations.galvo.pointing()
        laser_m = pointing.spots_m(scan.mirror_rad)
        moved_m = np.linalg.norm(laser_m - scan.laser_m, axis=1)
        notes.append(f"galvo: spots moved by {show_length(float(np.median(moved_m)))} in the median")
        beyond = int((outside(np.array(pointing.area_m), laser_m[:, :2]) > 0).sum())
        if beyond:
            notes.append(f"galvo: {beyond} of {len(laser_m)} spots are outside the calibrated area")
    if calibrations.galvo or calibrations.time_zero:
        delays = calibrations.time_zero.legs if calibrations.time_zero else scan.delays
        if delays is None or scan.delays is None:
            raise DataFileError(
                f"{scan.path} holds rectified time, or a measured delay of each position: "
                "its path delays cannot be calibrated again"
            )
        before_s = scan.rectified_by_s()
        delay_s = scan.rectified_by_s(delays, laser_m)
        first_bin_s = scan.first_bin_s - delay_s
        notes.append(f"time zero: later by {show(float(np.median(delay_s - before_s)), 's')} in the median")
        if scan.gate_start_s is not None:
            fade_from_s = scan.gate_start_s - float(delay_s.min())
    capture = seen.capture
    if first_bin_s is not None:
        steps, _ = scan.imaged
        pairs_m = np.repeat(laser_m[steps], len(scan.channels), axis=0)
        capture = dataclasses.replace(capture, laser_m=pairs_m, first_bin_s=first_bin_s[steps].ravel())
    response_s = calibrations.response.fwhm_s if calibrations.response else seen.instrument_response_s
    return Seen(capture, fade_from_s, response_s, seen.rendered, tuple(notes))


def with_even_bins(seen: Seen, scan: ScanFile, calibrations: Calibrations) -> Seen:
    """Return a scan whose counts are divided by the real widths of the bins.

    Raises
    ------
    UsageError
        If the bin widths were never measured, or are those of other bins.
    """
    widths = calibrations.bin_widths
    if widths is None:
        raise UsageError(
            f"{scan.path}: the widths of its bins are not known. Measure them with rig calibrate dnl, "
            "and give the folder with --calibrations"
        )
    histograms = corrected(
        seen.capture.histograms, widths, bin_width_s=scan.bin_width_s, first_bin_s=scan.first_bin_s
    )
    note = f"bin widths: counts divided by widths that differ by {widths.nonlinearity:.2%} rms"
    return dataclasses.replace(
        seen,
        capture=dataclasses.replace(seen.capture, histograms=histograms),
        notes=(*seen.notes, note),
    )
