"""Photon statistics and raw-data views, against sums photon by photon, and as pictures and tables."""

import json

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from recon.capture import ArrayHistograms, Capture
from rig.errors import DataFileError
from rig.files.scan import ScanFile
from rig.files.volume import Volume, write_volume
from rig.show.raw import comparison_figure, raw_view, scan_figure
from rig.show.statistics import FIRST_USEFUL_S, histograms_of, streak, tally

SMALL = ("--grid", "12x8", "--spacing", "15cm", "--exposure", "10ms")


def capture(counts, first_bin_s, *, block=3, width_s=4e-12):
    positions = len(counts)
    laser_m = np.column_stack([np.arange(positions) * 0.1, np.zeros((positions, 2))])
    return Capture(
        ArrayHistograms(np.asarray(counts), block),
        width_s,
        np.asarray(first_bin_s),
        laser_m,
        np.zeros((1, 3)),
    )


@given(
    counts=st.lists(st.lists(st.integers(0, 70_000), min_size=6, max_size=6), min_size=1, max_size=8),
    starts=st.lists(st.integers(-4, 4), min_size=8, max_size=8),
    block=st.integers(1, 5),
)
def test_counting_bin_by_bin(counts, starts, block):
    """Bins that begin at 0 or later; a position's own first bin begins ``start`` bins after it."""
    taken = capture(counts, np.array(starts[: len(counts)]) * 4e-12, block=block)
    kept = [row[max(0, -start) :] for row, start in zip(counts, starts, strict=False)]
    found = tally(taken, from_s=0.0)
    assert found.photons.tolist() == [sum(row) for row in kept]
    assert found.largest.tolist() == [max(row) for row in kept]
    statistics = found.statistics
    assert statistics.photons == sum(map(sum, kept))
    assert statistics.bins == sum(map(len, kept))
    assert statistics.per_bin == pytest.approx(statistics.photons / statistics.bins)
    assert statistics.per_position == pytest.approx(statistics.photons / len(counts))
    assert statistics.largest == max(map(max, kept))
    assert found.photons[found.most] == max(found.photons)
    assert found.largest[found.peak] == statistics.largest
    middle = np.median(found.photons)
    assert abs(found.photons[found.median] - middle) == min(abs(found.photons - middle))


def test_the_paper_leaves_out_833_bins():
    """In rectified data of 4 ps bins: 14 167 of 15 000 remain, as its totals by its means say."""
    counts = np.ones((2, 15_000), np.uint16)
    assert tally(capture(counts, [0.0])).statistics.bins == 2 * 14_167


def test_a_record_that_ends_too_early_is_refused():
    with pytest.raises(DataFileError, match=r"ends before 3\.33 ns"):
        tally(capture(np.ones((2, 10)), [0.0]))


@given(
    counts=st.lists(st.lists(st.integers(0, 9), min_size=12, max_size=12), min_size=1, max_size=9),
    shift=st.lists(st.integers(0, 3), min_size=9, max_size=9),
    rows=st.integers(1, 4),
)
def test_the_reduced_image_is_the_mean_of_its_bins(counts, shift, rows):
    starts = np.array(shift[: len(counts)])
    image = streak(capture(counts, starts * 4e-12, block=2), rows=rows, columns=3)
    rows = min(rows, len(counts))
    total, bins = np.zeros((2, rows, 3))
    edges = np.rint(image.time_s / 4e-12 * 3).astype(int)  # in thirds of a bin: exact
    for p, row in enumerate(counts):
        for n, count in enumerate(row):
            begins = 3 * (starts[p] + n)
            column = np.searchsorted(edges, begins, "right") - 1
            if column < 3:
                total[p * rows // len(counts), column] += count
                bins[p * rows // len(counts), column] += 1
    with np.errstate(invalid="ignore"):
        assert image.counts == pytest.approx(total / bins, nan_ok=True)


def test_the_image_goes_line_by_line_however_the_scan_went():
    """Two lines, the second scanned backwards."""
    taken = capture(np.arange(6)[:, None] * np.ones((1, 4), int), [0.0])
    snake_m = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0], [1, 1, 0], [0, 1, 0]], float)
    image = streak(Capture(taken.histograms, 4e-12, taken.first_bin_s, snake_m, taken.detector_m))
    assert image.counts[:, 0].tolist() == [0, 1, 2, 5, 4, 3]


