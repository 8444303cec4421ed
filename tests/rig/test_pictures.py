"""Pictures show things where the virtual camera sees them, in metres, and without panels that collide."""

import os
from dataclasses import replace

import numpy as np
import pytest
from matplotlib import colormaps
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.image import imread

from recon.capture import ArrayHistograms, Capture
from rig.errors import DataFileError, UsageError
from rig.files import Volume
from rig.model.colours import AMPLITUDE_COLOURS, DEPTH_COLOURS, NO_SURFACE
from rig.show.layout import arranged
from rig.show.raw import scan_figure
from rig.show.saving import save
from rig.show.volume import X_LABEL, volume_figure
from rig.show.wall import draw_counts


def volume(nx=60, ny=40, nz=50, blob=(0.5, 0.3, 1.0), **changes):
    """Return a dark volume of 1.8 m x 1.2 m x 1.5 m with one blob of 6 cm at (x, y, z)."""
    x_m, y_m = np.linspace(-0.9, 0.9, nx), np.linspace(-0.6, 0.6, ny)
    z_m = np.linspace(0.5, 2.0, nz) if nz > 1 else np.array([blob[2]])
    z, y, x = np.meshgrid(z_m, y_m, x_m, indexing="ij")
    distance_m = np.sqrt((x - blob[0]) ** 2 + (y - blob[1]) ** 2 + (z - blob[2]) ** 2)
    intensity = np.exp(-((distance_m / 0.06) ** 2)).astype("f4")
    depth_m = np.where(intensity.max(axis=0) > 0.2, blob[2], np.nan).astype("f4")
    given = {"parameters": {"solver": "rsd", "wavelength_m": 0.04}, "scan": "letters.h5", "depth_m": depth_m}
    return Volume(intensity=intensity, **({"x_m": x_m, "y_m": y_m, "z_m": z_m} | given | changes))


def panels(figure):
    return {axes.get_title().split(":")[0].split(" of")[0]: axes for axes in figure.axes if axes.get_title()}


def brightest_place(figure, axes):
    """Return where a panel is brightest: fractions of its width, from the left, and of its height."""
    figure.canvas.draw()
    pixels = np.asarray(figure.canvas.buffer_rgba())[::-1, :, :3].sum(axis=2)
    box = axes.get_window_extent()
    # two pixels off each side: the frame line is dark or light, not data
    inner = pixels[round(box.y0) + 2 : round(box.y1) - 2, round(box.x0) + 2 : round(box.x1) - 2]
    rows, columns = np.nonzero(inner > 0.98 * inner.max())
    return columns.mean() / inner.shape[1], rows.mean() / inner.shape[0]


def test_what_is_at_plus_x_and_up_is_drawn_left_and_up():
    figure = volume_figure(volume(blob=(0.5, 0.3, 1.0)))
    front = panels(figure)["front"]
    across, up = brightest_place(figure, front)
    # when x grows to the left, x = 0.5 of -0.9 ... 0.9 is 0.4 m from the left edge; y = 0.3 of -0.6 ... 0.6
    # is 0.9 m from the bottom; a voxel is 3 % of the width
    assert across == pytest.approx(0.4 / 1.8, abs=0.03)
    assert up == pytest.approx(0.9 / 1.2, abs=0.03)
    assert front.get_xlim()[0] > front.get_xlim()[1]
    assert "(m)" in front.get_xlabel()


def in_metres(place, limits):
    """Return where a fraction of a panel's width or height is on its axis."""
    return limits[0] + place * (limits[1] - limits[0])


def test_top_and_side_agree_with_the_front():
    figure = volume_figure(volume(blob=(0.5, 0.3, 1.0)))
    top, side = panels(figure)["top"], panels(figure)["side"]
    across, away = brightest_place(figure, top)
    assert across == pytest.approx(0.4 / 1.8, abs=0.03)
    # the brightest voxel is 3 cm deep
    assert in_metres(away, top.get_ylim()) == pytest.approx(1.0, abs=0.03)
    away, up = brightest_place(figure, side)
    assert in_metres(away, side.get_xlim()) == pytest.approx(1.0, abs=0.03)
    assert up == pytest.approx(0.9 / 1.2, abs=0.03)
    assert side.get_xlim() == pytest.approx(top.get_ylim())


def test_views_end_where_all_beyond_is_black_and_say_what_was_imaged():
    top = panels(volume_figure(volume(blob=(0.5, 0.3, 1.0))))["top"]
    # 40 % of the front view's 1.8 m, about the blob; voxels are 3.06 cm deep
    assert top.get_ylim() == pytest.approx((1 - 0.36, 1 + 0.36), abs=0.031)
    assert [text.get_text() for text in top.texts] == ["imaged 0.50 to 2.00 m: black beyond"]
    two = replace(volume(), intensity=volume().intensity + volume(blob=(0.0, 0.0, 1.7)).intensity)
    # amplitude exp(-r² / 2 (6 cm)²) is 5 % at 14.7 cm; then come 10 cm
    top = panels(volume_figure(two))["top"]
    assert top.get_ylim() == pytest.approx((1 - 0.247, 1.7 + 0.247), abs=0.031)
    full = volume()
    everywhere = replace(full, intensity=np.maximum(full.intensity, 0.01))  # amplitude 10 %
    top = panels(volume_figure(everywhere))["top"]
    assert top.get_ylim() == pytest.approx((0.5, 2.0), abs=0.016)
    assert not top.texts


