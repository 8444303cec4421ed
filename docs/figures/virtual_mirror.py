"""Image by a hidden diffuse surface as by a mirror: the numbers and the picture of docs/virtual-mirror.md.

    python docs/figures/virtual_mirror.py FOLDER [PART ...]

Parts are the functions in `PARTS`; without any, all are run (some 6 minutes of CPU time). Rendered transients
are kept in the folder.
"""

import sys
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from small import shrink

from recon.capture import ArrayHistograms, Capture
from recon.grid import VoxelGrid
from recon.imaging import image
from recon.secondary_aperture import image_from
from recon.wave import VirtualPulse
from recon.window import Window
from rig.bench.simulated import true_geometry
from rig.model.colours import AMPLITUDE_COLOURS
from rig.model.config import SimulationConfig, built_in
from rig.show.saving import save
from simulators.detector import Detector
from simulators.optics.light import Optics
from simulators.scenes import Mesh, Scene
from simulators.transport.extra_bounces import CLUSTERS, Interreflections
from simulators.transport.light_paths import transients
from simulators.transport.patches import tessellate
from simulators.transport.three_bounces import ThreeBounces
from simulators.transport.visibility import occluders

PICTURE = Path(__file__).parents[1] / "images" / "virtual_mirror.png"
BIN_S, BINS = 16e-12, 1600
DETECTOR_M = (0.0, 0.0, 0.0)
#: Longest edge of a patch: right triangles with legs of 3.1 cm on a sheet of 1 m.
EDGE_M = 0.045
#: More than there are patches: each is a cluster of its own, and phases are right.
EACH = 10**6
#: Half the side of the box around a true place in which the object is looked for.
BOX_M = 0.15

Points = NDArray[np.float64]


def sheet(name: str, centre_m, across_m, up_m, albedo: float = 0.8) -> Mesh:
    """Return a rectangle with two edge vectors; with albedo 0 it only blocks light."""
    c, u, v = (np.array(vector, dtype=np.float64) for vector in (centre_m, across_m, up_m))
    corners_m = np.array([c - u / 2 - v / 2, c + u / 2 - v / 2, c + u / 2 + v / 2, c - u / 2 + v / 2])
    return Mesh(name, corners_m, np.array([[0, 1, 2], [0, 2, 3]]), albedo)


def facing(size_m: float = 1.0, depth_m: float = 1.5, object_m: float = 0.8) -> Scene:
    """Return a plane that faces the wall, and a square of 20 cm that faces the plane, with a black back."""
    plane = sheet("plane", (0, 0, depth_m), (size_m, 0, 0), (0, size_m, 0))
    square = sheet("object", (0.3, 0, object_m), (0.2, 0, 0), (0, 0.2, 0))
    return Scene(
        "facing", (plane, square, sheet("back", (0.3, 0, object_m - 0.01), (0.24, 0, 0), (0, 0.24, 0), 0))
    )


def corner() -> Scene:
    """Return a plane at 45 degrees and a square beyond a second corner, behind a black wall."""
    slant = (0.5**0.5, 0, 0.5**0.5)
    plane = sheet("plane", (0, 0, 1.5), slant, (0, 1, 0))
    square = sheet("object", (1.3, 0, 1.6), (0, 0, 0.2), (0, 0.2, 0))
    return Scene("corner", (plane, square, sheet("wall", (0.98, 0, 0.73), (0, 0, 1.46), (0, 2.4, 0), 0)))


def sideways() -> Scene:
    """Return a side wall whose mirror direction misses the relay wall, and a plane that faces both."""
    side = sheet("object", (1.0, 0, 1.4), (0, 0, 1.0), (0, 0.8, 0))
    return Scene("sideways", (side, sheet("plane", (0.475, 0, 2.0), (0.95, 0, 0), (0, 1.0, 0))))


