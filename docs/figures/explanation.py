"""Draw the figures of docs/explanation: from the record of a scan to an image, step by step.

Make them with

    rig scan --grid 90x65 --spacing 2cm --exposure 10ms --out letters.h5
    python docs/figures/explanation.py letters.h5 docs/images
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from small import shrink

from recon.capture import C_M_PER_S, ArrayHistograms, Capture
from recon.grid import VoxelGrid
from recon.imaging import image
from recon.wave import VirtualPulse
from recon.window import Window
from rig.files import ScanFile
from rig.model.colours import AMPLITUDE_COLOURS
from rig.show.saving import save
from rig.show.volume import X_LABEL

WAVELENGTH_M = 0.04
#: Bins are put together for the pictures of the record, so that single photons do not hide its shape.
TOGETHER = 8
#: A place on each letter, right-handed frame, metres.
ON_F_M, ON_R_M = np.array([0.42, 0.14, 1.0]), np.array([-0.36, 0.14, 1.5])
LETTERS = (("F", ON_F_M, "C1"), ("R", ON_R_M, "C0"))
NANO = 1e9


def loaded(scan: ScanFile) -> tuple[Capture, Window]:
    """Return a scan's capture with all counts in memory, and its window."""
    capture = scan.capture()
    counts = np.concatenate([block for _, block in capture.histograms.blocks()])
    whole = Capture(
        ArrayHistograms(counts), capture.bin_width_s, capture.first_bin_s, capture.laser_m, capture.detector_m
    )
    return whole, Window(start_s=scan.fade_from_s)


def part(capture: Capture, positions: NDArray[np.intp]) -> Capture:
    """Return a capture of some positions."""
    assert isinstance(capture.histograms, ArrayHistograms)
    first_bin_s = np.broadcast_to(capture.first_bin_s, capture.positions)[positions]
    return Capture(
        ArrayHistograms(capture.histograms.counts[positions]),
        capture.bin_width_s,
        first_bin_s,
        capture.laser_m[positions],
        capture.detector_m,
    )


