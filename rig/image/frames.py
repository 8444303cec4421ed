"""A scan of several frames, imaged frame by frame."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.camera import ConfocalCamera
from recon.capture import Histograms
from recon.depth import compensate_falloff, front_view
from recon.frames import FrameImager
from recon.result import Image
from recon.solvers.problem import ignore
from rig.errors import UsageError
from rig.files.scan import ScanFile
from rig.files.volume import Volume, volume_by_planes
from rig.image.work import Work
from rig.model.sweep import planned_duration_s


def _times_s(scan: ScanFile) -> NDArray[np.float64]:
    """Return when each whole frame began, as the plan has it, (T,)."""
    assert scan.plan is not None
    duration_s = (
        scan.plan.exposure_total_s if scan.state is None else planned_duration_s(scan.plan, scan.state)
    )
    return scan.whole_frames.astype(np.float64) * (duration_s / scan.frames)


def check_frames(scan: ScanFile) -> None:
    """Refuse a scan of fewer than two whole frames.

    Raises
    ------
    UsageError
        If so.
    """
    whole = len(scan.whole_frames) if scan.frames > 1 else 1
    if whole < 2:
        raise UsageError(
            f"{scan.path} holds {'one whole frame' if whole else 'no whole frame'}, "
            "so a film is not possible; scan with --frames, or leave --each-frame out"
        )


def frame_by_frame(
    scan: ScanFile, work: Work, volume_path: Path, progress: Callable[[float], None] | None
) -> Volume:
    """Image frame by frame into the volume file; return what pictures show of it, front views."""
    grid, times_s = work.grid, _times_s(scan)
    dark = np.zeros((len(times_s), *grid.shape[1:]), np.float32)
    camera = ConfocalCamera()
    begun = Image(grid, None, "rsd", work.window, camera, work.pulse, times_s=times_s, frames=dark)
    fresh_to_m = work.request.fresh_to_m
    volume = work.volume(begun, each_frame=True, fresh_to_m=fresh_to_m)
    imager = FrameImager(work.capture, work.pulse, grid, work.window, fresh_to_m=fresh_to_m)
    frames = scan.histograms_of_frames()
    fronts = _film_frames(frames, imager, volume, volume_path, progress or ignore)
    return dataclasses.replace(volume, intensity=fronts)


def _film_frames(
    frames: list[Histograms],
    imager: FrameImager,
    begun: Volume,
    path: Path,
    progress: Callable[[float], None],
) -> NDArray[np.float32]:
    """Image frame by frame into a volume file; return the front views, their fall-off undone, (T, y, x).

    Parameters
    ----------
    frames
        Counts of each frame.
    imager
        What images them.
    begun
        The volume file's value, with darkness for front views.
    path
        The volume file, which appears when all frames are in it.
    progress
        Called with the fraction that is done.
    """
    fronts = np.empty_like(begun.intensity)
    with volume_by_planes(path, begun) as put:
        for number, frame in enumerate(frames):
            found = imager.image(frame)
            put(number, found.intensity)
            lifted = compensate_falloff(found.intensity, begun.z_m, found.falloff_power)
            fronts[number] = front_view(lifted)
            progress((number + 1) / len(frames))
    return fronts
