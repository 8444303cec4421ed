"""``rig compare``: every method that applies finds a hidden point, and the sheet shows what was computed."""

import json
from math import pi, sqrt

import h5py
import numpy as np
import pytest

from recon.capture import C_M_PER_S, ArrayHistograms, Capture
from recon.wave import VirtualPulse
from rig.commands import documents
from rig.commands.compare import _warn as warn
from rig.files import ScanFile, Volume, read_volume, write_volume
from rig.image.compare.found import Compared, Comparison
from rig.image.compare.methods import METHODS, column
from rig.image.low_pass import FWHM, low_pass_sigma_s, low_passed
from rig.image.request import Request
from rig.image.truth import known_truth
from rig.image.work import chosen
from rig.importers import import_scan
from rig.show.compare import Column, comparison_figure
from support.point_scans import write_point_scan
from support.thorough import THOROUGH

POINT = np.array([0.06, -0.03, 0.55])
#: Wavelength and depths of all comparisons here: small, since each method runs in a process of its own.
ASKED = ("--wavelength", "8cm", "--depth", "0.49m:0.61m:1cm")


def write_point(path, detectors, truth=False):
    """Write a hidden point in the neutral layout: 17 x 17 positions, 2.5 cm apart."""
    axis = np.linspace(-0.2, 0.2, 17)
    x, y = (values.ravel() for values in np.meshgrid(axis, axis))
    laser_m = np.stack([x, y, np.zeros(x.size)], axis=1)
    one_m = np.array([[0.02, 0.01, 0.0]])
    scattered_m = laser_m + np.random.default_rng(1).uniform(-0.1, 0.1, laser_m.shape) * [1, 1, 0]
    detector_m = {"confocal": laser_m, "one spot": one_m, "many spots": scattered_m}[detectors]
    path_m = np.linalg.norm(laser_m - POINT, axis=1) + np.linalg.norm(detector_m - POINT, axis=1)
    counts = np.zeros((x.size, 500), np.uint32)
    counts[np.arange(x.size), (path_m / C_M_PER_S / 16e-12).astype(int)] = 100
    with h5py.File(path, "w") as file:
        file["counts"] = counts
        file["laser_position_m"], file["detector_position_m"] = laser_m, detector_m
        file["time_s"] = (np.arange(500) + 0.5) * 16e-12
        file.attrs.update(bin_width_s=16e-12, time_origin="wall", confocal=detectors == "confocal")
        if truth:
            depth_m = np.full((17, 17), np.nan)
            depth_m[np.abs(axis - POINT[1]).argmin(), np.abs(axis - POINT[0]).argmin()] = POINT[2]
            file["truth/depth_m"], file["truth/x_m"], file["truth/y_m"] = depth_m, axis, axis


def test_every_method_that_applies_finds_the_point(rig, tmp_path):
    """Each method is a process of its own; without RIG_TEST_THOROUGH=1 the harder file is compared."""
    kinds = ["one spot", *(["confocal"] if THOROUGH else [])]
    for kind in kinds:
        write_point(tmp_path / f"{kind}.h5", kind)
    done = rig("compare", *(f"{kind}.h5" for kind in kinds), *ASKED, "--out", "found", "--json")
    assert done.code == 0, done.err
    document = json.loads(done.out)
    documents.Compared.model_validate(document)
    for told in document["comparisons"]:
        detectors = told["file"].removesuffix(".h5")
        assert [one["method"] for one in told["methods"]] == list(METHODS)
        assert all(one["applies"] for one in told["methods"])
        approximate = {one["method"] for one in told["methods"] if one["approximate"]}
        assert approximate == ({"lct", "fk"} if detectors == "one spot" else set())
        assert told["sheet"] == f"found/{detectors}-compare.png"
        assert (tmp_path / told["sheet"]).stat().st_size > 0
        for one in told["methods"]:
            check_point(one, tmp_path / "found" / f"{detectors}-{one['method']}-volume.h5")


def check_point(one, path):
    # A voxel of 2.5 cm across; in depth two planes of 1 cm, and for midpoints the 1 cm that moveout is short
    # by.
    peak = one["peak"]
    assert [peak["x_m"], peak["y_m"]] == pytest.approx(POINT[:2], abs=0.025), one["method"]
    assert peak["z_m"] == pytest.approx(POINT[2], abs=0.031 if one["approximate"] else 0.021)
    assert one["took_s"] > 0
    assert one["memory_bytes"] >= one["memory_before_bytes"] > 0
    # what was measured is what was kept
    assert float(read_volume(path).intensity.max()) == pytest.approx(peak["intensity"])


