"""The film of light on its way through the hidden scene."""

import dataclasses
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from recon.camera import TransientCamera
from recon.filming import Sink, video
from recon.registry import name_of
from recon.result import Image
from rig.files.volume import Volume, volume_by_planes
from rig.image.focus import memory_bytes_of, spectra_of, with_surface
from rig.image.work import Work


def film_of_light(
    work: Work, camera: TransientCamera, volume_path: Path | None, progress: Callable[[float], None] | None
) -> Volume:
    """Make the video; its planes go to the volume file at once, if all depths are to be kept."""
    request, grid, over = work.request, work.grid, work.request.over or "surface"
    surface = with_surface(_lit_by_all(work), None)[1] if over == "surface" else None
    depth_m = surface.depth_m if surface else None
    dark = np.zeros((len(camera.times_s), *grid.shape[1:]), np.float32)
    begun = Image(
        grid,
        None,
        name_of(request.solver),
        work.window,
        camera,
        work.pulse,
        times_s=camera.times_s,
        frames=dark,
    )
    kept = volume_path if request.all_depths else None
    with _sink(kept, work.volume(begun, surface, over_depth=over)) as sink:
        found = video(
            work.capture,
            work.pulse,
            grid,
            camera,
            solver=request.solver,
            over=over,
            surface_m=depth_m,
            sink=sink,
            window=work.window,
            progress=progress,
            memory_bytes=memory_bytes_of(work),
            device=request.device,
            taking=spectra_of(work),
        )
    return work.volume(found, surface, over_depth=over)


def _lit_by_all(work: Work) -> Work:
    """Return the same work without relighting: what shows the scene's surface."""
    if not (work.seen.relit and work.seen.exhaustive):
        return work
    seen = dataclasses.replace(work.seen, capture=work.seen.exhaustive.outline(), relit=None)
    return dataclasses.replace(work, seen=seen)


@contextmanager
def _sink(path: Path | None, volume: Volume) -> Iterator[Sink | None]:
    """Open the volume file for planes, if all depths are to be kept."""
    if path is None:
        yield None
        return
    with volume_by_planes(path, volume) as put:
        yield lambda plane, frames: put(np.s_[:, plane], frames)
