"""Any file is recognised by its content and imported whole, or refused without a trace."""

import hashlib
import json
import os
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from rig.errors import DataFileError, UsageError
from rig.files import ScanFile
from rig.importers import LAYOUTS, import_scan
from support.layout_files import lct, tal
from support.published import published
from support.scan_files import load

PAGE = (Path(__file__).parents[2] / "docs" / "importing.md").read_text(encoding="utf-8")


# --- the neutral layout


def neutral(path, name="counts", **changes):
    rng = np.random.default_rng(6)
    variables = {
        name: rng.poisson(1.0, (300, 30)).astype("u2"),
        "laser_position_m": rng.normal(size=(300, 3)),
        "detector_position_m": np.zeros((1, 3)),
        "time_s": 5e-9 + 16e-12 * np.arange(30),
    } | changes
    with h5py.File(path, "w") as file:
        for key, value in variables.items():
            file[key] = value
        file.attrs.update({"bin_width_s": 16e-12, "gate_start_s": 2.4e-9, "simulated": True})
    return variables


def test_neutral_layout(tmp_path):
    wrote = neutral(tmp_path / "a.h5")
    assert import_scan(tmp_path / "a.h5", tmp_path / "b.h5").layout == "neutral HDF5"
    capture, counts = load(tmp_path / "b.h5")
    np.testing.assert_array_equal(counts, wrote["counts"])
    np.testing.assert_array_equal(capture.laser_m, wrote["laser_position_m"])
    assert capture.first_bin_s[0] == pytest.approx(5e-9 - 8e-12, abs=1e-20)
    with ScanFile(tmp_path / "b.h5") as again:
        assert again.fade_from_s == 2.4e-9
        assert again.simulated


def test_neutral_expectations_stay_floats(tmp_path):
    signal = np.random.default_rng(1).random((300, 30), "f4")
    neutral(tmp_path / "a.h5", "transient", transient=signal)
    import_scan(tmp_path / "a.h5", tmp_path / "b.h5", fade_from_s=1e-9)
    with ScanFile(tmp_path / "b.h5") as scan:
        assert scan.expectation
        assert scan.fade_from_s == 1e-9
    np.testing.assert_array_equal(load(tmp_path / "b.h5")[1], signal)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"transient": np.zeros((300, 30), "f4")}, "both counts and transient"),
        ({"time_s": np.arange(29) * 16e-12}, "29 bin centres"),
        ({"time_s": np.arange(30.0) ** 2 * 1e-12}, "not evenly spaced"),
        ({"laser_position_m": np.zeros((299, 3))}, "299 laser positions"),
        ({"laser_position_m": np.full((300, 3), np.nan)}, "none is a finite number"),
        ({"counts": np.full((300, 30), np.nan)}, "not a finite number"),
        ({"counts": np.zeros((300, 30), complex)}, "not real numbers"),
    ],
)
def test_a_neutral_file_that_does_not_fit_is_refused(tmp_path, changes, said):
    neutral(tmp_path / "a.h5", **changes)
    with pytest.raises(DataFileError, match=said):
        import_scan(tmp_path / "a.h5", tmp_path / "b.h5")
    assert [path.name for path in tmp_path.iterdir()] == ["a.h5"]


@pytest.mark.parametrize("kind", [">u2", "i8", "f8", "f2", "i1"])
def test_whole_numbers_are_photons_however_they_are_stored(tmp_path, kind):
    counts = np.random.default_rng(3).poisson(1.0, (300, 30))
    neutral(tmp_path / "a.h5", counts=counts.astype(kind))
    import_scan(tmp_path / "a.h5", tmp_path / "b.h5")
    with ScanFile(tmp_path / "b.h5") as scan:
        assert not scan.expectation
    np.testing.assert_array_equal(load(tmp_path / "b.h5")[1], counts)