def test_confidence_is_drawn_in_steps_that_noise_alone_does_not_reach():
    confidence = np.linspace(0, 0.949, 2400, dtype="f4").reshape(40, 60)
    confidence[0, :3] = 0.96, 0.995, 1.0
    figure = volume_figure(volume(confidence=confidence))
    (image,) = panels(figure)["confidence that it is not noise"].get_images()
    shades = [to_rgba(shade) for shade in image.to_rgba(confidence).reshape(-1, 4)]
    assert len(set(shades[3:])) == 1  # below 95 % all is alike
    assert len(set(shades[2::-1])) == 3
    assert (np.diff(lightness(np.array([shades[3], *shades[:3]]))) > 0.1).all()


def scan_of(counts, x_m, y_m=0.0, bin_width_s=1e-10):
    """Return a capture of (positions, bins) counts at places of the wall, a bin of 100 ps from 4 ns."""
    spots_m = np.stack([x_m, np.broadcast_to(y_m, np.shape(x_m)), np.zeros(np.shape(x_m))], axis=1)
    return Capture(
        ArrayHistograms(counts), bin_width_s, np.array([4e-9]), spots_m, np.array([[0.0, 0.0, 0.0]])
    )


def test_a_raw_plot_has_counts_at_its_colours_and_is_not_stretched_by_one_late_photon():
    counts = np.zeros((3, 300), np.uint16)
    counts[:, 20:30] = [[1], [10], [100]]
    counts[:, 290] = 1  # a dark count, 33 ns
    counts[0, 20:30] = 100
    figure = scan_figure("scan.h5", scan_of(counts, [-0.1, 0.0, 0.1]))
    figure.canvas.draw()
    ends_ns = {axes.get_title().split(":")[0]: axes.get_xlim()[1] for axes in figure.axes}
    # 1,000 photons, in bins up to 7 ns; half a nanosecond is left free
    assert ends_ns["most photons"] == pytest.approx(7.45, abs=0.05)
    bar = next(axes for axes in figure.axes if "counts a bin, mean" in axes.get_ylabel())
    told = [label.get_text() for label in bar.get_yticklabels()]
    assert {"1", "10", "100"} <= set(told)
    (image,) = figure.axes[0].get_images()
    assert image.get_array().max() == 100


def test_a_raw_plot_of_nothing_is_drawn():
    figure = scan_figure("scan.h5", scan_of(np.zeros((3, 300), np.uint16), [-0.1, 0.0, 0.1]))
    figure.canvas.draw()


def test_spots_off_any_lattice_have_the_label_of_all_front_views():
    axes = Figure().subplots()
    draw_counts(
        axes, np.array([[0.0, 0.0, 0.0], [0.3, 0.1, 0.0], [0.1, 0.7, 0.0]]), np.array([1.0, 2.0, 3.0])
    )
    assert axes.get_xlabel() == X_LABEL
    assert axes.get_xlim()[0] > axes.get_xlim()[1]


def test_the_depth_map_is_drawn_like_the_front_and_grey_where_nothing_is():
    figure = volume_figure(volume())
    depth = panels(figure)["depth"]
    assert depth.get_xlim() == panels(figure)["front"].get_xlim()
    figure.canvas.draw()
    pixels = np.asarray(figure.canvas.buffer_rgba())[::-1, :, :3]
    box = depth.get_window_extent()
    corner = pixels[round(box.y0) + 20, round(box.x1) - 20]
    assert corner[0] == corner[1] == corner[2]
    x = round(box.x0 + (box.x1 - box.x0) * 0.4 / 1.8)
    y = round(box.y0 + (box.y1 - box.y0) * 0.9 / 1.2)
    assert len(set(pixels[y, x].tolist())) > 1


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"depth_m": None},
        {"nz": 1},
        {"nz": 1, "depth_m": None},
        {"nx": 8, "ny": 60},
        {"depth_m": np.full((40, 60), np.nan, "f4")},
        {"confidence": np.ones((40, 60), "f4")},
        {"confidence": np.ones((40, 60), "f4"), "z_m": np.linspace(0.9, 1.7, 50)},
        {"parameters": {"origin": {"rig": "words " * 150}}},
    ],
)
def test_panels_keep_the_scale_and_do_not_collide(changes):
    figure = volume_figure(volume(**changes), compensation="z²")
    figure.canvas.draw()
    boxes = [axes.get_tightbbox() for axes in figure.axes] + [
        text.get_window_extent() for text in figure.texts
    ]
    width, height = figure.canvas.get_width_height()
    assert 1200 <= width <= 1600
    for number, box in enumerate(boxes):
        assert box.x0 >= 0
        assert box.y0 >= 0
        assert box.x1 <= width
        assert box.y1 <= height
        for other in boxes[:number]:
            assert not box.overlaps(other)
    for axes in panels(figure).values():
        box = axes.get_window_extent()
        (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
        assert box.width / abs(right - left) == pytest.approx(box.height / abs(high - low), rel=1e-6)


@pytest.mark.parametrize(("depths_m", "least"), [((0.5, 3.0), 0.8), ((0.9, 1.7), 0.8), ((0.5, 1.5), 0.8)])
def test_no_quarter_of_the_sheet_is_empty(depths_m, least):
    layout = arranged(1.8, 1.3, depths_m[1] - depths_m[0], ["depth", "confidence"])
    assert layout.filled > least
    boxes = [*layout.boxes.values()]
    assert boxes[0].wide / 1.8 == pytest.approx(boxes[-1].high / 1.3)
    shared = layout.boxes
    assert (shared["front"].y, shared["front"].high) == (shared["side"].y, shared["side"].high)
    assert (shared["front"].x, shared["front"].wide) == (shared["top"].x, shared["top"].wide)


def test_labels_of_a_tiny_volume_do_not_collide():
    shown = volume(nx=2, ny=1, nz=50)
    shown = replace(shown, x_m=np.array([0.0, 0.01]), y_m=np.array([0.0]), confidence=np.ones((1, 2), "f4"))
    figure = volume_figure(shown, compensation="z⁴")
    figure.canvas.draw()
    boxes = [axes.get_tightbbox() for axes in figure.axes]
    boxes += [text.get_window_extent() for text in figure.texts]
    for number, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[:number])
    assert any("not to scale" in axes.get_title() for axes in figure.axes)


