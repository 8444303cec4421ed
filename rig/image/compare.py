"""One capture by all methods that can image it, at the same resolution, measured alike.

All have the same voxels. The phasor field (`METHODS`, the first) passes a band around its carrier; the others
would use whatever the record holds, so their record is low-passed first: a Gaussian leaves half of the
frequency at which half of the virtual pulse's spectrum is left, above its carrier. See
``docs/decisions/0014-compared-at-one-highest-frequency.md``.
"""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from math import log, sqrt
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.capture import Capture
from recon.defaults import spacing_m
from recon.depth import compensate_falloff, front_view
from recon.errors import GeometryError, ReconError
from recon.grid import VoxelGrid
from recon.imaging import image
from recon.noise import quiet_level
from recon.registry import CLASSIC_SOLVERS, SOLVERS, entry_of, name_of
from recon.result import Image
from recon.solvers.classic.resample import ConfocalLattice
from recon.solvers.classic.solve import baseline_image
from recon.surface import find
from recon.wave import VirtualPulse
from rig.errors import DataFileError, RigError, UsageError, no_file, printable
from rig.files import ScanFile, Volume, read_volume, write_volume
from rig.files.check import open_hdf5, plain
from rig.files.journal import journal_of
from rig.files.mend import keep_as_it_is
from rig.files.volume import is_volume
from rig.image.focus import settled
from rig.image.low_pass import low_passed
from rig.image.measures import measure
from rig.image.request import Request
from rig.image.truth import known_truth, true_depth
from rig.image.work import Work, chosen
from rig.importers import import_scan
from rig.model.quantities import show, show_length
from rig.show.compare import Column, comparison_figure
from rig.show.volume import save

#: The methods that are compared; the first sets the resolution.
METHODS = ("rsd", *CLASSIC_SOLVERS)
#: Planes in a wavelength: the second derivative along depth has to see the finest period, 0.4 of one.
PLANES = 8
#: Planes that each method images before its time is taken, so that its programs are compiled.
FIRST_PLANES = 2
#: Full width at half maximum of a Gaussian, in standard deviations.
FWHM = 2 * sqrt(2 * log(2))


@dataclass(frozen=True)
class Compared:
    """One method's part of a comparison.

    Attributes
    ----------
    method
        Its name as a solver.
    reason
        Why there is no image; empty where there is one.
    approximate
        Whether the data had to be converted for it.
    found
        Costs, and measures as of `rig.image.measures.measure`; plain values, empty where there is no image.
    notes
        What a reader has to know, in sentences.
    """

    method: str
    reason: str = ""
    approximate: bool = False
    found: dict[str, Any] | None = None
    notes: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain values."""
        told = {"method": self.method, "applies": not self.reason}
        if self.reason:
            return {**told, "reason": self.reason}
        return {**told, "approximate": self.approximate, "notes": list(self.notes), **(self.found or {})}


@dataclass(frozen=True)
class Comparison:
    """A capture by all methods.

    Attributes
    ----------
    file, sheet
        What was compared, and the picture.
    truth
        What is really there, as `rig.image.truth.true_depth` takes it; None where nobody knows.
    work
        Pulse and voxels.
    reason
        Why this wavelength.
    low_pass_s
        Full width at half maximum of the Gaussian that the record of all but the phasor field is convolved
        with.
    methods
        One for each.
    """

    file: Path
    sheet: Path
    truth: str | None
    work: Work
    reason: str
    low_pass_s: float
    methods: tuple[Compared, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain values."""
        grid = self.work.grid
        return {
            "file": str(self.file),
            "sheet": str(self.sheet),
            "truth": self.truth,
            "positions": self.work.capture.positions,
            "wavelength_m": self.work.pulse.wavelength_m,
            "wavelength_reason": self.reason,
            "cycles": self.work.pulse.cycles,
            "low_pass_fwhm_s": self.low_pass_s,
            "voxels": (len(grid.x_m), len(grid.y_m), len(grid.z_m)),
            "depth_m": (float(grid.z_m[0]), float(grid.z_m[-1])),
            "methods": [one.as_dict() for one in self.methods],
        }

    def summary(self) -> str:
        """Return what all methods have in common, in a line."""
        pulse, grid = self.work.pulse, self.work.grid
        voxels = " x ".join(str(len(axis)) for axis in (grid.x_m, grid.y_m, grid.z_m))
        return (
            f"wavelength {show_length(pulse.wavelength_m)}, {pulse.cycles:g} cycles; the others' record "
            f"low-passed by {show(self.low_pass_s, 's')}; {voxels} voxels, depths {grid.z_m[0]:.2f} to "
            f"{grid.z_m[-1]:.2f} m"
        )