def without_object(scene: Scene) -> Scene:
    """Return the scene with the object black: it still hides what is behind it."""
    return Scene(scene.name, tuple(replace(m, albedo=0.0) if m.name == "object" else m for m in scene.meshes))


def wall(columns: int) -> Points:
    """Return a square of laser spots, 1.92 m wide."""
    along_m = ((np.arange(columns) + 0.5) / columns - 0.5) * 1.92
    x_m, y_m = np.meshgrid(along_m, along_m)
    return np.column_stack([x_m.ravel(), y_m.ravel(), np.zeros(x_m.size)])


@dataclass(frozen=True)
class Renderings:
    """Noise-free transients, kept in a folder."""

    folder: Path

    def __call__(
        self,
        name: str,
        scene: Scene,
        bounces: int,
        columns: int = 64,
        edge_m: float | None = EDGE_M,
        clusters: int = EACH,
        alone: bool = False,
    ) -> Capture:
        """Render a scene, or take what is there; ``alone`` leaves out the light of three bounces."""
        kept = self.folder / f"{name}.npy"
        laser_m = wall(columns)
        if not kept.exists():
            lit = Scene(scene.name, tuple(mesh for mesh in scene.meshes if np.max(mesh.albedo) > 0))
            patches, blockers = tessellate(lit, edge_m), occluders(scene.triangles_m)
            paths = [] if alone else [ThreeBounces(patches, blockers, DETECTOR_M)]
            if bounces > 3:
                between = Interreflections(patches, blockers, bounces, Optics().wall_albedo, clusters)
                paths.append(between.light_paths(DETECTOR_M))
            edges_s = BIN_S * np.arange(BINS + 1)
            np.save(kept, transients(tuple(paths), laser_m, edges_s).astype(np.float32))
        counts = np.load(kept) * counted_m2()
        return Capture(ArrayHistograms(counts), BIN_S, np.zeros(1), laser_m, np.array([DETECTOR_M]))


def counted_m2() -> float:
    """Return the photons counted in 10 ms, per m^2 at the detector's spot, as in `rig sim render`."""
    config, optics = built_in(), Optics()
    photons = optics.photons_per_s * config.laser.fraction_of_full * 10e-3
    return (
        photons
        * Detector().efficiency
        * optics.collection_m2(true_geometry(config).detector_head_m, DETECTOR_M)
    )


def around(place_m, step_m: float = 0.02, reach_m: float = 0.3) -> VoxelGrid:
    """Return voxels around a place."""
    steps = step_m * np.arange(-round(reach_m / step_m), round(reach_m / step_m) + 1)
    return VoxelGrid(*(steps + at for at in place_m))


def points(grid: VoxelGrid) -> Points:
    """Return the voxels (V, 3) of a grid."""
    z_m, y_m, x_m = np.meshgrid(grid.z_m, grid.y_m, grid.x_m, indexing="ij")
    return np.column_stack([x_m.ravel(), y_m.ravel(), z_m.ravel()])


def surface(centre_m, across_m, up_m, step_m: float = 0.03) -> Points:
    """Return points spread over a rectangle."""
    c, u, v = (np.array(vector, dtype=np.float64) for vector in (centre_m, across_m, up_m))
    parts = [(np.arange(n) + 0.5) / n - 0.5 for n in (round(np.linalg.norm(e) / step_m) for e in (u, v))]
    return (c + parts[0][:, None, None] * u + parts[1][:, None] * v).reshape(-1, 3)


def in_box(intensity: NDArray, grid: VoxelGrid, place_m) -> tuple[float, Points]:
    """Return the greatest intensity within `BOX_M` of a place, and the centroid of what exceeds half."""
    near = np.abs(points(grid) - place_m).max(axis=1) < BOX_M
    values = np.where(near, intensity.ravel(), 0.0)
    bright = values >= values.max() / 2
    return float(values.max()), (values[bright] @ points(grid)[bright]) / max(values[bright].sum(), 1e-300)


