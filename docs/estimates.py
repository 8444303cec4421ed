"""Make the tables of estimates.md: estimates beside the truth, on simulated scenes and on measurements.

Run from the repository's root: ``python docs/estimates.py``, or with a folder of scan files whose values are
right. Each value is taken away, and estimated again: 20 minutes on two cores, or one for each file.
"""

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from recon.capture import ArrayHistograms, Capture
from recon.estimate import Estimate, EstimateError, bin_width, from_first_bounce, profile, time_origin
from rig.files import ScanFile
from simulators.scenes import Mesh, Scene, letter, quads_mesh
from simulators.scenes.solids import box, cylinder, rotated
from simulators.transport.renderer import Transport

#: A wall of 48 x 48 positions and 1.2 m; bins of 16 ps, a response of 70 ps; photons, and background a bin.
COLUMNS, WALL_M, BIN_S, BINS, RESPONSE_S = 48, 1.2, 16e-12, 1000, 70e-12
PHOTONS, BACKGROUND = 2e6, 0.02
SEEDS = range(20)
#: How wrong each value is made before it is estimated: all times late, bins too wide. A wall too small is the
#: same as bins too wide, so that it has no column of its own.
LATE_S, WIDER = 3e-9, 1.7

#: Truth, estimate, and why there is none.
Answer = tuple[float, Estimate | None, str]
#: Reads a capture, and when its first bounce ends.
Load = Callable[[], tuple[Capture, float | None]]


def scene(seed: int) -> Scene:
    """Hide one to three things half a metre to a metre away: letters, letters and boxes, or round bodies."""
    random = np.random.default_rng(seed)
    kind = ("letters", "letters", "boxes", "bodies")[random.integers(4)]
    meshes = []
    for number in range(random.integers(1, 4)):
        depth_m, (x_m, y_m) = random.uniform(0.45, 1.1), random.uniform(-0.35, 0.35, 2)
        at_m = (x_m, y_m, depth_m)
        if kind == "letters" or (kind == "boxes" and number == 0):
            meshes.append(_letter(random, at_m))
        elif kind == "boxes":
            half_m = random.uniform(0.06, 0.2)
            size_m = np.array([half_m, half_m, half_m / 2])
            corners = tuple(at_m - size_m), tuple(at_m + size_m)
            meshes.append(quads_mesh("box", box(*corners, turn_deg=random.uniform(-45, 45))))
        else:
            radius_m = random.uniform(0.04, 0.12)
            round_m = _ball(at_m, radius_m) if random.random() < 0.5 else cylinder(at_m, radius_m, 0.4)
            meshes.append(quads_mesh("body", round_m))
    return Scene(kind, tuple(meshes))


def _letter(random: np.random.Generator, at_m: tuple[float, float, float]) -> Mesh:
    """Return a letter of random size, turned about its upright axis."""
    height_m = random.uniform(0.25, 0.55)
    size = {"height_m": height_m, "width_m": 0.75 * height_m, "stroke_m": 0.16 * height_m}
    mesh = letter("DEFHLNRSTUX"[random.integers(11)], centre_m=at_m, **size)
    turned_m = rotated(mesh.vertices_m[:, None], random.uniform(-35, 35), at_m)
    return replace(mesh, vertices_m=turned_m[:, 0])


