"""From work to an image of one moment, and the surface in it."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from recon import by_lasers, defaults
from recon.camera import Camera, ConfocalCamera
from recon.exhaustive import Exhaustive
from recon.imaging import image
from recon.noise import Noise, photon_noise, quiet_level, tallied
from recon.registry import name_of
from recon.result import Image
from recon.spectrum import Spectra, spectra
from recon.surface import Surface, find
from recon.wave import VirtualPulse
from rig.files.scan import ScanFile
from rig.files.volume import Volume
from rig.image.request import Request
from rig.image.work import Work, chosen, voxels
from rig.model.quantities import show_length

#: A surface is imaged well where it is, in the median, this many times brighter than noise. If the wavelength
#: is the program's to choose, it is made longer by `LONGER` until that is so, `ATTEMPTS` times at most.
WELL, LONGER, ATTEMPTS = 20.0, 1.25, 6


def settled(scan: ScanFile, request: Request) -> tuple[Work, str]:
    """Choose what was not asked for, a longer wavelength where photons are too few; say why this one."""
    work, reason = chosen(scan, request)
    return still(work, reason, None)[:2]


def still(work: Work, reason: str, progress: Callable[[float], None] | None) -> tuple[Work, str, Volume]:
    """Image with the wavelength asked for, or else with a longer one where photons are too few."""
    best, (found, surface) = work, with_surface(work, progress)
    chosen_here = work.request.wavelength_m is None and not work.seen.exhaustive  # of which one takes minutes
    attempts = ATTEMPTS if chosen_here else 0
    for attempt in range(1, attempts + 1):
        if surface.contrast_seen() >= WELL:
            break
        pulse = VirtualPulse(work.pulse.wavelength_m * LONGER**attempt, work.pulse.cycles)
        longer = replace(work, pulse=pulse, grid=voxels(work.request, work.capture, pulse))
        image_longer, surface_longer = with_surface(longer, progress)
        if surface_longer.contrast_seen() > surface.contrast_seen():
            best, found, surface = longer, image_longer, surface_longer
            reason = f"there are too few photons for {show_length(work.pulse.wavelength_m)}"
    return best, reason, best.volume(found, surface)


def with_surface(work: Work, progress: Callable[[float], None] | None) -> tuple[Image, Surface]:
    """Image, and find the surface; its noise is that of the photons, where they were counted."""
    found, noise = _imager(work).image_and_noise(progress)
    return found, find(found, noise or quiet_level(found.intensity))


def focused(work: Work, camera: Camera, progress: Callable[[float], None] | None) -> Image:
    """Focus a camera that shows one moment."""
    return _imager(work).image(camera, progress)


def _imager(work: Work) -> "_ByPlanes | _ByRuns":
    """Choose what images work, by the form of its capture."""
    if work.seen.exhaustive and not work.seen.relit:
        return _ByRuns(work, work.seen.exhaustive)
    return _ByPlanes(work)


@dataclass(frozen=True)
class _ByPlanes:
    """Images a capture plane by plane, from the spectra of all positions."""

    work: Work

    def image(self, camera: Camera, progress: Callable[[float], None] | None) -> Image:
        """Focus a camera."""
        work, by = self.work, self.work.by
        return image(
            work.capture,
            work.pulse,
            work.grid,
            solver=work.request.solver,
            camera=camera,
            window=work.window,
            progress=progress,
            memory_bytes=None if by else memory_bytes_of(work),
            device=work.request.device,
            taking=spectra_of(work),
            by=by.planes if by else None,
        )

    def image_and_noise(self, progress: Callable[[float], None] | None) -> tuple[Image, Noise | None]:
        """Focus the confocal camera; return the noise of photons, too, if they were counted."""
        work = self.work
        if work.seen.relit:
            return self.image(ConfocalCamera(), progress), None
        capture, tally = tallied(work.capture, work.pulse, work.window)
        reading = replace(work, seen=replace(work.seen, capture=capture))
        found = _ByPlanes(reading).image(ConfocalCamera(), progress)
        return found, photon_noise(tally, work.pulse, work.grid) if tally.whole else None


@dataclass(frozen=True)
class _ByRuns:
    """Images an exhaustive capture by runs of lasers."""

    work: Work
    capture: Exhaustive

    def image(self, camera: Camera, progress: Callable[[float], None] | None) -> Image:
        """Focus a camera."""
        work, by = self.work, self.work.by
        return by_lasers.image(
            self.capture,
            work.pulse,
            work.grid,
            camera=camera,
            window=work.window,
            progress=progress,
            memory_bytes=work.request.memory_bytes,
            by=by.runs if by else None,
        )

    def image_and_noise(self, progress: Callable[[float], None] | None) -> tuple[Image, Noise | None]:
        """Focus the confocal camera; return the noise of photons, too, if they were counted."""
        work, by = self.work, self.work.by
        if work.seen.rendered:
            return self.image(ConfocalCamera(), progress), None
        return by_lasers.image_and_noise(
            self.capture,
            work.pulse,
            work.grid,
            window=work.window,
            progress=progress,
            memory_bytes=work.request.memory_bytes,
            by=by.runs if by else None,
        )


def spectra_of(work: Work) -> Spectra:
    """Return what takes the spectra; of a bound on memory, those of lasers have a quarter."""
    relit_point, bound = work.seen.relit, work.request.memory_bytes
    if relit_point is None:
        return spectra
    if bound is not None:
        relit_point = replace(relit_point, run_bytes=min(relit_point.run_bytes, bound // 4))
    return relit_point.spectra


def memory_bytes_of(work: Work) -> int | None:
    """Return the bound on the memory of imaging itself."""
    bound = work.request.memory_bytes
    return bound if bound is None or work.seen.relit is None else bound - bound // 4


def classic(work: Work, progress: Callable[[float], None] | None) -> tuple[Volume, tuple[str, ...]]:
    """Image with one of the methods that come before virtual waves; return what to say about it, too."""
    from recon.solvers.classic.solve import baseline_image

    request = work.request
    found = baseline_image(
        work.capture,
        work.grid,
        solver=name_of(request.solver),
        window=work.window,
        snr=request.snr,
        progress=progress,
    )
    snr = {} if found.snr is None else {"snr": found.snr}
    doubts = (*defaults.on_one_line(work.capture), *defaults.dark_parts(work.capture, work.grid))
    return work.volume(found, find(found, quiet_level(found.intensity)), **snr), (*found.notes, *doubts)