@dataclass(frozen=True)
class _Job:
    """What a process is told to image."""

    scan: Path
    request: Request
    sigma_s: float
    volume: Path


#: What a job cost, and what is to be said about its image.
_Done = tuple[dict[str, float | None], tuple[str, ...]]


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
    with TemporaryDirectory() as folder, _opened(file, Path(folder)) as scan:
        truth = truth or known_truth(scan.path if _is_scan(file) else file, scan)
        work, reason = _matched(scan, request)
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
            job = _Job(scan.path, replace(work.request, solver=method), sigma_s, path)
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


def low_pass_sigma_s(pulse: VirtualPulse) -> float:
    """Return the Gaussian that leaves half where half of the virtual pulse's spectrum is left.

    The spectrum exp(-(omega - omega_0)^2 sigma_t^2 / 2) is 1/2 at omega_h = omega_0 + sqrt(2 ln 2) / sigma_t,
    and so is exp(-omega_h^2 sigma^2 / 2) for sigma = sqrt(2 ln 2) / omega_h.
    """
    half = sqrt(2 * log(2))
    return half / (pulse.carrier_rad_per_s + half / pulse.sigma_s)


def check_comparable(file: Path, tell: Callable[[str], None] = lambda sentence: None) -> None:
    """Refuse what is no capture, before anything is computed.

    Raises
    ------
    UsageError
        If the file is a volume.
    DataFileError
        If it does not exist, or is a scan that cannot be read.
    """
    if not file.is_file():
        raise DataFileError(no_file(file, "give scans, e.g. of 'rig scan'"))
    if is_volume(file):
        raise UsageError(
            f"{file} is a volume, already imaged by one method; give the scan that it was made from, "
            f"{read_volume(file).scan or 'which it does not name'}"
        )
    if _is_scan(file):
        with ScanFile(file) as scan:
            for sentence in scan.doubts:
                tell(sentence)


def _is_scan(file: Path) -> bool:
    if journal_of(file).exists():  # a scan writes it, or was killed: its reader takes what there is
        return True
    try:
        with open_hdf5(file) as held:
            return bool(plain(held.attrs.get("format")) == "rig-scan")
    except DataFileError:  # no HDF5, so another lab's
        return False


@contextmanager
def _opened(file: Path, folder: Path) -> Iterator[ScanFile]:
    """Open a scan, or what is imported as one into a folder."""
    check_comparable(file)
    path, own = file, folder / f"{file.stem}.h5"
    if not _is_scan(file):
        path = own
        import_scan(file, path)
    elif keep_as_it_is(file, own):  # all methods are to see the same, however long each takes
        path = own
    with ScanFile(path) as scan:
        yield scan


def _matched(scan: ScanFile, request: Request) -> tuple[Work, str]:
    """Choose the wavelength as `rig recon` does, and voxels that show what it resolves."""
    work, reason = settled(scan, request)
    wavelength_m = work.pulse.wavelength_m
    pitch_m = spacing_m(work.capture)
    voxel_m = request.voxel_m or pitch_m / max(1, round(2 * pitch_m / wavelength_m))
    z_m = work.grid.z_m
    depth_m = request.depth_m or (float(z_m[0]), float(z_m[-1]), wavelength_m / PLANES)
    exact = replace(request, wavelength_m=wavelength_m, voxel_m=voxel_m, depth_m=depth_m)
    return chosen(scan, exact)[0], reason


def _compared(method: str, job: _Job, work: Work, truth_m: NDArray[np.float64] | None) -> Compared:
    """Image by one method in a process of its own, and measure."""
    approximate = False
    if SOLVERS[method].confocal_grid:
        try:
            approximate = ConfocalLattice.of(work.capture, method).approximate
        except GeometryError as error:
            return Compared(method, error.found)
    done = _in_a_process(job)
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


