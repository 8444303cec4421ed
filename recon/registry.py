"""All solvers and cameras, an entry each: what there is, what goes together, and what is said about it.

What computes is named by its place and imported when it is used, so that a command line can offer the choice
without loading any library. A new solver is its file and an entry here.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

from recon.errors import ParameterError


@dataclass(frozen=True)
class CameraEntry:
    """A virtual camera.

    Attributes
    ----------
    help
        What it shows, in a line.
    film
        Whether it shows many moments.
    """

    help: str
    film: bool = False


@dataclass(frozen=True)
class SolverEntry:
    """A way to compute an image.

    Attributes
    ----------
    place
        ``module:function``. One that forms a virtual wave is a `recon.solvers.problem.Solver`; another takes
        capture, voxels and window (with a `ConfocalLattice` behind the capture, if it needs a confocal grid),
        and gives the (z, y, x) amplitude.
    help
        What it is good for, in a line.
    method, positions
        For the documentation: how it computes, and where positions may be.
    virtual_wave
        Whether it forms a virtual wave, and so serves cameras; the others are earlier methods.
    refuses
        Cameras that it cannot serve, and why.
    options
        What it takes beside what all take: ``snr``, ``device``.
    needs
        ``module:function`` of its memory, (problem, part of the depth) to `Need`; None if it keeps to no
        bound.
    way
        ``module:function`` of how it images a depth block, (problem, part of the depth) to `Way`; None if its
        images are not cut into parts.
    warnings
        ``module:function`` of what may spoil its image, (capture, wavelength, voxels) to sentences.
    confocal_grid
        Whether it computes on a regular confocal grid.
    falloff_power
        Power of 1/depth left in the intensity, which pictures undo.
    """

    place: str
    help: str
    method: str
    positions: str
    virtual_wave: bool = True
    refuses: Mapping[str, str] = field(default_factory=dict)
    options: frozenset[str] = frozenset()
    needs: str | None = None
    way: str | None = None
    warnings: str | None = None
    confocal_grid: bool = False
    falloff_power: float = 4.0


def load(place: str) -> Any:
    """Import what a place, ``module:function``, names."""
    module, name = place.split(":")
    return getattr(import_module(module), name)


#: All cameras, by name.
CAMERAS: dict[str, CameraEntry] = {
    "confocal": CameraEntry("the 3-D image"),
    "photo": CameraEntry("one wavelength, refocused plane by plane"),
    "transient": CameraEntry("a video of a flash", film=True),
}

_NO_WAVE = dict.fromkeys(("photo", "transient"), "it forms no virtual wave")

#: All solvers, by name.
SOLVERS: dict[str, SolverEntry] = {
    "rsd": SolverEntry(
        "recon.solvers.rsd.dispatch:focus",
        "quick, exact, any geometry",
        "exact convolution by FFT, or the quickest other way to it ([geometry](geometry.md))",
        "any",
        options=frozenset({"device"}),
        needs="recon.solvers.rsd.dispatch:needs",
        way="recon.solvers.rsd.dispatch:way",
    ),
    "fresnel": SolverEntry(
        "recon.solvers.fresnel:focus",
        "paraxial, for far scenes",
        "by FFT, paraxial wave",
        "even grid on z = 0; one detector spot, or confocal data",
        needs="recon.solvers.fresnel:needs",
        way="recon.solvers.fresnel:way",
        warnings="recon.solvers.fresnel:warnings",
    ),
    "direct": SolverEntry(
        "recon.solvers.direct:focus",
        "the defining sum, very slow",
        "the sum itself, double precision",
        "any",
    ),
    "backprojection": SolverEntry(
        "recon.solvers.time_domain:focus",
        "in the time domain, slow",
        "in time",
        "any",
        refuses={"photo": "one frequency is an infinitely long pulse"},
    ),
    "bp": SolverEntry(
        "recon.solvers.classic.ellipsoids:backproject",
        "any geometry",
        "back-projection, unfiltered",
        "any",
        virtual_wave=False,
        refuses=_NO_WAVE,
    ),
    "laplacian-fbp": SolverEntry(
        "recon.solvers.classic.ellipsoids:laplacian_filtered",
        "any geometry",
        "back-projection, then -∂²/∂z²",
        "any",
        virtual_wave=False,
        refuses=_NO_WAVE,
    ),
    "log-fbp": SolverEntry(
        "recon.solvers.classic.ellipsoids:log_filtered",
        "any geometry",
        "back-projection, then minus the Laplacian of a Gaussian",
        "any",
        virtual_wave=False,
        refuses=_NO_WAVE,
    ),
    "lct": SolverEntry(
        "recon.solvers.classic.lct:reconstruct",
        "confocal grids",
        "light-cone transform",
        "confocal grid; one detector spot as an approximation",
        virtual_wave=False,
        refuses=_NO_WAVE,
        options=frozenset({"snr"}),
        confocal_grid=True,
        falloff_power=0.0,
    ),
    "fk": SolverEntry(
        "recon.solvers.classic.fk:reconstruct",
        "confocal grids",
        "f-k migration",
        "confocal grid; one detector spot as an approximation",
        virtual_wave=False,
        refuses=_NO_WAVE,
        confocal_grid=True,
        falloff_power=0.0,
    ),
}

#: Those that form a virtual wave, and the earlier methods.
WAVE_SOLVERS = tuple(name for name, entry in SOLVERS.items() if entry.virtual_wave)
CLASSIC_SOLVERS = tuple(name for name, entry in SOLVERS.items() if not entry.virtual_wave)
#: Those that can keep to a bound on memory.
BOUNDED = tuple(name for name, entry in SOLVERS.items() if entry.needs)


def name_of(solver: str | Callable[..., Any]) -> str:
    """Return what a solver is called, one of the program's or a function of a person's own."""
    return getattr(solver, "__name__", type(solver).__name__) if callable(solver) else solver


def entry_of(solver: str | Callable[..., Any]) -> SolverEntry:
    """Return the entry of a solver; a function of a person's own forms a virtual wave, and takes no options.

    Raises
    ------
    recon.errors.ParameterError
        If there is none of this name.
    """
    if callable(solver):
        return SolverEntry("", "your own", "your own function", "any")
    if solver not in SOLVERS:
        raise ParameterError(
            "solver", repr(solver), "there is no such solver", f"Choose among {', '.join(SOLVERS)}."
        )
    return SOLVERS[solver]


def taking(option: str) -> tuple[str, ...]:
    """Return the solvers that take an option."""
    return tuple(name for name, entry in SOLVERS.items() if option in entry.options)


def cameras_help() -> str:
    """Return a line for each camera, for the command line."""
    return " ".join(f"{name}: {entry.help}." for name, entry in CAMERAS.items())


def solvers_help() -> str:
    """Return a line for each solver, for the command line."""
    waves = " ".join(f"{name}: {SOLVERS[name].help}." for name in WAVE_SOLVERS)
    classic = ", ".join(f"{name} ({SOLVERS[name].help})" for name in CLASSIC_SOLVERS)
    return f"{waves} The others are earlier methods, to compare with: {classic}."


def wave_table() -> str:
    """Return the solvers that serve cameras as a table in Markdown."""
    rows = [["solver", "how", "positions", *CAMERAS], ["---"] * (3 + len(CAMERAS))]
    for name in WAVE_SOLVERS:
        entry = SOLVERS[name]
        served = [f"no: {entry.refuses[one]}" if one in entry.refuses else "yes" for one in CAMERAS]
        rows.append([f"`{name}`", entry.method, entry.positions, *served])
    return _markdown(rows)


def classic_table() -> str:
    """Return the earlier methods as a table in Markdown."""
    rows = [["name", "method", "geometry", "depth left to undo"], ["---"] * 4]
    for name in CLASSIC_SOLVERS:
        entry = SOLVERS[name]
        left = "amplitude z², intensity z⁴" if entry.falloff_power else "none"
        rows.append([f"`{name}`", entry.method, entry.positions, left])
    return _markdown(rows)


def _markdown(rows: list[list[str]]) -> str:
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)