def test_a_table_names_what_does_not_apply_and_a_truth_in_the_file_is_used(rig, tmp_path):
    write_point(tmp_path / "point.h5", "many spots", truth=True)
    done = rig("compare", "point.h5", *ASKED, "--out", "a.png")
    assert done.code == 0, done.err
    header, *lines = done.out.splitlines()
    assert "overlap" in header
    assert "depth error" in header
    assert [line.split()[0].rstrip(":") for line in lines] == list(METHODS)
    refused = [line for line in lines if "not applicable" in line]
    assert [line.split(":")[0] for line in refused] == ["lct", "fk"]
    assert "289 detector spots" in done.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "point.h5"]


def test_a_simulated_scan_knows_its_scene(rig, tmp_path):
    small = ("--grid", "3x3", "--spacing", "10cm", "--bin-width", "32ps", "--bins", "400")
    assert rig("sim", "render", "point", "p.h5", *small).code == 0
    with ScanFile(tmp_path / "p.h5") as scan:
        assert known_truth(tmp_path / "p.h5", scan) == "scene:point"
        write_point(tmp_path / "measured.h5", "confocal", truth=True)
        # what a file holds goes before what its scan tells
        assert known_truth(tmp_path / "measured.h5", scan) == str(tmp_path / "measured.h5")
    import_scan(tmp_path / "measured.h5", tmp_path / "imported.h5")
    with ScanFile(tmp_path / "imported.h5") as scan:
        assert known_truth(tmp_path / "imported.h5", scan) is None


def test_a_dark_capture_has_no_comparison(rig, tmp_path):
    small = ("--grid", "5x5", "--spacing", "10cm", "--bin-width", "32ps", "--bins", "400")
    assert rig("sim", "render", "empty", "dark.h5", *small).code == 0
    done = rig("compare", "dark.h5", "--wavelength", "20cm", "--depth", "0.8m:1m:10cm")
    assert done.code == 2
    assert "the record has no counts" in done.err
    assert [path.name for path in tmp_path.iterdir()] == ["dark.h5"]


@pytest.mark.parametrize(("shape", "warned"), [((9, 1), True), ((3, 3), False)])
def test_positions_on_one_line_are_warned_about(tmp_path, capsys, shape, warned):
    path = write_point_scan(tmp_path / "line.h5", shape)
    with ScanFile(path) as scan:
        work, reason = chosen(scan, Request(wavelength_m=0.16, depth_m=(0.6, 0.8, 0.1)))
        warn(Comparison(path, tmp_path / "a.png", None, work, reason, 0.0, ()))
    assert ("line.h5: all positions are on one line" in capsys.readouterr().err) == warned


def test_a_column_shows_the_volume_and_its_numbers():
    rng = np.random.default_rng(5)
    axis, z_m = np.linspace(-0.2, 0.2, 8), np.array([0.5, 1.0])
    intensity = rng.random((2, 8, 8)).astype("f4")
    depth_m = np.full((8, 8), 0.5, "f4")
    volume = Volume(intensity, axis, axis, z_m, depth_m=depth_m, parameters={"solver": "bp"})
    found = {"took_s": 1.25, "memory_bytes": 3e8, "across_m": 0.031, "deep_m": None, "overlap": 0.5}
    shown = column(Compared("bp", found=found), volume, with_truth=True)
    # z^4 lifts the intensity against its fall-off, so z^2 the amplitude
    amplitude = np.maximum(np.sqrt(intensity[0]) * 0.25, np.sqrt(intensity[1]))
    np.testing.assert_allclose(shown.front, amplitude / amplitude.max(), rtol=1e-5)
    np.testing.assert_array_equal(shown.depth_m, depth_m)
    assert shown.title == "bp"
    assert shown.lines[:2] == ("1.2 s, 300 MB", "across 3.1 cm, deep –")
    assert "overlap 0.50" in shown.lines[3]
    assert "approximation" in column(Compared("fk", approximate=True), volume, with_truth=False).title