def _in_a_process(job: _Job) -> _Done | str:
    """Run a job in a process that ends with it, even if this one ends before."""
    context = get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_report, args=(job, theirs), daemon=True)
    process.start()
    theirs.close()
    try:
        done: _Done | str | RigError = ours.recv()
    except EOFError:
        process.join()
        if process.exitcode is None or process.exitcode > 0:
            raise RuntimeError(
                f"the process of {name_of(job.request.solver)} failed; its messages are above"
            ) from None
        return "its process was ended by the system, probably because of too little memory"
    finally:
        process.terminate()
        process.join()
    if isinstance(done, RigError):
        raise done
    return done


def _report(job: _Job, theirs: Connection) -> None:
    done: _Done | str | RigError
    try:
        done = _run(job)
    except RigError as error:
        done = error
    with suppress(BrokenPipeError):  # nobody waits any more
        theirs.send(done)


def _run(job: _Job) -> _Done | str:
    """Image, and write the volume; return what it cost and what to say, or why there is no image."""
    with ScanFile(job.scan) as scan:
        work, _ = chosen(scan, job.request)
        capture = work.capture
        if not entry_of(job.request.solver).virtual_wave:
            capture = low_passed(capture, job.sigma_s)
        before = peak_memory_bytes()
        try:
            _imaged(work, capture, _few_planes(work.grid))
            began_s, busy_s = time.perf_counter(), time.process_time()
            found = _imaged(work, capture, work.grid)
        except ReconError as error:
            return str(error)
        except MemoryError:
            return "there is too little memory for so many voxels"
        costs = {
            "took_s": time.perf_counter() - began_s,
            "processor_s": time.process_time() - busy_s,
            "memory_bytes": peak_memory_bytes(),
            "memory_before_bytes": before,
        }
    # one rule for all images: a surface is what stands out from the image's own quiet part
    write_volume(job.volume, work.volume(found, find(found, quiet_level(found.intensity))))
    return costs, found.notes


def _imaged(work: Work, capture: Capture, grid: VoxelGrid) -> Image:
    solver = work.request.solver
    if entry_of(solver).virtual_wave:
        return image(capture, work.pulse, grid, solver=solver, window=work.window)
    return baseline_image(capture, grid, solver=name_of(solver), window=work.window)


def _few_planes(grid: VoxelGrid) -> VoxelGrid:
    middle = len(grid.z_m) // 2
    return VoxelGrid(grid.x_m, grid.y_m, grid.z_m[middle : middle + FIRST_PLANES])


def peak_memory_bytes() -> int | None:
    """Return the most memory that this process has held; None where the system does not tell.

    Linux tells it for the program alone in /proc; what getrusage tells there begins with the memory of the
    process that started this one.
    """
    status = Path("/proc/self/status")
    if status.exists():
        line = next(
            line for line in status.read_text(encoding="utf-8").splitlines() if line.startswith("VmHWM")
        )
        return int(line.split()[1]) * 1024
    if sys.platform == "win32":
        return None
    import resource

    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most if sys.platform == "darwin" else most * 1024


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


#: Heads of the table of numbers, and what stands where there is none.
HEADS = (
    "time",
    "processor",
    "memory",
    "across",
    "deep",
    "contrast",
    "signal/noise",
    "overlap",
    "depth error",
    "within 5 cm",
)
NOTHING = "–"


def row(one: Compared) -> dict[str, str]:
    """Return a method's numbers as a person reads them, by the heads of the table."""
    found = one.found or {}
    depth = found.get("depth", {})

    def told(value: float | None, form: Callable[[float], str]) -> str:
        return NOTHING if value is None else form(value)

    cells = (
        told(found.get("took_s"), lambda s: f"{s:.2g} s" if s < 10 else f"{s:.0f} s"),
        told(found.get("processor_s"), lambda s: f"{s:.2g} s" if s < 10 else f"{s:.0f} s"),
        told(found.get("memory_bytes"), lambda most: f"{most / 1e6:.0f} MB"),
        told(found.get("across_m"), lambda m: f"{m * 100:.1f} cm"),
        told(found.get("deep_m"), lambda m: f"{m * 100:.1f} cm"),
        told(found.get("contrast"), lambda c: f"{c:.2f}"),
        told(found.get("signal_to_noise"), lambda ratio: f"{ratio:.1f}"),
        told(found.get("overlap"), lambda part: f"{part:.2f}"),
        told(depth.get("median_absolute_m"), lambda m: f"{m * 1000:.0f} mm"),
        told(depth.get("close"), lambda part: f"{100 * part:.0f} %"),
    )
    return dict(zip(HEADS, cells, strict=True))