def rebinned(capture: Capture, position: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the centres [s] of bins put together, and their counts."""
    assert isinstance(capture.histograms, ArrayHistograms)
    counts = capture.histograms.counts[position].astype(float)
    many = len(counts) // TOGETHER
    together = counts[: many * TOGETHER].reshape(many, TOGETHER).sum(axis=1)
    begin_s = np.broadcast_to(capture.first_bin_s, capture.positions)[position]
    return begin_s + (np.arange(many) + 0.5) * TOGETHER * capture.bin_width_s, together


def path_s(capture: Capture, spots_m: NDArray[np.float64], point_m: NDArray[np.float64]) -> NDArray:
    """Return the time from the wall to a point and back to the detector spot, for each laser spot."""
    ways_m = np.linalg.norm(spots_m - point_m, axis=-1) + np.linalg.norm(capture.detector_m[0] - point_m)
    return ways_m / C_M_PER_S


def middle_row(capture: Capture) -> NDArray[np.intp]:
    """Return the positions of the row of the wall nearest to the letters' height, in order of x."""
    y_m = capture.laser_m[:, 1]
    row = np.flatnonzero(np.isclose(y_m, y_m[np.abs(y_m - ON_F_M[1]).argmin()], atol=1e-3))
    return row[np.argsort(capture.laser_m[row, 0])]


def draw_record(capture: Capture, picture: Path) -> None:
    """Draw one histogram, and all of a row of the wall: time over place."""
    row = middle_row(capture)
    figure, (one, many) = canvas(1, 2, (11, 4.2))
    position = int(row[len(row) // 4])
    times_s, counts = rebinned(capture, position)
    one.plot(times_s * NANO, counts, color="0.25", lw=0.8)
    for name, point_m, colour in LETTERS:
        at_s = path_s(capture, capture.laser_m[position], point_m)
        one.axvline(at_s * NANO, color=colour, ls="--")
        one.text(at_s * NANO + 0.3, counts[times_s > 3.4e-9].max() * 0.93, name, color=colour, weight="bold")
    one.set(xlim=(3, 15), ylim=(0, counts[times_s > 3.4e-9].max() * 1.05))
    one.set(xlabel="time since the pulse was on the wall (ns)", ylabel="photons in 32 ps")
    one.set_title(f"one position, x = {capture.laser_m[position, 0]:.2f} m", fontsize=10)
    x_m = capture.laser_m[row, 0]
    counted = np.array([rebinned(capture, int(position))[1] for position in row])
    times_s = rebinned(capture, int(row[0]))[0]
    shown = (times_s > 3.4e-9) & (times_s < 15e-9)
    extent = (x_m[0], x_m[-1], times_s[shown][0] * NANO, times_s[shown][-1] * NANO)
    many.imshow(np.log10(1 + counted[:, shown].T), origin="lower", aspect="auto", extent=extent, cmap="Greys")
    for name, point_m, colour in LETTERS:
        at_s = path_s(capture, capture.laser_m[row], point_m)
        many.plot(x_m, at_s * NANO, color=colour, ls="--", lw=1.5, label=f"path by way of a point of {name}")
    many.set(xlabel="← x of the laser spot (m)", ylabel="time (ns)", xlim=(x_m[-1], x_m[0]))
    many.legend(fontsize=8, loc="upper center")
    many.set_title("all positions of a row", fontsize=10)
    finish(figure, picture)


def draw_wave(capture: Capture, picture: Path) -> None:
    """Draw one histogram, the virtual pulse, and what a convolution makes of both."""
    pulse = VirtualPulse(WAVELENGTH_M)
    position = int(middle_row(capture)[len(middle_row(capture)) // 4])
    assert isinstance(capture.histograms, ArrayHistograms)
    counts = capture.histograms.counts[position].astype(float)
    begin_s = np.broadcast_to(capture.first_bin_s, capture.positions)[position]
    times_s = begin_s + (np.arange(capture.bins) + 0.5) * capture.bin_width_s
    counts[times_s < 3.4e-9] = 0
    half = int(pulse.half_length_s / capture.bin_width_s)
    lag_s = np.arange(-half, half + 1) * capture.bin_width_s
    shape = np.exp(1j * pulse.carrier_rad_per_s * lag_s - lag_s**2 / (2 * pulse.sigma_s**2))
    wave = np.convolve(counts, shape, "same")
    figure, (above, between, below) = canvas(3, 1, (8.5, 6.2))
    times, summed = rebinned(capture, position)
    above.plot(times * NANO, np.where(times < 3.4e-9, 0, summed), color="0.25", lw=0.8)
    above.set_ylabel("photons\nin 32 ps")
    between.plot(lag_s * NANO + 5, shape.real, color="C2")
    between.plot(lag_s * NANO + 5, np.abs(shape), color="C2", ls=":")
    between.set_ylabel("virtual\npulse")
    between.text(5.6, 0.5, f"{WAVELENGTH_M * 100:.0f} cm, {pulse.cycles:g} cycles", color="C2")
    below.plot(times_s * NANO, wave.real, color="C2", lw=0.8)
    below.plot(times_s * NANO, np.abs(wave), color="0.2", lw=0.8, label="amplitude")
    below.set(ylabel="phasor field", xlabel="time since the pulse was on the wall (ns)")
    below.legend(fontsize=8)
    for axes in (above, between, below):
        axes.set_xlim(3, 12)
    finish(figure, picture)


def draw_focus(capture: Capture, window: Window, picture: Path) -> None:
    """Draw the hidden room seen from above, by one, four, sixteen and all positions of the wall."""
    x_m, z_m = np.linspace(-0.9, 0.9, 181), np.linspace(0.5, 1.9, 141)
    grid = VoxelGrid(x_m, np.array([ON_F_M[1]]), z_m)
    rng = np.random.default_rng(1)
    order = rng.permutation(capture.positions)
    numbers = (1, 4, 40, capture.positions)
    figure, panels = canvas(1, len(numbers), (13, 3.4))
    for axes, number in zip(panels, numbers, strict=True):
        seen = capture if number == capture.positions else part(capture, order[:number])
        solver = "rsd" if number > 100 else "direct"
        found = image(seen, VirtualPulse(WAVELENGTH_M), grid, solver=solver, window=window)
        amplitude = np.abs(found.field[:, 0, :]) * z_m[:, None] ** 2
        axes.imshow(
            amplitude / np.quantile(amplitude, 0.998),
            origin="lower",
            extent=(x_m[0], x_m[-1], z_m[0], z_m[-1]),
            cmap=AMPLITUDE_COLOURS,
            vmin=0,
            vmax=1,
        )
        axes.set(xlim=(x_m[-1], x_m[0]), xlabel=X_LABEL)
        axes.set_title(f"{number:,} position{'s' if number > 1 else ''}", fontsize=10)
    panels[0].set_ylabel("depth z (m)")
    finish(figure, picture)


def draw_depth(capture: Capture, window: Window, picture: Path) -> None:
    """Draw the field along depth through both letters, for three pulses."""
    z_m = np.arange(0.8, 1.7, 0.0025)
    figure, panels = canvas(1, 3, (12, 3.2))
    for axes, cycles in zip(panels, (1.5, 2.0, 6.0), strict=True):
        for name, point_m, colour in LETTERS:
            grid = VoxelGrid(point_m[:1], point_m[1:2], z_m)
            pulse = VirtualPulse(WAVELENGTH_M, cycles)
            amplitude = np.abs(image(capture, pulse, grid, window=window).field[:, 0, 0]) * z_m**2
            axes.plot(z_m, amplitude / amplitude.max(), color=colour, label=f"through {name}")
            axes.axvline(point_m[2], color=colour, ls=":", lw=1)
        axes.set_title(f"pulse of {cycles:g} cycles", fontsize=10)
        axes.set_xlabel("depth z (m)")
    panels[0].set_ylabel("amplitude times z², of the greatest")
    panels[0].legend(fontsize=8)
    finish(figure, picture)


def canvas(rows: int, columns: int, size_inch: tuple[float, float]) -> tuple[Figure, NDArray]:
    """Return a figure, and its axes in a row."""
    figure = Figure(figsize=size_inch, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, np.atleast_1d(figure.subplots(rows, columns)).ravel()


def finish(figure: Figure, picture: Path) -> None:
    """Write a figure, small."""
    save(figure, picture)
    shrink(picture)


def main(scan_path: str, folder: str) -> None:
    """Draw all."""
    with ScanFile(Path(scan_path)) as scan:
        capture, window = loaded(scan)
    draw_record(capture, Path(folder) / "explained_record.png")
    draw_wave(capture, Path(folder) / "explained_wave.png")
    draw_focus(capture, window, Path(folder) / "explained_focus.png")
    draw_depth(capture, window, Path(folder) / "explained_depth.png")


if __name__ == "__main__":
    main(*sys.argv[1:])