def test_chosen_histograms_come_in_the_order_asked():
    counts = np.arange(40).reshape(10, 4)
    found = histograms_of(capture(counts, [0.0]), [7, 2, 7])
    assert [row.tolist() for row in found] == [counts[p].tolist() for p in (7, 2, 7)]


# The verbs


@pytest.fixture
def scanned(rig):
    assert rig("scan", *SMALL, "--preset", "lab", "-o", "a.h5").code == 0
    assert rig("scan", *SMALL[:4], "--exposure", "1ms", "-o", "b.h5").code == 0
    return rig


def test_stats_tells_what_is_in_the_file(scanned):
    """Against the counts and positions themselves, rectified by hand."""
    told = json.loads(scanned("stats", "a.h5", "--json").out)["scans"][0]
    with h5py.File("a.h5") as file:
        counts, laser_m = file["transients/counts"][:, 0], file["geometry/laser_m"][()]
        attributes, geometry = dict(file["transients"].attrs), dict(file["geometry"].attrs)
        detector_m = file["geometry/detector_m"][:, 0]
    legs_m = np.linalg.norm(laser_m - geometry["laser_head_m"], axis=1)
    legs_m = legs_m + np.linalg.norm(detector_m - geometry["detector_head_m"], axis=1)
    begins_s = attributes["first_bin_s"] + np.arange(15_000) * 4e-12 - geometry["electronics_delay_s"]
    late = begins_s - legs_m[:, None] / 299_792_458.0 >= 833 * 4e-12
    assert told["photons"] == counts[late].sum()
    assert told["bins"] == late.sum()
    assert told["largest"] == counts[late].max()
    everything = json.loads(scanned("stats", "a.h5", "--from", "-90ns", "--json").out)["scans"][0]
    assert everything["photons"] == counts.sum()


def test_stats_of_several_scans_is_a_table_with_its_definition(scanned):
    done = scanned("stats", "a.h5", "b.h5")
    assert done.code == 0
    lines = done.out.splitlines()
    assert "photons/bin" in lines[0]
    assert lines[1].startswith("a.h5")
    assert lines[2].startswith("b.h5")
    assert "3.332 ns after the pulse on the wall" in done.err


def test_plots_are_pictures_of_their_own_names(scanned, tmp_path):
    for arguments, picture in (
        (("a.h5",), "a-plot.png"),
        (("a.h5", "b.h5", "--image", "both.png"), "both.png"),
    ):
        done = scanned("plot", *arguments)
        assert done.code == 0, done.err
        assert (tmp_path / picture).read_bytes().startswith(b"\x89PNG")
    volume = Volume(np.ones((3, 4, 5), np.float32), np.arange(5.0), np.arange(4.0), np.arange(1.0, 4.0))
    write_volume("v.h5", volume)
    assert json.loads(scanned("plot", "v.h5", "--json").out)["picture"] == "v-plot.png"
    mixed = scanned("plot", "a.h5", "v.h5")
    assert mixed.code == 2
    assert "v.h5 is a volume: only scans are compared" in mixed.err
    assert scanned("plot", "missing.h5").code == 5


def test_the_pictures_show_the_positions_that_they_name(scanned):
    with ScanFile("a.h5") as scan:
        figure, view = scan_figure("a", scan.capture()), raw_view("a", scan.capture())
        counted = tally(scan.capture())
        rows = histograms_of(scan.capture(), [counted.most, counted.median, counted.peak])
    image, *panels = figure.axes[:4]
    assert image.get_title() == "all counts"
    for axes, row, total in zip(
        panels, rows, counted.photons[[counted.most, counted.median, counted.peak]], strict=True
    ):
        drawn = axes.lines[0].get_ydata()
        assert drawn.sum() == total
        assert drawn.tolist() == row[len(row) - len(drawn) :].tolist()
        assert axes.lines[0].get_xdata()[0] >= FIRST_USEFUL_S * 1e9
    assert panels[2].lines[0].get_ydata().max() == counted.statistics.largest
    compared = comparison_figure([view, view])
    assert len(compared.subfigs) == 2
    for part in compared.subfigs:
        for axes, alone in zip(part.axes, panels, strict=True):
            np.testing.assert_array_equal(axes.lines[0].get_xydata(), alone.lines[0].get_xydata())
            assert axes.get_xlabel() == "time after the pulse on the wall (ns)"