def _ball(at_m: tuple[float, float, float], radius_m: float, sides: int = 12) -> NDArray[np.float64]:
    """Return the (Q, 4, 3) faces of a ball, open at its poles."""
    polar, around = np.linspace(0.15, np.pi - 0.15, sides // 2 + 1), np.linspace(0, 2 * np.pi, sides + 1)
    ring = np.sin(polar)[:, None]
    axes = ring * np.cos(around), np.cos(polar)[:, None] * np.ones_like(around), ring * np.sin(around)
    points_m = np.stack(axes, axis=-1) * radius_m + at_m
    quads = (points_m[:-1, :-1], points_m[:-1, 1:], points_m[1:, 1:], points_m[1:, :-1])
    return np.stack(quads, axis=2).reshape(-1, 4, 3)


def simulated(seed: int, confocal: bool) -> tuple[Capture, float | None]:
    """Scan a random scene; there is no first bounce to fade out."""
    x_m, y_m = np.meshgrid(*[np.linspace(-WALL_M / 2, WALL_M / 2, COLUMNS)] * 2)
    laser_m = np.column_stack([x_m.ravel(), y_m.ravel(), np.zeros(x_m.size)])
    detector_m = laser_m if confocal else np.array([[0.02, 0.01, 0.0]])
    edges_s: NDArray[np.float64] = BIN_S * np.arange(BINS + 1.0)
    signal = Transport.of_scene(scene(seed)).transients(laser_m, detector_m, edges_s)
    signal = gaussian_filter1d(signal, RESPONSE_S / 2.355 / BIN_S, axis=1)
    mean = signal * PHOTONS / signal.sum() + BACKGROUND
    counts = np.random.default_rng(1000 + seed).poisson(mean).astype(np.uint16)
    return Capture(ArrayHistograms(counts), BIN_S, np.zeros(1), laser_m, detector_m), None


def answers(capture: Capture, fade_from_s: float | None = None) -> list[Answer]:
    """Take each value away and estimate it: truth, estimate, and why there is none."""
    late = replace(capture, first_bin_s=capture.first_bin_s + LATE_S)
    wide_s, wide_first_s = capture.bin_width_s * WIDER, capture.first_bin_s * WIDER
    wide = replace(capture, bin_width_s=wide_s, first_bin_s=wide_first_s)
    fade_s = fade_from_s or 0.0
    return [
        _answer(time_origin, late, fade_s + LATE_S, LATE_S),
        _answer(bin_width, wide, fade_s * WIDER, capture.bin_width_s),
    ]


def _answer(
    estimate: Callable[[Capture, float | None], Estimate], capture: Capture, fade_s: float, truth: float
) -> Answer:
    try:
        return truth, estimate(capture, fade_s), ""
    except EstimateError as error:
        return truth, None, error.found


def row(name: str, found: list[Answer]) -> str:
    """Return a row: time zero's error [ns], and the bin width over the truth, with intervals."""
    cells = []
    for truth, estimate, _ in found:
        if estimate is None:
            cells.append("refused")
            continue
        values = np.array([estimate.value, estimate.low, estimate.high])
        value, low, high = (values - truth) * 1e9 if estimate.quantity == "time-origin" else values / truth
        missed = "" if estimate.low <= truth <= estimate.high else " **missed**"
        if estimate.quantity == "time-origin":
            cells.append(f"{value:+.2f} ({low:+.2f} to {high:+.2f}){missed}")
        else:
            cells.append(f"{value:.3f} ({low:.2f} to {high:.2f}){missed}")
    return f"| {name} | " + " | ".join(cells) + " |"


def rate(found: list[list[Answer]], place: int) -> str:
    """Say how often the interval held the truth, for the quantity at this place."""
    made = [(truth, estimate) for truth, estimate, _ in (row[place] for row in found) if estimate]
    held = sum(estimate.low <= truth <= estimate.high for truth, estimate in made)
    return f"{held} of {len(made)} intervals hold the truth; {len(found) - len(made)} refused"


def table(captures: list[tuple[str, Load]]) -> None:
    """Print the rows of one table as they are made, and how often they are right."""
    print("| scene | time zero, error (ns) | bin width / truth |\n| --- | --- | --- |")
    found = []
    for name, load in captures:
        found.append(answers(*load()))
        print(row(name, found[-1]), flush=True)
    for place, quantity in enumerate(("time zero", "bin width")):
        print(f"\n{quantity}: {rate(found, place)}")


def measured(path: Path, bounce: bool) -> tuple[Capture, float | None]:
    """Read a scan file whole; without its first bounce, what is before its fade is dark."""
    with ScanFile(path) as scan:
        capture, fade_s = scan.capture(), scan.fade_from_s
        counts = np.concatenate([block for _, block in capture.histograms.blocks()])
    if not bounce and fade_s is not None:
        counts[:, : round((fade_s - capture.first_bin_s[0]) / capture.bin_width_s)] = 0
    return replace(capture, histograms=ArrayHistograms(counts)), fade_s


def of_folder(folder: Path) -> list[tuple[str, Load]]:
    """Name all scan files, those with a first bounce twice."""
    captures: list[tuple[str, Load]] = []
    for path in sorted(folder.glob("*.h5")):
        capture, fade_s = measured(path, True)
        captures.append((path.stem, partial(measured, path, True)))
        if fade_s is not None and from_first_bounce(profile(capture)):
            captures.append((f"{path.stem}, no first bounce", partial(measured, path, False)))
    return captures


def of_seeds() -> list[tuple[str, Load]]:
    """Name all simulated scans."""
    return [
        (f"{scene(seed).name} {seed}, {geometry}", partial(simulated, seed, geometry == "confocal"))
        for seed in SEEDS
        for geometry in ("confocal", "one spot")
    ]


if __name__ == "__main__":
    table(of_folder(Path(sys.argv[1])) if len(sys.argv) > 1 else of_seeds())
