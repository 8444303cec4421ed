"""A quick, coarse picture of a scan, made again and again while parameters are tried.

What is read of the scan is a coarse copy of it (`recon.coarse`), which is kept under the scan's digest: the
next picture, with another wavelength or other depths, is made without reading the scan.
"""

import dataclasses
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from recon import defaults
from recon.capture import ArrayHistograms, Capture
from recon.coarse import Coarse, coarse
from rig.errors import UsageError, printable
from rig.files import kept
from rig.files.journal import has_journal
from rig.files.recorded import digest_of_file
from rig.files.scan import ScanFile
from rig.image.drawing import Drawing
from rig.image.focus import still
from rig.image.origin import origin
from rig.image.recalibrate import Seen, as_recorded
from rig.image.request import Request
from rig.image.result import Result
from rig.image.work import planned, warnings_of
from rig.model.quantities import show_length

#: Changes with what is kept; copies of other programs are made again.
FORM = 1
#: What a preview is made with; all else is for an image.
_FREE = ("wavelength_m", "cycles", "depth_m", "width_m", "height_m", "voxel_m", "fade_from_s")


@dataclass(frozen=True)
class Facts:
    """What imaging has to know of a scan beside its photons; what JSON can hold.

    Attributes
    ----------
    digest
        Of the scan.
    positions
        That were measured.
    wavelength_m, reason
        Chosen for the scan, and why.
    rendered, fade_from_s, response_s
        As of `rig.image.recalibrate.Seen`.
    doubts
        What a person must know who reads the scan.
    origin
        Where it comes from (`rig.image.origin`).
    form
        Of what is kept.
    """

    digest: str
    positions: int
    wavelength_m: float
    reason: str
    rendered: bool
    fade_from_s: float | None
    response_s: float | None
    doubts: list[str]
    origin: dict[str, Any]
    form: int = FORM


#: Reads facts that were kept: a cache is data, and may hold anything.
_FACTS = TypeAdapter(Facts)


@dataclass(frozen=True)
class Copy:
    """A coarse copy of a scan, and what is known of the scan."""

    found: Coarse
    facts: Facts


def preview(
    scan_path: Path,
    request: Request,
    drawing: Drawing,
    progress: Callable[[float], None] | None = None,
) -> Result:
    """Draw a coarse image of a scan; only the picture is written, and replaced if it is there.

    Raises
    ------
    rig.errors.UsageError
        If something is asked that a preview does not do.
    rig.errors.DataFileError
        If the scan cannot be read.
    recon.errors.ReconError
        If it cannot be imaged as asked.
    """
    _check(request)
    copy, read_s = _copy_of(scan_path)
    began_s = time.monotonic()
    facts, found = copy.facts, copy.found
    wavelength_m, reason = _wavelength(request.wavelength_m, copy)
    request = dataclasses.replace(request, wavelength_m=wavelength_m)
    seen = Seen(found.capture, facts.fade_from_s, facts.response_s, facts.rendered)
    work = planned(request, seen, printable(scan_path.name), facts.digest, facts.origin)
    work, _, volume = still(work, "", progress)
    parameters = {**volume.parameters, "preview_cell_m": found.side_m}
    # without the panel of confidence: drawing takes as long as imaging
    volume = dataclasses.replace(volume, parameters=parameters, confidence=None)
    drawing.begin(volume)
    drawing.save(volume)
    warnings = (*facts.doubts, *warnings_of(work))
    return Result(volume, reason, warnings, facts.positions, time.monotonic() - began_s, read_s)


def _wavelength(asked_m: float | None, copy: Copy) -> tuple[float, str]:
    """Return the wavelength of the picture, and why it is that."""
    facts, least_m = copy.facts, copy.found.shortest_m
    wanted_m, reason = (facts.wavelength_m, facts.reason) if asked_m is None else (asked_m, "as asked")
    if wanted_m >= least_m * (1 - 1e-9):
        return wanted_m, reason
    side = show_length(copy.found.side_m)
    return least_m, f"not {show_length(wanted_m)}, since a preview's cells of {side} need a longer wavelength"