@pytest.mark.parametrize("last", [-1.0, 0.5, 2.0**33])
def test_one_value_that_is_no_number_of_photons_makes_a_signal(tmp_path, last):
    counts = np.random.default_rng(3).poisson(1.0, (300, 30)).astype("f8")
    counts[-1, -1] = last
    neutral(tmp_path / "a.h5", counts=counts)
    import_scan(tmp_path / "a.h5", tmp_path / "b.h5")
    with ScanFile(tmp_path / "b.h5") as scan:
        assert scan.expectation
    assert load(tmp_path / "b.h5")[1][-1, -1] == last


def test_points_are_found_along_either_axis(tmp_path):
    places_m = np.random.default_rng(2).normal(size=(300, 3))
    for number, turned in enumerate([places_m, places_m.T, places_m.T.reshape(3, 15, 20)]):
        neutral(tmp_path / f"{number}.h5", laser_position_m=turned, detector_position_m=np.zeros(3))
        import_scan(tmp_path / f"{number}.h5", tmp_path / f"{number}-scan.h5")
        np.testing.assert_array_equal(load(tmp_path / f"{number}-scan.h5")[0].laser_m, places_m)


@pytest.mark.parametrize("shape", [(300, 2), (900,), (150, 6)])
def test_points_without_three_coordinates_are_refused(tmp_path, shape):
    neutral(tmp_path / "a.h5", laser_position_m=np.ones(shape))
    with pytest.raises(DataFileError, match=r"'laser_position_m' has shape .* three numbers x, y, z"):
        import_scan(tmp_path / "a.h5", tmp_path / "b.h5")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"time_s": 1e9 * (5e-9 + 16e-12 * np.arange(30))}, "wide, which no photon counter has"),
        ({"laser_position_m": 1e3 * np.random.default_rng(6).normal(size=(300, 3))}, "its spots span"),
    ],
)
def test_another_unit_than_the_layouts_is_refused(tmp_path, changes, said):
    neutral(tmp_path / "a.h5", **changes)
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        file.attrs["bin_width_s"] = file["time_s"][1] - file["time_s"][0]
    with pytest.raises(DataFileError, match=said):
        import_scan(tmp_path / "a.h5", tmp_path / "b.h5")


def test_a_wall_that_is_wide_for_its_record_is_told_of(tmp_path):
    neutral(tmp_path / "a.h5", laser_position_m=5 * np.random.default_rng(6).normal(size=(300, 3)))
    assert "its spots span" in " ".join(import_scan(tmp_path / "a.h5", tmp_path / "b.h5").assumed)


@pytest.mark.parametrize(("bins", "wall_m"), [(1, 0.2), (4, 1.0)])
def test_a_record_too_short_to_image_is_imported_to_be_counted(tmp_path, bins, wall_m):
    corners_m = wall_m / 2 * np.array([[-1, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0]])
    neutral(
        tmp_path / "a.h5",
        counts=np.full((4, bins), 7, np.uint16),
        time_s=4e-12 * (0.5 + np.arange(bins)),
        laser_position_m=corners_m,
        detector_position_m=np.zeros(3),
    )
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        file.attrs["bin_width_s"] = 4e-12
    assert "its spots span" in " ".join(import_scan(tmp_path / "a.h5", tmp_path / "b.h5").assumed)
    with ScanFile(tmp_path / "b.h5") as scan:
        assert scan.photons == 28 * bins


