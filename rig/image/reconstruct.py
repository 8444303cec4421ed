"""From a scan file to a volume file and pictures."""

import dataclasses
import time
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from threading import Thread
from typing import Protocol

from recon.camera import PhotoCamera, TransientCamera
from recon.registry import entry_of
from rig.errors import UsageError
from rig.files.scan import ScanFile
from rig.files.volume import Volume, require_replaceable, write_volume
from rig.image.drawing import Drawing
from rig.image.film import film_of_light
from rig.image.focus import classic, focused, still
from rig.image.forecast import Workers, forecast_of, require_possible
from rig.image.request import Request, check, check_elsewhere, check_page
from rig.image.result import Result
from rig.image.work import Fields, Work, camera_of, chosen, warnings_of
from rig.show.endings import check_picture

#: What is needed when the field is there, and takes long to import: in the order of its use.
_AFTERWARDS = ("scipy.ndimage", "scipy.sparse.csgraph")
_DRAWS = ("rig.image.picture",)


class Elsewhere(Protocol):
    """Other processes that compute fields."""

    @property
    def workers(self) -> Workers:
        """How many there are, and what each may take."""
        ...

    def imaging(self, scan: ScanFile, *, changed: bool) -> Fields:
        """Return what computes the fields of a scan.

        Parameters
        ----------
        scan
            What is imaged.
        changed
            Whether its counts are changed here, so that those of the file will not do.
        """
        ...


def reconstruct(
    scan_path: Path,
    request: Request,
    volume_path: Path,
    drawing: Drawing,
    progress: Callable[[float], None] | None = None,
    video_path: Path | None = None,
    page_path: Path | None = None,
    elsewhere: Elsewhere | None = None,
) -> Result:
    """Image a scan with a virtual camera; write the volume file, the picture and, if asked, video and page.

    Fields are computed by this process, or ``elsewhere``.

    Raises
    ------
    rig.errors.UsageError
        If a video or a page cannot be written as asked, or the volume's name is that of something else.
    rig.errors.DataFileError
        If the scan cannot be read.
    recon.errors.ReconError
        If it cannot be imaged as asked.
    """
    began_s = time.monotonic()
    check(request, video_path)
    check_picture(drawing.path)
    check_page(request, page_path)
    require_replaceable(volume_path)
    with ScanFile(scan_path) as scan:
        work, reason = _possible(scan, request, volume_path, elsewhere)
        result = _computed(scan, work, reason, volume_path, _ready_soon(progress, drawing), began_s)
    drawing.begin(result.volume)
    if not (request.each_frame or request.all_depths):  # which were written meanwhile
        write_volume(volume_path, result.volume)
    drawing.save(result.volume)
    if page_path:
        from rig.exporters import page

        page.save(result.volume, page_path)
    if video_path:
        from rig.image.picture import save_film

        save_film(result.volume, request, video_path)
    return dataclasses.replace(result, took_s=time.monotonic() - began_s)


def _ready_soon(progress: Callable[[float], None] | None, drawing: Drawing) -> Callable[[float], None]:
    """Return what tells progress, and imports beside the second half of the work what follows it.

    That takes half a second, in which no other Python code runs: compiled loops are not held up by it, the
    reading of the record would be.
    """
    names = _AFTERWARDS if drawing.beside else _AFTERWARDS + _DRAWS
    waiting = [Thread(target=_get_ready, args=(names,))]

    def told(done: float) -> None:
        if done >= 0.5:
            with suppress(IndexError):  # it was started, perhaps from another thread
                waiting.pop().start()
        if progress:
            progress(done)

    return told


def _get_ready(names: tuple[str, ...]) -> None:
    """Import modules; what is wrong with one is said where it is needed."""
    with suppress(Exception):
        for name in names:
            import_module(name)


def imaged(
    scan: ScanFile,
    request: Request,
    progress: Callable[[float], None] | None = None,
    volume_path: Path | None = None,
    elsewhere: Elsewhere | None = None,
) -> Result:
    """Image an open scan with a virtual camera, by this process or ``elsewhere``.

    Nothing is written, but for ``all_depths`` and ``each_frame``: what these make need not fit in memory, and
    goes to the volume file at once.

    Raises
    ------
    As `reconstruct`.
    """
    began_s = time.monotonic()
    work, reason = _possible(scan, request, volume_path, elsewhere)
    return _computed(scan, work, reason, volume_path, progress, began_s)


def _possible(
    scan: ScanFile, request: Request, volume_path: Path | None, elsewhere: Elsewhere | None
) -> tuple[Work, str]:
    """Choose what was not asked for, and refuse what cannot be; say why this wavelength."""
    check(request)
    if volume_path is None and (request.all_depths or request.each_frame):
        raise UsageError(
            "films of all depths, and of each frame, are written to a file while they are made: use "
            "rig recon with --all-depths or --each-frame, and open its volume"
        )
    if request.each_frame:
        from rig.image.frames import check_frames  # compiled, which starting need not wait for

        check_frames(scan)
    work, reason = chosen(scan, request, by_runs=True)
    _require_possible(work, elsewhere)
    return _sent(work, scan, elsewhere), reason


def _computed(
    scan: ScanFile,
    work: Work,
    reason: str,
    volume_path: Path | None,
    progress: Callable[[float], None] | None,
    began_s: float,
) -> Result:
    """Make the volume, and say what may spoil it, and how long it took since it began."""
    reason, volume, warnings = _made(scan, work, reason, volume_path, progress)
    warnings = (*scan.doubts, *_signal(volume), *warnings)
    return Result(volume, reason, warnings, work.seen.positions, time.monotonic() - began_s)


def _made(
    scan: ScanFile,
    work: Work,
    reason: str,
    volume_path: Path | None,
    progress: Callable[[float], None] | None,
) -> tuple[str, Volume, tuple[str, ...]]:
    """Make the volume; return why its wavelength is that, and what may spoil it, too."""
    if not entry_of(work.request.solver).virtual_wave:
        return "", *classic(work, progress)
    camera = camera_of(work)
    if work.request.each_frame and volume_path:
        from rig.image.frames import frame_by_frame

        volume = frame_by_frame(scan, work, volume_path, progress)
    elif isinstance(camera, TransientCamera):
        volume = film_of_light(work, camera, volume_path, progress)
    elif isinstance(camera, PhotoCamera):  # without a surface: the pulse alone makes depth
        volume = work.volume(focused(work, camera, progress))
    else:
        work, reason, volume = still(work, reason, progress)
    return reason, volume, warnings_of(work, camera)


def _require_possible(work: Work, elsewhere: Elsewhere | None) -> None:
    request = work.request
    by_runs = work.seen.exhaustive or work.seen.relit  # whose capture is an outline
    if request.each_frame or by_runs or not entry_of(request.solver).virtual_wave:
        return
    found = forecast_of(work, elsewhere.workers if elsewhere else None)
    require_possible(found, bounded=request.memory_bytes is not None, however_long=request.however_long)


def _sent(work: Work, scan: ScanFile, elsewhere: Elsewhere | None) -> Work:
    """Let other processes compute, if there are any."""
    if elsewhere is None:
        return work
    check_elsewhere(work.request)
    return dataclasses.replace(work, by=elsewhere.imaging(scan, changed=work.request.even_bins))


def _signal(volume: Volume) -> tuple[str, ...]:
    """Say if nothing was seen."""
    if volume.parameters.get("signal", True):
        return ()
    return (
        "no signal above noise: photons without any hidden object would give an image like this; "
        "measure longer, or check that the laser reaches the wall and the record holds the scene",
    )