def _check(request: Request) -> None:
    """Refuse what a preview does not do."""
    usual = Request()
    asked = [
        one.name.removesuffix("_m").removesuffix("_s").removesuffix("_bytes").replace("_", "-")
        for one in dataclasses.fields(request)
        if one.name not in _FREE and getattr(request, one.name) != getattr(usual, one.name)
    ]
    if asked:
        raise UsageError(
            "a preview is a quick picture of the confocal camera with the solver rsd, so that "
            f"{' and '.join(f'--{name}' for name in asked)} would have no effect; leave it out, or leave "
            "--preview out"
        )


def _copy_of(path: Path) -> tuple[Copy, float]:
    """Return the copy of a scan, kept or made now, and how long the scan was read; 0 where it was not."""
    began_s = time.monotonic()
    whole = path.is_file() and not has_journal(path)  # what a scan writes changes
    digest = digest_of_file(path) if whole else ""
    if whole and (held := _kept(digest)):
        return held, 0.0
    with ScanFile(path) as scan:
        seen = as_recorded(scan)
        capture = seen.capture.by_its_finer_aperture()
        chosen = defaults.wavelength(capture, seen.instrument_response_s, rendered=seen.rendered)
        facts = Facts(
            digest=digest or scan.digest,
            positions=capture.positions,
            wavelength_m=chosen.value,
            reason=chosen.reason,
            rendered=seen.rendered,
            fade_from_s=seen.fade_from_s,
            response_s=seen.instrument_response_s,
            doubts=scan.doubts,
            origin=origin(scan),
        )
        copy = Copy(coarse(capture), facts)
    if whole and not scan.altered.any():
        _keep(digest, copy)
    return copy, time.monotonic() - began_s


def _keep(digest: str, copy: Copy) -> None:
    found = copy.found
    capture = found.capture
    arrays = {
        "counts": found.counts,
        "first_bin_s": capture.first_bin_s,
        "laser_m": capture.laser_m,
        "detector_m": capture.detector_m,
        "numbers": np.array([capture.bin_width_s, found.side_m, found.shortest_m]),
    }
    kept.keep(f"preview-{digest}", arrays, dataclasses.asdict(copy.facts))


def _kept(digest: str) -> Copy | None:
    """Return a copy that was kept, if it is whole and this program's."""
    found = kept.kept(f"preview-{digest}")
    if found is None:
        return None
    arrays, said = found
    try:
        copy = Copy(_coarse_of(arrays), _FACTS.validate_python(said))
    except (KeyError, ValueError, TypeError, AttributeError):
        return None
    fits = copy.facts.form == FORM and copy.facts.digest == digest and _fits(copy.found)
    return copy if fits else None


def _coarse_of(arrays: dict[str, NDArray]) -> Coarse:
    bin_width_s, side_m, shortest_m = arrays["numbers"].tolist()
    capture = Capture(
        ArrayHistograms(arrays["counts"]),
        bin_width_s,
        arrays["first_bin_s"],
        arrays["laser_m"],
        arrays["detector_m"],
    )
    return Coarse(capture, side_m, shortest_m)


def _fits(found: Coarse) -> bool:
    """Return whether shapes fit together, and numbers are numbers."""
    capture = found.capture
    shape, positions = np.shape(found.counts), len(found.counts)
    return (
        len(shape) == 2
        and min(shape) > 0
        and found.counts.dtype.kind in "uf"
        and capture.laser_m.shape == (positions, 3)
        and capture.detector_m.shape in {(1, 3), (positions, 3)}
        and capture.first_bin_s.shape in {(1,), (positions,)}
        and all(np.isfinite(one).all() for one in (capture.laser_m, capture.detector_m, capture.first_bin_s))
        and min(capture.bin_width_s, found.side_m, found.shortest_m) > 0
    )