def contrast(one: Capture, others: list[Capture], wavelength_m: float, place_m, start_s: float | None) -> str:
    """Image around a place, and tell where the object is and how much brighter than in other captures."""
    grid, window = around(place_m), Window(start_s=start_s)
    peak, found_m = in_box(
        image(one, VirtualPulse(wavelength_m), grid, window=window).intensity, grid, place_m
    )
    told = " ".join(f"{1000 * d:+.0f}" for d in found_m - place_m)
    for other in others:
        control = in_box(
            image(other, VirtualPulse(wavelength_m), grid, window=window).intensity, grid, place_m
        )[0]
        told += f"; {peak / control:.3g} times the control" if control else "; the control is dark"
    return f"peak {peak:.3g}, off by {told}"


def main_scene(render: Renderings) -> list[Capture]:
    """Return the facing plane: five bounces, three, and five without the object."""
    return [
        render("facing-5", facing(), 5),
        render("facing-3", facing(), 3),
        render("facing-5-empty", without_object(facing()), 5),
    ]


IMAGE_M = np.array([0.3, 0.0, 2.2])
#: After the last light of three bounces from the plane of 1 m at 1.5 m, at 4.2 m of path or 14.0 ns.
AFTER_S = 14e-9
#: The same for the slanting plane: 4.65 m.
CORNER_AFTER_S = 15.5e-9


def wavelengths(render: Renderings) -> None:
    """Tell the mirror image's place and contrast at wavelengths."""
    five, *others = main_scene(render)
    for wavelength_m in (0.06, 0.08, 0.12, 0.16, 0.24):
        for start_s in (None, AFTER_S):
            print(wavelength_m, start_s, contrast(five, others, wavelength_m, IMAGE_M, start_s), flush=True)


def refinement(render: Renderings) -> None:
    """Tell the mirror image of renderings with finer and finer patches, and with the usual clusters."""
    reference = render("fine", facing(), 5, 32, 0.032, alone=True)
    for name, edge_m, clusters in (
        ("fine", 0.032, EACH),
        ("45 mm", 0.045, EACH),
        ("63 mm", 0.063, EACH),
        ("89 mm", 0.089, EACH),
        ("126 mm", 0.126, EACH),
        ("usual clusters", None, CLUSTERS),
    ):
        capture = render(name.replace(" ", "-"), facing(), 5, 32, edge_m, clusters, alone=True)
        for wavelength_m in (0.12,):
            grid = around(IMAGE_M, reach_m=0.2)
            one, other = (image(c, VirtualPulse(wavelength_m), grid).field for c in (capture, reference))
            error = np.linalg.norm(one - other) / np.linalg.norm(other)
            print(name, wavelength_m, f"field differs by {error:.3f} of its norm;", end=" ")
            print(contrast(capture, [], wavelength_m, IMAGE_M, None), flush=True)


def passes(ones_m: Points, others_m: Points, z_m: float, half_m: float) -> NDArray[np.bool_]:
    """Return (N, M) whether the ways between points miss a square before the facing plane's object."""
    part = (z_m - ones_m[:, None, 2]) / (others_m[:, 2] - ones_m[:, None, 2])
    at_m = ones_m[:, None, :2] + part[..., None] * (others_m[:, :2] - ones_m[:, None, :2]) - IMAGE_M[:2]
    return (part < 1e-6) | (part > 1 - 1e-6) | (np.abs(at_m) > half_m).any(axis=2)


def form(ones_m: Points, others_m: Points, k_per_m: float) -> NDArray[np.complexfloating]:
    """Return form factors (N, M) between points of surfaces that face z, times exp(-ikr) [1/m^2]."""
    away_m = others_m - ones_m[:, None]
    r2 = (away_m**2).sum(axis=2)
    open_ = passes(ones_m, others_m, 0.79, 0.12) & passes(ones_m, others_m, 0.8, 0.1)
    return away_m[..., 2] ** 2 / (np.pi * r2**2) * open_ * np.exp(-1j * k_per_m * np.sqrt(r2))


