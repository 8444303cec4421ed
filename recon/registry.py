"""The solvers and cameras that there are: of these entries command line, help, refusals and pages are made.

Nothing heavy is imported here; what computes is named, and imported when it is used.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any


@dataclass(frozen=True)
class CameraInfo:
    """A virtual camera.

    Attributes
    ----------
    name
        On the command line and in files.
    about
        What it shows, in a few words.
    device
        Whether a graphics processor can compute it.
    """

    name: str
    about: str
    device: bool = True


@dataclass(frozen=True)
class SolverInfo:
    """A way to compute an image.

    Attributes
    ----------
    name
        On the command line and in files.
    about
        What it is, in a few words.
    function
        ``module:name`` of what computes. Of a wave solver, a `recon.solvers.problem.Solver`; of an earlier
        method, a `recon.solvers.classic.solve.Method`.
    wave
        Whether it forms a virtual wave; earlier methods give an amplitude alone.
    cameras
        Those it can serve.
    needs
        ``module:name`` of what says how much memory a slab takes, a `recon.solvers.problem.Needs`; empty
        where a bound on memory cannot be kept.
    options
        What it alone takes: ``device``, ``snr``.
    falloff_power
        Power of 1/depth left in the intensity, which pictures undo for the eye.
    """

    name: str
    about: str
    function: str
    wave: bool = True
    cameras: tuple[str, ...] = ("confocal", "photo", "transient")
    needs: str = ""
    options: tuple[str, ...] = ()
    falloff_power: float = 4.0

    def load(self) -> Callable[..., Any]:
        """Import and return what computes."""
        return _imported(self.function)

    def load_needs(self) -> Callable[..., Any]:
        """Import and return what says how much memory is needed."""
        return _imported(self.needs)

    def takes(self, option: str) -> bool:
        """Return whether an option, ``memory`` among them, means something to it."""
        return option in self.options or (option == "memory" and bool(self.needs))


def _imported(place: str) -> Callable[..., Any]:
    module, _, name = place.partition(":")
    found: Callable[..., Any] = getattr(import_module(module), name)
    return found


CAMERAS: dict[str, CameraInfo] = {
    one.name: one
    for one in (
        CameraInfo("confocal", "the 3-D image"),
        CameraInfo("photo", "one wavelength, refocused plane by plane"),
        CameraInfo("transient", "a video of a flash", device=False),
    )
}

_RSD, _CLASSIC = "recon.solvers.rsd", "recon.solvers.classic"

SOLVERS: dict[str, SolverInfo] = {
    one.name: one
    for one in (
        SolverInfo(
            "rsd",
            "quick, exact, any geometry",
            f"{_RSD}.dispatch:focus",
            needs=f"{_RSD}.needs:any_geometry",
            options=("device",),
        ),
        SolverInfo(
            "fresnel",
            "paraxial, for far scenes",
            "recon.solvers.fresnel:focus",
            needs=f"{_RSD}.needs:regular_grid",
        ),
        SolverInfo("direct", "the defining sum, very slow", "recon.solvers.direct:focus"),
        SolverInfo(
            "backprojection",
            "in the time domain, slow",
            "recon.solvers.time_domain:focus",
            cameras=("confocal", "transient"),
        ),
        SolverInfo(
            "bp",
            "summed counts, an earlier method for any geometry",
            f"{_CLASSIC}.ellipsoids:backproject",
            wave=False,
            cameras=("confocal",),
        ),
        SolverInfo(
            "laplacian-fbp",
            "bp sharpened by the Laplacian, for any geometry",
            f"{_CLASSIC}.ellipsoids:laplacian_filtered",
            wave=False,
            cameras=("confocal",),
        ),
        SolverInfo(
            "log-fbp",
            "bp sharpened by the Laplacian of a Gaussian, for any geometry",
            f"{_CLASSIC}.ellipsoids:log_filtered",
            wave=False,
            cameras=("confocal",),
        ),
        SolverInfo(
            "lct",
            "light-cone transform, for confocal grids",
            f"{_CLASSIC}.lct:light_cone_transform",
            wave=False,
            cameras=("confocal",),
            options=("snr",),
            falloff_power=0.0,
        ),
        SolverInfo(
            "fk",
            "f-k migration, for confocal grids",
            f"{_CLASSIC}.fk:migration",
            wave=False,
            cameras=("confocal",),
            falloff_power=0.0,
        ),
    )
}


def solvers_with(option: str) -> list[str]:
    """Return the names of the solvers that take an option."""
    return [name for name, info in SOLVERS.items() if info.takes(option)]


def as_markdown() -> str:
    """Return the table of solvers and cameras as the documentation shows it."""
    rows = [
        "| solver | what | " + " | ".join(CAMERAS) + " | takes |",
        "| --- | --- |" + " --- |" * (len(CAMERAS) + 1),
    ]
    for info in SOLVERS.values():
        served = ["yes" if name in info.cameras else "no" for name in CAMERAS]
        options = ", ".join(f"`--{name}`" for name in ("memory", "device", "snr") if info.takes(name))
        rows.append(f"| `{info.name}` | {info.about} | {' | '.join(served)} | {options} |")
    return "\n".join(rows)
