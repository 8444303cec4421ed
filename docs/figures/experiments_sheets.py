"""Sheets of `docs/experiments.md`: one scene at several exposures, and errors of depth."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion

from recon.depth import compensate_falloff, front_view
from rig.files import Volume, read_volume
from rig.image.truth import true_depth
from rig.model.colours import AMPLITUDE_COLOURS, DEPTH_COLOURS, NO_SURFACE
from rig.model.quantities import show_length
from rig.show.saving import save
from rig.show.volume import draw_front
from simulators.scenes import scene
from simulators.scenes.mesh import Scene

#: Part of a front view's pixels below full scale: a glossy thing outshines all matt ones.
BRIGHTEST = 0.99
#: Range of the colours of errors [mm].
LARGEST_MM = 20
#: Pixels with a larger error show another surface than the true one, at the edge of a nearer thing [m].
CLOSE_M = 0.05
#: "Inside" is so far from every edge of the true surface [m].
INSIDE_M = 0.03
#: Size of a panel [inches].
PANEL = 3.9
#: A thing is named where so much of it is seen [m²]; a background is what all others stand before.
NAMED_M2, BACKGROUND = 0.01, ("back_wall", "floor", "shelf")


def exposures(
    rows: Sequence[Mapping[str, Path]], picture: Path, *, depths: bool = False, names: str = ""
) -> None:
    """Draw front views of named volumes, and if asked a row of their depth maps below.

    `names` is the scene that is drawn beside them, as it is, with the names of its things. Each title says
    how like a volume is to the first one of its wavelength: the cosine between amplitudes.
    """
    like: dict[float, NDArray[np.float32]] = {}
    lines, columns = len(rows) * (2 if depths else 1), max(map(len, rows)) + bool(names)
    first = read_volume(next(iter(rows[0].values())))
    tall = PANEL * 0.92 * float(np.ptp(first.y_m) / np.ptp(first.x_m)) + 0.35
    figure = Figure(figsize=(PANEL * (columns + 0.35 * bool(names)), tall * lines), layout="constrained")
    FigureCanvasAgg(figure)
    parts = figure.add_gridspec(lines, columns, width_ratios=[1.0] * (columns - 1) + [1.35 if names else 1.0])
    panels = np.array(
        [
            [figure.add_subplot(parts[line, column]) for column in range(columns - bool(names))]
            for line in range(lines)
        ]
    )
    for line, row in enumerate(rows):
        for column, (name, path) in enumerate(row.items()):
            volume, axes = read_volume(path), panels[line, column]
            amplitude, wavelength_m = _amplitude(volume), float(volume.parameters["wavelength_m"])
            front = front_view(amplitude)
            shown, scale = front / np.quantile(front, BRIGHTEST), Normalize(0, 1)
            lit = draw_front(axes, shown, volume.x_m, volume.y_m, AMPLITUDE_COLOURS, scale)
            likeness = _likeness(amplitude, like.setdefault(wavelength_m, amplitude))
            axes.set_title(f"{name}, λ = {show_length(wavelength_m)}\nlikeness {likeness:.3f}", size=10)
            if depths and volume.depth_m is not None:
                axes = panels[line + len(rows), column]
                axes.set_facecolor(NO_SURFACE)
                scale = Normalize(volume.z_m[0], volume.z_m[-1])
                mapped = draw_front(axes, volume.depth_m, volume.x_m, volume.y_m, DEPTH_COLOURS, scale)
    label = f"amplitude z² / its {BRIGHTEST:.0%} quantile"
    figure.colorbar(lit, ax=panels[: len(rows)], label=label, shrink=0.9)
    if depths:
        figure.colorbar(mapped, ax=panels[len(rows) :], label="depth z (m), blank: none", shrink=0.9)
    for axes in panels.flat:
        axes.label_outer()
    if names:
        mapped = draw_things(figure.add_subplot(parts[:, -1]), scene(names), first)
        if not depths:
            figure.colorbar(mapped, ax=figure.axes[-1], label="depth z (m)", shrink=0.5)
    save(figure, picture)


def draw_things(axes: Axes, shown: Scene, volume: Volume) -> ScalarMappable:
    """Draw the true depths of a scene, and the names of its things where they stand before all others."""
    axes.set_facecolor(NO_SURFACE)
    axes.set_title("what is there", size=10)
    true_m = np.asarray(shown.depth_map(volume.x_m, volume.y_m))
    scale = Normalize(volume.z_m[0], volume.z_m[-1])
    drawn = draw_front(axes, true_m, volume.x_m, volume.y_m, DEPTH_COLOURS, scale)
    seen = shown.truth(volume.x_m, volume.y_m).mesh
    pixel_m2 = (volume.x_m[1] - volume.x_m[0]) * (volume.y_m[1] - volume.y_m[0])
    for number, mesh in enumerate(shown.meshes):
        rows, columns = np.nonzero(seen == number)
        if len(rows) * pixel_m2 < NAMED_M2 or mesh.name in BACKGROUND:
            continue
        # the pixel of the thing nearest to its middle: the middle of a ladder or chair may lie outside of it
        middle = np.hypot(rows - rows.mean(), columns - columns.mean()).argmin()
        place = volume.x_m[columns[middle]], volume.y_m[rows[middle]]
        words = axes.text(*place, mesh.name, size=8, color="black", ha="center", va="center")
        words.set_path_effects([withStroke(linewidth=2, foreground="white")])
    return drawn


def errors(volumes: Mapping[str, tuple[Path, str]], picture: Path) -> None:
    """Draw front views, and found minus true depth, of named volumes with their truths."""
    figure = Figure(figsize=(3.0 * len(volumes), 6.2), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(2, len(volumes), squeeze=False)
    for column, (name, (path, truth)) in enumerate(volumes.items()):
        volume, axes = read_volume(path), panels[:, column]
        assert volume.depth_m is not None
        front = front_view(_amplitude(volume))
        lit = draw_front(
            axes[0], front / front.max(), volume.x_m, volume.y_m, AMPLITUDE_COLOURS, Normalize(0, 1)
        )
        axes[0].set_title(name, size=11)
        error_mm = 1e3 * (volume.depth_m - true_depth(truth, volume.x_m, volume.y_m))
        scale = Normalize(-LARGEST_MM, LARGEST_MM)
        axes[1].set_facecolor(NO_SURFACE)
        drawn = draw_front(axes[1], error_mm, volume.x_m, volume.y_m, "RdBu", scale)
        axes[1].set_title(f"mean error {depth_errors(path, truth)['close']:.1f} mm", size=11)
    figure.colorbar(lit, ax=panels[0], label="amplitude z² / maximum", shrink=0.8)
    figure.colorbar(drawn, ax=panels[1], label="found - true depth (mm), blank: none", shrink=0.8)
    for panel in panels.flat:
        panel.label_outer()
    save(figure, picture)


def depth_errors(path: Path, truth: str) -> dict[str, float]:
    """Return means of the absolute error [mm] over pixels seen and true: all, close ones, those inside."""
    volume = read_volume(path)
    assert volume.depth_m is not None
    truth_m = true_depth(truth, volume.x_m, volume.y_m)
    error_mm = 1e3 * np.abs(volume.depth_m - truth_m)
    both = np.isfinite(error_mm)
    close = both & (error_mm < 1e3 * CLOSE_M)
    steps = round(INSIDE_M / float(volume.x_m[1] - volume.x_m[0]))
    level = np.round(truth_m, 2)
    inside = np.zeros_like(both)
    for depth_m in np.unique(level[np.isfinite(level)]):
        inside |= binary_erosion(level == depth_m, iterations=steps)
    kinds = {"all": both, "close": close, "inside": close & inside}
    means = {name: float(error_mm[mask].mean()) if mask.any() else np.nan for name, mask in kinds.items()}
    return means | {"share close": float(close.sum() / both.sum())}


def told(means: Mapping[str, float]) -> str:
    """Write what `depth_errors` returns in a line."""
    return ", ".join(f"{name} {value:.3g}" for name, value in means.items())


def _amplitude(volume: Volume) -> NDArray[np.float32]:
    return np.sqrt(compensate_falloff(volume.intensity, volume.z_m, 4.0))


def _likeness(one: NDArray, other: NDArray) -> float:
    return float((one * other).sum() / np.sqrt((one**2).sum() * (other**2).sum()))