def test_a_neutral_wall_beside_z_0_is_moved_there_with_its_heads(tmp_path):
    wrote = neutral(tmp_path / "a.h5", detector_position_m=np.array([[0.0, 0.0, 20.0]]))
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        file["laser_position_m"][...] += [0, 0, 20]
        file.attrs.update(time_origin="laser", laser_head_m=[0, 0, 21.0], detector_head_m=[1, 0, 21.0])
    report = import_scan(tmp_path / "a.h5", tmp_path / "b.h5")
    assert any("the origin was moved to" in line for line in report.assumed)
    z_m = wrote["laser_position_m"][:, 2]
    moved_m = 20 + (z_m.min() + z_m.max()) / 2
    with ScanFile(tmp_path / "b.h5") as scan:
        np.testing.assert_allclose(scan.laser_m[:, 2], z_m + 20 - moved_m, atol=1e-12)
        assert scan.delays.laser_head_m[2] == pytest.approx(21 - moved_m)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("bin_width_s", "16 ps"),
        ("gate_start_s", np.nan),
        ("simulated", "perhaps"),
        ("bin_width_s", [1.0, 2.0]),
    ],
)
def test_an_attribute_of_another_type_is_named(tmp_path, name, value):
    neutral(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        file.attrs[name] = value
    with pytest.raises(DataFileError, match=f"attribute '{name}' is .* needed"):
        import_scan(tmp_path / "a.h5", tmp_path / "b.h5")


@pytest.mark.parametrize(("word", "meant"), [("no", False), ("False", False), ("true", True), (1.0, True)])
def test_a_flag_may_be_a_word(tmp_path, word, meant):
    neutral(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        file.attrs["simulated"] = word
    import_scan(tmp_path / "a.h5", tmp_path / "b.h5")
    with ScanFile(tmp_path / "b.h5") as scan:
        assert scan.simulated is meant


@pytest.mark.parametrize(
    "name", ["ahn_2019", "phasor_figure4_nonconfocal", "rendered_letters_g32", "xiao18m_L"]
)
def test_neutral_layout_as_published(tmp_path, name):
    import_scan(published(f"{name}.h5"), tmp_path / "a.h5")
    capture, counts = load(tmp_path / "a.h5")
    with h5py.File(published(f"{name}.h5")) as other:
        np.testing.assert_array_equal(counts, other["counts" if "counts" in other else "transient"][()])
        np.testing.assert_array_equal(capture.laser_m, other["laser_position_m"][()])
        np.testing.assert_array_equal(capture.detector_m, other["detector_position_m"][()])


# --- everything else


def test_unknown_content_is_listed_with_what_is_known(tmp_path):
    scipy.io.savemat(tmp_path / "a.mat", {"picture": np.zeros((3, 4)), "name": "x"})
    with h5py.File(tmp_path / "b.mat", "w", userblock_size=512) as file:
        file["volume"] = np.zeros((2, 2))
    with open(tmp_path / "b.mat", "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + b"\0" * 8 + b"\x00\x02IM")
    for name, found in (("a.mat", r"picture \(3, 4\)"), ("b.mat", r"volume \(2, 2\)")):
        with pytest.raises(DataFileError, match=rf"no known layout; it holds .*{found}.*H_format.*rect_data"):
            import_scan(tmp_path / name, tmp_path / "c.h5")


def mat(path, **variables):
    scipy.io.savemat(path, variables)
    return path


@pytest.mark.parametrize(
    ("variables", "said"),
    [
        (
            {"rect_data": np.zeros((2, 2, 3)), "ts": 4e-12},
            "like Liu 2020, diffraction, but lacks SPAD_index:",
        ),
        (
            {"Rect_Data": np.zeros((2, 2, 3)), "width": 1.0},
            r"O'Toole .* lacks rect_data \(it has Rect_Data\)",
        ),
        ({"data": np.zeros((2, 2, 3))}, "like Liu 2023, CC-SOCR with setup, but lacks setup.mat:"),
        (
            {"sig_in": np.zeros((2, 2, 3)), "width": 1.0},
            "like Wu 2021, 1.43 km stand-off, but lacks timeRes:",
        ),
        ({"H": np.zeros((2, 2, 3))}, "like TAL, but lacks H_format:"),
        ({"H": np.zeros((2, 2, 3)), "H_format": 1}, "like TAL, but is not HDF5 with H and H_format:"),
    ],
)
def test_an_unknown_file_is_told_what_it_looks_like_and_lacks(tmp_path, variables, said):
    path = mat(tmp_path / "a.mat", **variables)
    with pytest.raises(DataFileError, match=said) as caught:
        import_scan(path, tmp_path / "b.h5")
    message = str(caught.value)
    assert message.index("looks most like") < message.index("it holds")
    assert len(message) < 500


def test_the_refusal_of_a_file_with_many_arrays_stays_short(tmp_path):
    path = mat(tmp_path / "a.mat", **{f"array_{number}": np.zeros(2) for number in range(300)})
    with pytest.raises(DataFileError, match=r"and 288 more\. Layouts are recognised by") as caught:
        import_scan(path, tmp_path / "b.h5")
    assert len(str(caught.value)) < 1100


def test_a_file_of_this_program_needs_no_import(tmp_path):
    neutral(tmp_path / "a.h5")
    import_scan(tmp_path / "a.h5", tmp_path / "b.h5")
    with pytest.raises(DataFileError, match="needs no import: rig recon reads it"):
        import_scan(tmp_path / "b.h5", tmp_path / "c.h5")


def test_two_readings_are_refused(tmp_path):
    neutral(tmp_path / "a.h5", H=np.zeros((20, 3, 4)), H_format=1)
    with pytest.raises(DataFileError, match="neutral HDF5 and as TAL"):
        import_scan(tmp_path / "a.h5", tmp_path / "b.h5")


def test_no_target_is_overwritten(tmp_path):
    lct(tmp_path / "a.mat")
    (tmp_path / "b.h5").write_bytes(b"precious")
    with pytest.raises(UsageError, match="not overwritten"):
        import_scan(tmp_path / "a.mat", tmp_path / "b.h5", bin_width_s=4e-12)
    assert (tmp_path / "b.h5").read_bytes() == b"precious"


def test_damaged_files_are_refused_and_leave_nothing(tmp_path):
    lct(tmp_path / "whole.mat")
    tal(tmp_path / "whole.hdf5")
    rng = np.random.default_rng(12)
    refused = 0
    for name, given in (("whole.mat", {"bin_width_s": 4e-12}), ("whole.hdf5", {})):
        content = (tmp_path / name).read_bytes()
        for number in range(60):
            damaged = bytearray(content[: int(rng.integers(len(content)))] if number % 2 else content)
            for place in rng.integers(0, len(damaged) + 1, 30):
                if place < len(damaged):
                    damaged[place] = rng.integers(256)
            path, target = tmp_path / f"damaged-{name}", tmp_path / "target.h5"
            path.write_bytes(damaged)
            try:
                import_scan(path, target, **given)
                target.unlink()
            except (DataFileError, UsageError):
                refused += 1
                assert not target.exists()
    assert refused > 60
    assert not list(tmp_path.glob(".*"))


def test_the_digest_is_that_of_the_source(tmp_path):
    neutral(tmp_path / "a.h5")
    import_scan(tmp_path / "a.h5", tmp_path / "b.h5")
    with h5py.File(tmp_path / "b.h5") as file:
        said = json.loads(file["start"].attrs["imported"])["sha256"]
    assert said == hashlib.sha256((tmp_path / "a.h5").read_bytes()).hexdigest()


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: layout.NAME)
def test_the_page_tells_of_each_layout(layout):
    assert f"| {layout.NAME} | {layout.SIGN} |" in PAGE


@pytest.mark.parametrize("read", [ScanFile, lambda path: import_scan(path, path.with_suffix(".scan"))])
def test_a_name_out_of_a_file_cannot_begin_a_line_of_a_message(tmp_path, read):
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["so far\nrig: all is well\r"] = [1.0]
    with pytest.raises(DataFileError, match=r"so far\\nrig: all is well\\r") as refusal:
        read(path)
    assert "\nrig:" not in str(refusal.value)


@pytest.mark.parametrize("read", [ScanFile, lambda path: import_scan(path, path.with_suffix(".scan"))])
def test_a_file_that_may_not_be_read_is_not_called_damaged(tmp_path, read):
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["H"] = [1.0]
    path.chmod(0)
    if os.access(path, os.R_OK):
        pytest.skip("whoever runs this may read everything")
    with pytest.raises(DataFileError, match=r"a\.h5 cannot be read \(Permission denied\)"):
        read(path)
