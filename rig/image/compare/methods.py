"""One capture by all methods that can image it, at the same resolution, measured alike.

All have the same voxels. The phasor field (`METHODS`, the first) passes a band around its carrier; the others
would use whatever the record holds, so their record is low-passed first: a Gaussian leaves half of the
frequency at which half of the virtual pulse's spectrum is left, above its carrier. See
``docs/decisions/0014-compared-at-one-highest-frequency.md``.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from recon.depth import compensate_falloff, front_view
from recon.errors import GeometryError
from recon.registry import CLASSIC_SOLVERS, SOLVERS
from recon.solvers.classic.resample import ConfocalLattice
from rig.errors import UsageError, printable
from rig.files import Volume, read_volume
from rig.image.compare.alone import Job, in_a_process
from rig.image.compare.found import Compared, Comparison, row
from rig.image.compare.subject import is_scan, matched, opened
from rig.image.low_pass import FWHM, low_pass_sigma_s
from rig.image.measures import measure
from rig.image.request import Request
from rig.image.truth import known_truth, true_depth
from rig.image.work import Work
from rig.show.compare import Column, comparison_figure
from rig.show.saving import save

#: The methods that are compared; the first sets the resolution.
METHODS = ("rsd", *CLASSIC_SOLVERS)


def volumes_of(file: Path, folder: Path) -> dict[str, Path]:
    """Return where the volume of each method is kept."""
    return {method: folder / f"{file.stem}-{method}-volume.h5" for method in METHODS}


def compare(
    file: Path,
    request: Request,
    sheet: Path,
    *,
    truth: str | None = None,
    keep: Path | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Comparison:
    """Image a capture by all methods that apply, measure the images, and draw them on one sheet.

    Each method runs in a process of its own, so that the memory that it takes can be told.

    Parameters
    ----------
    file
        A scan, or a file of another lab that can be imported without being asked for more.
    request
        Wavelength, depths and voxels; None leaves the choice to the program. Planes are an eighth of the
        wavelength apart if no depths are given, and voxels a whole part of the wall's spacing, near half the
        wavelength.
    sheet
        The picture to write.
    truth
        As `rig.image.truth.true_depth` takes it; None takes what the file holds or names itself.
    keep
        Folder for the volumes; None keeps none.
    progress
        Called with the fraction that is done.

    Raises
    ------
    UsageError
        If the file is a volume, the truth cannot be had, or no method has an image.
    DataFileError
        If the file cannot be read.
    recon.errors.ReconError
        If the phasor field cannot image it.
    """
    with TemporaryDirectory() as folder, opened(file, Path(folder)) as scan:
        truth = truth or known_truth(scan.path if is_scan(file) else file, scan)
        work, reason = matched(scan, request)
        if not any(counts.any() for _, counts in work.capture.histograms.blocks()):
            raise UsageError(f"{file}: the record has no counts; there is nothing to compare")
        grid = work.grid
        truth_m = true_depth(truth, grid.x_m, grid.y_m) if truth else None
        sigma_s = low_pass_sigma_s(work.pulse)
        methods, columns = [], []
        if truth_m is not None:
            columns.append(Column("truth", None, truth_m))
        paths = volumes_of(file, keep or Path(folder))
        for number, (method, path) in enumerate(paths.items()):
            job = Job(scan.path, replace(work.request, solver=method), sigma_s, path)
            one = _compared(method, job, work, truth_m)
            methods.append(one)
            if not one.reason:
                columns.append(column(one, read_volume(path), truth_m is not None))
            progress((number + 1) / len(METHODS))
    if all(one.reason for one in methods):
        raise UsageError(f"{file}: no method has an image; of {METHODS[0]}: {methods[0].reason}")
    compared = Comparison(file, sheet, truth, work, reason, FWHM * sigma_s, tuple(methods))
    save(comparison_figure(columns, grid.x_m, grid.y_m, printable(file.name), compared.summary()), sheet)
    return compared


def _compared(method: str, job: Job, work: Work, truth_m: NDArray[np.float64] | None) -> Compared:
    """Image by one method in a process of its own, and measure."""
    approximate = False
    if SOLVERS[method].confocal_grid:
        try:
            approximate = ConfocalLattice.of(work.capture, method).approximate
        except GeometryError as error:
            return Compared(method, error.found)
    done = in_a_process(job)
    if isinstance(done, str):
        return Compared(method, done)
    costs, notes = done
    volume = read_volume(job.volume)
    falloff = float(volume.parameters.get("falloff_power", 4.0))
    try:
        measured = measure(volume, truth_m, falloff=falloff, margin_m=work.pulse.wavelength_m).document
    except UsageError as error:  # dark throughout
        return Compared(method, str(error))
    widths = measured["widths"]
    across = [width for axis in "xy" if (width := widths[axis]["fwhm_m"]) is not None]
    resolution = {"across_m": min(across, default=None), "deep_m": widths["z"]["fwhm_m"]}
    return Compared(method, "", approximate, {**costs, **resolution, **measured}, notes)


def column(one: Compared, volume: Volume, with_truth: bool) -> Column:
    """Return what the sheet shows of a method: its volume, and its numbers beneath."""
    falloff = float(volume.parameters.get("falloff_power", 4.0))
    front = np.sqrt(front_view(compensate_falloff(volume.intensity, volume.z_m, falloff)))
    cells = row(one)
    lines = [
        f"{cells['time']}, {cells['memory']}",
        f"across {cells['across']}, deep {cells['deep']}",
        f"contrast {cells['contrast']}, signal/noise {cells['signal/noise']}",
    ]
    if with_truth:
        lines.append(f"overlap {cells['overlap']}, depth off by {cells['depth error']}")
    title = f"{one.method} (approximation)" if one.approximate else one.method
    return Column(title, front / front.max(), volume.depth_m, tuple(lines))