def reference(render: Renderings) -> None:
    """Hold the fifth bounce by way of the object against a sum of waves over points 1.25 cm apart."""
    laser_m, spot_m = wall(32)[::3], np.array([DETECTOR_M])
    plane_m = surface((0, 0, 1.5), (1, 0, 0), (0, 1, 0), 0.0125)
    object_m = surface((0.3, 0, 0.8), (0.2, 0, 0), (0, 0.2, 0), 0.0125)
    lit = Scene("lit", facing().meshes[:2])
    times_s, reflecting_m2 = BIN_S * np.arange(BINS + 1), 0.8 * 0.0125**2

    def exact(k: float) -> NDArray[np.complexfloating]:
        there = form(object_m, plane_m, k) @ form(plane_m, spot_m, k)
        return (form(laser_m, plane_m, k) @ form(plane_m, object_m, k) @ there)[:, 0] * reflecting_m2**3

    for name, edge_m, clusters in (
        ("45 mm", EDGE_M, EACH),
        ("89 mm", 0.089, EACH),
        ("usual", None, CLUSTERS),
    ):
        blockers = occluders(facing().triangles_m)
        between = Interreflections(tessellate(lit, edge_m), blockers, 5, 0.0, clusters)
        light = transients((between.light_paths(DETECTOR_M),), laser_m, times_s)
        print(f"{name}: energy {light.sum() / exact(0.0).real.sum():.3f}", end="")
        for wavelength_m in (0.06, 0.08, 0.12, 0.16):
            k = 2 * np.pi / wavelength_m
            phases = np.exp(-1j * k * 299_792_458 * (times_s[:-1] + BIN_S / 2))
            ours, true = light @ phases, exact(k)
            scale = np.vdot(true, ours) / np.vdot(true, true)
            rest = np.linalg.norm(ours - scale * true) / np.linalg.norm(ours)
            print(
                f"; {wavelength_m}: {abs(scale):.3f} times, phase {np.angle(scale):.3f}, rest {rest:.3f}",
                end="",
            )
        print(flush=True)


def limits(render: Renderings) -> None:
    """Tell how the mirror image depends on the plane's size and distance; 32 x 32 positions, 12 cm."""
    cases = [(size_m, 1.5, 0.8) for size_m in (0.25, 0.5, 0.75, 1.0, 1.5)]
    cases += [(1.0, 1.2, 0.5), (1.0, 2.0, 1.3), (1.0, 1.5, 0.5), (1.0, 1.5, 1.1), (1.5, 2.5, 1.8)]
    for size_m, depth_m, object_m in cases:
        scene, name = facing(size_m, depth_m, object_m), f"limits-{size_m}-{depth_m}-{object_m}"
        five = render(name, scene, 5, 32, 0.063)
        empty = render(f"{name}-empty", without_object(scene), 5, 32, 0.063)
        place_m = np.array([0.3, 0.0, 2 * depth_m - object_m])
        print(size_m, depth_m, object_m, contrast(five, [empty], 0.12, place_m, None), flush=True)


def photons(render: Renderings) -> None:
    """Tell how the mirror image stands out of drawn photons, at exposures of 10 ms a position and more."""
    five, _, empty = main_scene(render)
    counts = five.histograms.counts.astype(np.float64)
    extra = float((counts - empty.histograms.counts).sum())
    config = built_in()
    faults = SimulationConfig().faults
    open_s = 10e-3 * config.laser.repetition_hz * BIN_S
    background = open_s * (faults.dark_counts_hz + faults.ambient_light_hz)
    print(f"10 ms a position: {counts.sum():.3g} photons, {extra:.3g} by way of the object;", end=" ")
    print(
        f"{background * counts[:, round(AFTER_S / BIN_S) :].size:.3g} of background after the plane's light"
    )
    grid = around(IMAGE_M)
    beside = np.abs(points(grid) - IMAGE_M).max(axis=1) > 0.2
    for wavelength_m, times in product((0.08, 0.12, 0.16), (1, 10, 100, 1000)):
        drawn = np.random.default_rng(1).poisson(times * (counts + background)).astype(np.float32)
        one = replace(five, histograms=ArrayHistograms(drawn))
        shot = image(one, VirtualPulse(wavelength_m), grid, window=Window(start_s=AFTER_S)).intensity
        peak, found_m = in_box(shot, grid, IMAGE_M)
        off = " ".join(f"{1000 * d:+.0f}" for d in found_m - IMAGE_M)
        print(
            wavelength_m,
            times,
            f"{peak / shot.ravel()[beside].max():.3g} times the greatest beside, off {off}",
        )