def test_the_sheet_shows_all_to_the_same_axes_and_colours():
    x_m, y_m = np.linspace(-0.4, 0.4, 9), np.linspace(-0.3, 0.3, 7)
    rng = np.random.default_rng(3)
    fronts = [rng.random((7, 9)) for _ in range(5)]
    depths_m = [1 + number / 10 + rng.random((7, 9)) for number in range(5)]
    columns = [Column("truth", None, np.full((7, 9), 1.5))]
    columns += [
        Column(f"method {number}", front, depth_m, ("a", "b"))
        for number, (front, depth_m) in enumerate(zip(fronts, depths_m, strict=True))
    ]
    figure = comparison_figure(columns, x_m, y_m, "scan.h5", "wavelength 4 cm")
    panels = [axes for axes in figure.axes if axes.get_images()]
    shown = [axes.get_images()[0] for axes in panels]
    expected = [columns[0].depth_m]
    for front, depth_m in zip(fronts, depths_m, strict=True):
        expected += [front, depth_m]
    for image, wanted in zip(shown, expected, strict=True):
        np.testing.assert_array_equal(image.get_array(), wanted)
    assert len({(axes.get_xlim(), axes.get_ylim()) for axes in panels}) == 1
    assert panels[0].get_xlim()[0] > panels[0].get_xlim()[1]
    # all fronts from 0 to 1, all depths around the truth's 1.5 m
    assert {image.get_clim() for image in shown} == {(0.0, 1.0), (1.45, 1.55)}
    figure.canvas.draw()
    boxes = [axes.get_tightbbox() for axes in figure.axes] + [
        text.get_window_extent() for text in figure.texts if text.get_text()
    ]
    width, height = figure.canvas.get_width_height()
    for number, box in enumerate(boxes):
        assert box.x0 >= 0
        assert box.y0 >= 0
        assert box.x1 <= width
        assert box.y1 <= height
        for other in boxes[:number]:
            assert not box.overlaps(other)


@pytest.mark.parametrize("cycles", [2.0, 6.0])
def test_the_low_pass_leaves_half_where_half_of_the_pulse_is_left(cycles):
    pulse = VirtualPulse(0.04, cycles)
    sigma_s = low_pass_sigma_s(pulse)
    frequencies = np.linspace(1, 2, 100_001) * pulse.carrier_rad_per_s
    spectrum = np.exp(-(((frequencies - pulse.carrier_rad_per_s) * pulse.sigma_s) ** 2) / 2)
    half = frequencies[np.abs(spectrum - 0.5).argmin()]
    # a step of the frequencies is 1e-5 of the carrier
    assert np.exp(-((half * sigma_s) ** 2) / 2) == pytest.approx(0.5, abs=1e-4)
    if cycles == 2:  # docs/decisions/0014
        assert sigma_s * FWHM == pytest.approx(0.36 * 0.04 / C_M_PER_S, rel=0.01)


def test_a_low_passed_record_is_the_same_read_whole_or_in_parts():
    counts = np.random.default_rng(4).poisson(3.0, (6, 200)).astype(np.uint32)
    counts[0] = 0
    counts[0, 100] = 1000
    spot_m = np.zeros((6, 3))
    sigma_s = 3e-11
    capture = low_passed(Capture(ArrayHistograms(counts, 2), 1e-11, np.zeros(1), spot_m, spot_m), sigma_s)

    def read(bins):
        return np.concatenate([block for _, block in capture.histograms.blocks(bins)])

    whole = read(slice(None))
    # single precision of sums of some thousand
    np.testing.assert_allclose(read(slice(37, 90)), whole[:, 37:90], rtol=1e-5)
    assert whole[0].sum() == pytest.approx(1000, rel=1e-3)
    assert whole[0, 100] == pytest.approx(1000 / (3 * sqrt(2 * pi)), rel=0.01)


def test_what_is_no_capture_is_refused(rig, tmp_path):
    missing = rig("compare", "gone.h5", "--json")
    assert missing.code == 5
    assert "does not exist" in json.loads(missing.out)["error"]
    axis = np.arange(3.0)
    write_volume(tmp_path / "v.h5", Volume(np.ones((3, 3, 3), "f4"), axis, axis, axis, scan="s.h5"))
    volume = rig("compare", "v.h5")
    assert volume.code == 2
    assert "is a volume" in volume.err
    assert "s.h5" in volume.err
    (tmp_path / "n.h5").write_bytes(b"nothing of the kind")
    assert rig("compare", "n.h5").code == 5
    assert sorted(path.name for path in tmp_path.iterdir()) == ["n.h5", "v.h5"]


def test_sheets_have_a_place_before_anything_is_imaged(rig, tmp_path):
    write_point(tmp_path / "a.h5", "confocal")
    one = rig("compare", "a.h5", "a.h5", "--out", "one.png")
    assert one.code == 2
    assert "give a folder" in one.err
    nowhere = rig("compare", "a.h5", "--out", "gone/one.png")
    assert nowhere.code == 2
    assert "does not exist" in nowhere.err
    twice = rig("compare", "a.h5", "a.h5", "--out", "found")
    assert twice.code == 2
    assert "two files are called a" in twice.err