def lightness(colours):
    """Return how light (n, 4) colours of sRGB print in grey: the relative luminance to the power 1/2.4."""
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)[:, :3]
    return (linear @ [0.2126, 0.7152, 0.0722]) ** (1 / 2.4)


def test_depths_can_be_told_apart_in_a_grey_print():
    shown = lightness(DEPTH_COLOURS(np.linspace(0, 1, 65)))
    assert np.diff(shown).min() > 0.002  # near is dark: lighter with every 64th of the range
    assert lightness(np.array([to_rgba(NO_SURFACE)])) > shown.max() + 0.05
    assert (np.diff(lightness(colormaps[AMPLITUDE_COLOURS](np.linspace(0, 1, 65)))) > 0).all()


def test_a_caption_traces_a_picture_to_its_scan():
    origin = {
        "positions": 23384,
        "photons": 46581270,
        "exposure_s": 0.01,
        "measured": "2026-11-27T18:32:04+00:00",
        "rig": "simulated rig, scene letters",
    }
    figure = volume_figure(volume(parameters={"origin": origin}, scan_digest="0123456789abcdef" * 4))
    assert figure.texts[-1].get_text() == (
        "23,384 positions, 10 ms each, 46,581,270 photons, measured 2026-11-27 18:32 UTC, "
        "simulated rig, scene letters, SHA-256 of the scan 0123456789ab…"
    )


def test_noise_alone_is_said_across_the_picture():
    seen, noise = ({"solver": "rsd", "signal": signal} for signal in (True, False))
    said = {
        signal: [
            text.get_text()
            for axes in volume_figure(volume(parameters=told)).axes
            for text in axes.texts
            if "imaged" not in text.get_text()
        ]
        for signal, told in ((True, seen), (False, noise))
    }
    assert said == {True: [], False: ["no signal above noise"] * 2}


def test_the_heading_names_scan_and_parameters():
    figure = volume_figure(volume(), compensation="z²")
    said = [text.get_text() for text in figure.texts]
    assert said == ["letters.h5", "rsd, wavelength 4 cm"]
    assert any("intensity times z²" in axes.get_ylabel() for axes in figure.axes)


@pytest.mark.parametrize(
    "intensity", [np.ones((3, 2, 4, 5), "f4"), np.ones((3, 4, 5), "f4"), np.zeros((3, 4, 5), "f4")]
)
def test_a_transient_cameras_volume_is_shown_by_its_brightest_moment(intensity):
    z_m = np.array([1.0, 1.1]) if intensity.ndim == 4 else np.array([1.0])
    shown = Volume(intensity, np.linspace(-1, 1, 5), np.linspace(-1, 1, 4), z_m, t_s=np.arange(3.0))
    (image,) = panels(volume_figure(shown))["front"].get_images()
    np.testing.assert_array_equal(image.get_array(), intensity.max() * np.ones((4, 5)))


def test_a_picture_appears_whole_or_not_at_all(tmp_path):
    figure = volume_figure(volume())
    save(figure, tmp_path / "a.pdf")
    assert (tmp_path / "a.pdf").read_bytes().startswith(b"%PDF")
    os.remove(tmp_path / "a.pdf")
    save(figure, tmp_path / "a.png")
    assert imread(tmp_path / "a.png").shape[1] == 1500
    assert os.listdir(tmp_path) == ["a.png"]
    with pytest.raises(DataFileError, match="format"):
        save(figure, tmp_path / "a.nothing")
    with pytest.raises(UsageError, match="does not exist"):
        save(figure, tmp_path / "nowhere" / "a.png")
    assert os.listdir(tmp_path) == ["a.png"]