def slice_of(x_m, z_m) -> VoxelGrid:
    """Return the horizontal plane y = 0."""
    return VoxelGrid(np.arange(*x_m, 0.02), np.zeros(1), np.arange(*z_m, 0.02))


def second(render: Renderings) -> dict[str, tuple[NDArray, VoxelGrid]]:
    """Image the object at its true place from the plane, in both scenes; return intensities (z, x)."""
    five, _, empty = main_scene(render)
    found = {}
    plane_m, true_m = surface((0, 0, 1.5), (1, 0, 0), (0, 1, 0)), np.array([0.3, 0.0, 0.8])
    grid = slice_of((-0.1, 0.71), (0.5, 1.31))
    for wavelength_m in (0.08, 0.12):
        peaks = []
        for capture in (five, empty):
            look = partial(image_from, plane_m, capture, VirtualPulse(wavelength_m), points(grid))
            field = look(lit_by_surface=True, window=Window(start_s=AFTER_S))
            intensity = np.abs(field) ** 2
            peaks.append(in_box(intensity, grid, true_m))
            if capture is five:
                found[f"facing {wavelength_m}"] = intensity.reshape(len(grid.z_m), -1), grid
        (peak, at_m), (control, _) = peaks
        off = " ".join(f"{1000 * d:+.0f}" for d in at_m - true_m)
        print(
            "second, facing", wavelength_m, f"off {off}, {peak / control:.3g} times the control", flush=True
        )
    return found


def corners(render: Renderings) -> dict[str, tuple[NDArray, VoxelGrid]]:
    """Image around two corners: behind the slanting plane, and from it at the true place."""
    captures = [render("corner-5", corner(), 5), render("corner-3", corner(), 3)]
    captures.append(render("corner-5-empty", without_object(corner()), 5))
    print(
        "object seen by three bounces:",
        np.ptp(
            render("corner-3", corner(), 3).histograms.counts
            - render("corner-3-empty", without_object(corner()), 3).histograms.counts
        ),
    )
    place_m, true_m = np.array([0.1, 0.0, 2.8]), np.array([1.3, 0.0, 1.6])
    found = {}
    for wavelength_m in (0.08, 0.12):
        print(
            "corner",
            wavelength_m,
            contrast(captures[0], captures[1:], wavelength_m, place_m, CORNER_AFTER_S),
            flush=True,
        )
    plane_m = surface((0, 0, 1.5), (0.5**0.5, 0, 0.5**0.5), (0, 1, 0))
    grid, peaks = slice_of((0.9, 1.71), (1.2, 2.01)), []
    for capture in (captures[0], captures[2]):
        look = partial(image_from, plane_m, capture, VirtualPulse(0.08), points(grid))
        field = look(lit_by_surface=True, window=Window(start_s=CORNER_AFTER_S))
        peaks.append(in_box(np.abs(field) ** 2, grid, true_m))
        found.setdefault("corner", ((np.abs(field) ** 2).reshape(len(grid.z_m), -1), grid))
    (peak, at_m), (control, _) = peaks
    off = " ".join(f"{1000 * d:+.0f}" for d in at_m - true_m)
    print("second, corner 0.08", f"off {off}, {peak / control:.3g} times the control", flush=True)
    return found


def sides(render: Renderings) -> dict[str, tuple[NDArray, VoxelGrid]]:
    """Image a side wall that throws three bounces past the relay wall, from a plane that faces it."""
    grid = slice_of((0.5, 1.4), (0.9, 1.91))
    plane_m = surface((0.475, 0, 2.0), (0.95, 0, 0), (0, 1, 0))
    found = {}
    captures = {
        "three": render("sideways-3", sideways(), 3),
        "four": render("sideways-4", sideways(), 4),
        "fourth alone": render("sideways-4-alone", sideways(), 4, alone=True),
    }
    for name, capture in captures.items():
        ordinary = image(capture, VirtualPulse(0.08), grid).intensity[:, 0]
        field = image_from(plane_m, capture, VirtualPulse(0.08), points(grid), lit_by_surface=False)
        second_look = (np.abs(field) ** 2).reshape(ordinary.shape)
        for way, intensity in (("wall", ordinary), ("plane", second_look)):
            found[f"sideways {name} {way}"] = intensity, grid
            on = np.abs(grid.x_m - 1.0) < 0.05
            profile = intensity[:, on].max(axis=1)
            at = grid.x_m[intensity.argmax(axis=1)]
            share = np.mean(np.abs(at - 1.0) < 0.05)
            print(
                "sideways",
                name,
                way,
                f"brightest within 5 cm of the surface at {share:.0%} of depths;",
                f"on it {profile.mean():.3g}, beside it {np.median(intensity[:, ~on]):.3g}",
                flush=True,
            )
    return found


def picture(render: Renderings) -> None:
    """Draw what is seen behind the plane, and from it."""
    five = main_scene(render)[0]
    behind = slice_of((-0.1, 0.71), (1.8, 2.61))
    mirrored = image(five, VirtualPulse(0.08), behind, window=Window(start_s=AFTER_S)).intensity[:, 0]
    side = sides(render)
    panels = {
        "from the wall:\nbehind the plane": (mirrored, behind),
        "from the plane:\nat its true place": second(render)["facing 0.08"],
        "from the plane:\nbeyond a second corner": corners(render)["corner"],
        "from the wall:\na side wall": side["sideways four wall"],
        "from the plane:\nthe side wall": side["sideways four plane"],
    }
    true_m = [((0.2, 0.4), (2.2, 2.2)), ((0.2, 0.4), (0.8, 0.8)), ((1.3, 1.3), (1.5, 1.7))]
    true_m += [((1.0, 1.0), (0.9, 1.9))] * 2
    figure = Figure(figsize=(11, 3.2), layout="constrained")
    FigureCanvasAgg(figure)
    for axes, (title, (seen, grid)), line in zip(figure.subplots(1, 5), panels.items(), true_m, strict=True):
        edges = grid.x_m[0], grid.x_m[-1], grid.z_m[0], grid.z_m[-1]
        level_db = 10 * np.log10(seen / seen.max() + 1e-9)
        shown = axes.imshow(level_db, origin="lower", extent=edges, vmin=-30, vmax=0, cmap=AMPLITUDE_COLOURS)
        axes.plot(*line, "c--", linewidth=1)
        axes.set_title(title, fontsize=9)
        axes.set_xlabel("← x (m)", fontsize=8)
        axes.xaxis.set_inverted(True)  # seen from above, as in all pictures
        axes.set_ylabel("z (m)", fontsize=8)
        axes.tick_params(labelsize=8)
    figure.colorbar(shown, ax=figure.axes, shrink=0.7, label="dB of the panel's peak")
    save(figure, PICTURE)
    shrink(PICTURE)


PARTS = {part.__name__: part for part in (wavelengths, reference, refinement, limits, photons, picture)}
if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(exist_ok=True)
    for part in sys.argv[2:] or PARTS:
        PARTS[part](Renderings(folder))
