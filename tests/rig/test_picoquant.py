"""PicoQuant's files: records and histograms become scan files, and scans become records."""

import tracemalloc

import h5py
import numpy as np
import pytest

from drivers.harp.records import T3, Batch, Encoder
from rig.errors import DataFileError, UsageError
from rig.exporters import export
from rig.files import ScanDescription, ScanFile, ScanWriter
from rig.importers import import_scan
from rig.model.delays import PathDelays
from support.picoquant_files import T2, counts_of, phu, ptu, put_tag, records_of, scan_events
from support.published import published
from support.scan_files import load

GRID = {"grid": (3, 3), "spacing_m": 0.1, "detector": "confocal", "point_marker": 1}


@pytest.fixture
def events():
    return scan_events(9, 40)


# --- records in


def test_photons_belong_to_the_point_whose_marker_came_before(tmp_path, events):
    early = [(0, "photon", 120, 0)] * 3
    report = import_scan(
        ptu(tmp_path / "a.ptu", records_of(early + events)), tmp_path / "a.h5", time_zero_s=1e-9, **GRID
    )
    capture, counts = load(tmp_path / "a.h5")
    np.testing.assert_array_equal(counts, counts_of(events, range(100, 100 + counts.shape[1])))
    assert capture.confocal
    assert capture.bin_width_s == 16e-12
    np.testing.assert_allclose(capture.first_bin_s, 100 * 16e-12 - 1e-9, rtol=1e-12)
    np.testing.assert_allclose(capture.laser_m[:4, :2], [[-0.1, -0.1], [0, -0.1], [0.1, -0.1], [-0.1, 0]])
    assert any("3 of 363 photons lie before or between points" in line for line in report.assumed)


@pytest.mark.parametrize(
    ("given", "second_line"),
    [
        ({"snake": True}, [[0.1, 0], [0, 0], [-0.1, 0]]),
        ({"order": "-x,-y"}, [[0.1, 0], [0, 0], [-0.1, 0]]),
        ({"order": "y,x"}, [[0, -0.1], [0, 0], [0, 0.1]]),
    ],
)
def test_the_order_of_points_is_as_told(tmp_path, events, given, second_line):
    import_scan(ptu(tmp_path / "a.ptu", records_of(events)), tmp_path / "a.h5", **GRID, **given)
    capture, _ = load(tmp_path / "a.h5")
    np.testing.assert_allclose(capture.laser_m[3:6, :2], second_line, atol=1e-15)


def test_a_point_ends_where_the_next_line_begins(tmp_path):
    events = [(0, "marker", 1), (5, "photon", 7, 0), (9, "marker", 2), (11, "photon", 8, 0)]
    events += [(20, "marker", 1), (25, "photon", 9, 0)]
    given = GRID | {"grid": (1, 2), "line_marker": 2}
    events = [(0, "marker", 2), *events]
    import_scan(ptu(tmp_path / "a.ptu", records_of(events)), tmp_path / "a.h5", **given)
    _, counts = load(tmp_path / "a.h5")
    np.testing.assert_array_equal(counts, [[1, 0, 0], [0, 0, 1]])  # dtime 8 came between lines


def test_a_line_marker_alone_ends_a_line_that_began_with_a_point(tmp_path):
    line = [(0, "marker", 3), (5, "photon", 7, 0), (10, "marker", 1), (15, "photon", 8, 0), (20, "marker", 2)]
    events = [(0, "marker", 4), *line, (25, "photon", 9, 0)]
    events += [(pulse + 50, *what) for pulse, *what in line]
    given = GRID | {"grid": (2, 2), "line_marker": 2}
    report = import_scan(ptu(tmp_path / "a.ptu", records_of(events)), tmp_path / "a.h5", **given)
    _, counts = load(tmp_path / "a.h5")
    np.testing.assert_array_equal(counts, [[1, 0, 0], [0, 1, 0]] * 2)  # dtime 9 came while the mirror turned
    assert any("2 lines begin at markers" in line for line in report.assumed)


def test_places_may_be_those_of_another_scan(tmp_path, events):
    import_scan(
        ptu(tmp_path / "a.ptu", records_of(events)), tmp_path / "first.h5", **GRID | {"detector": (0.2, -0.1)}
    )
    import_scan(tmp_path / "a.ptu", tmp_path / "again.h5", places=tmp_path / "first.h5", point_marker=1)
    (first, counts), (again, same) = load(tmp_path / "first.h5"), load(tmp_path / "again.h5")
    np.testing.assert_array_equal(counts, same)
    np.testing.assert_array_equal(first.laser_m, again.laser_m)
    np.testing.assert_allclose(again.detector_m, [[0.2, -0.1, 0]])
    with pytest.raises(UsageError, match="--places and --grid"):
        import_scan(tmp_path / "a.ptu", tmp_path / "b.h5", places=tmp_path / "first.h5", **GRID)


def test_a_missing_marker_is_named_by_line_and_point(tmp_path, events):
    at = [index for index, event in enumerate(events) if event[1] == "marker"]
    fifth = [event for index, event in enumerate(events) if index != at[4]]
    source = ptu(tmp_path / "a.ptu", records_of(fifth))
    with pytest.raises(DataFileError, match=r"8 markers .* 9 points.*gap is after line 2, point 1"):
        import_scan(source, tmp_path / "a.h5", **GRID)
    with pytest.raises(DataFileError, match=r"line 2 has 2 markers of points of 3. After point 1 of it"):
        import_scan(source, tmp_path / "a.h5", **GRID, line_marker=2)
    assert not (tmp_path / "a.h5").exists()


def test_markers_that_are_too_many_are_refused(tmp_path, events):
    source = ptu(tmp_path / "a.ptu", records_of(events))
    with pytest.raises(UsageError, match=r"9 markers of points .* 4 points; check --grid"):
        import_scan(source, tmp_path / "a.h5", **GRID | {"grid": (2, 2)})
    with pytest.raises(UsageError, match=r"which marker begins a point: .*marker 1: 9; marker 2: 3.*--point"):
        import_scan(source, tmp_path / "a.h5", **{k: v for k, v in GRID.items() if k != "point_marker"})


def test_several_frames_are_refused_by_their_number(tmp_path):
    source = ptu(tmp_path / "a.ptu", records_of(scan_events(18, 5)))
    with pytest.raises(UsageError, match="it holds 2 frames"):
        import_scan(source, tmp_path / "a.h5", **GRID)


def test_a_file_that_was_cut_off_gives_the_points_that_are_whole(tmp_path, events):
    records = records_of(events)
    at = [index for index, record in enumerate(records) if record >> 31 and record >> 25 & 63 < 16]
    for said in (len(records), 0):
        ptu(tmp_path / "a.ptu", records, said=said)
        content = (tmp_path / "a.ptu").read_bytes()
        (tmp_path / "a.ptu").write_bytes(content[: len(content) - 4 * (len(records) - at[5]) + 4 * 8 + 3])
        (tmp_path / "a.h5").unlink(missing_ok=True)
        report = import_scan(tmp_path / "a.ptu", tmp_path / "a.h5", **GRID)
        _, counts = load(tmp_path / "a.h5")
        np.testing.assert_array_equal(counts, counts_of(events, range(100, 100 + counts.shape[1]))[:5])
        assert any("the file is cut off" in line for line in report.assumed)
        assert any("the one before line 2, point 3" in line for line in report.assumed)


def test_which_input_is_imaged_is_asked_where_several_count(tmp_path, events):
    mixed = [(pulse, kind, *([*values[:-1], index % 2] if kind == "photon" else values))
             for index, (pulse, kind, *values) in enumerate(events)]  # fmt: skip
    source = ptu(tmp_path / "a.ptu", records_of(mixed))
    with pytest.raises(UsageError, match=r"photons on input 0; .* photons on input 1.*--input"):
        import_scan(source, tmp_path / "a.h5", **GRID)
    totals = []
    for number in (0, 1):
        import_scan(source, tmp_path / f"{number}.h5", input=number, **GRID)
        totals.append(load(tmp_path / f"{number}.h5")[1].sum())
    assert totals == [
        sum(event[1:] == ("photon", event[2], n) for event in mixed if len(event) == 4) for n in (0, 1)
    ]


def test_t2_photons_are_counted_after_the_last_sync_pulse(tmp_path):
    special = 1 << 31
    records = [special | 1 << 25 | 10, 5, special | 20]  # marker 1; a photon before any pulse; a pulse
    records += [
        1 << 25 | 55,
        special | 63 << 25 | 1,
        1 << 25 | 3,
        special | 1 << 25 | 40,
        special | 60,
        1 << 25 | 131,
    ]
    source = ptu(
        tmp_path / "a.ptu",
        np.array(records, "<u4"),
        TTResultFormat_TTTRRecType=T2,
        MeasDesc_GlobalResolution=1e-12,
    )
    given = GRID | {"grid": (1, 2), "input": 1}
    with pytest.raises(UsageError, match="--bin-width"):
        import_scan(source, tmp_path / "a.h5", **given)
    put_tag(source, "MeasDesc_GlobalResolution", 0)
    with pytest.raises(DataFileError, match="count 0 s"):
        import_scan(source, tmp_path / "a.h5", bin_width_s=10e-12, **given)
    put_tag(source, "MeasDesc_GlobalResolution", int(np.float64(1e-12).view(np.int64)))
    # 55 - 20 and 131 - 60 ps in bins of 10 ps; 2^25 + 3 - 20 ps is no time of a photon after its pulse
    report = import_scan(source, tmp_path / "a.h5", bin_width_s=10e-12, **given)
    assert any("2 photons have no sync pulse" in line for line in report.assumed)
    assert not any("between points" in line for line in report.assumed)
    capture, counts = load(tmp_path / "a.h5")
    np.testing.assert_allclose(capture.first_bin_s, 30e-12)
    np.testing.assert_array_equal(counts, [[1, 0, 0, 0, 0], [0, 0, 0, 0, 1]])


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda path: put_tag(path, "TTResultFormat_TTTRRecType", 0x00010308), "type 0x00010308"),
        (lambda path: path.write_bytes(path.read_bytes()[:100]), "ends within its header"),
        (
            lambda path: path.write_bytes(path.read_bytes().replace(b"MeasDesc_Reso", b"MeasDesc_Redo")),
            "is missing",
        ),
        (lambda path: put_tag(path, "MeasDesc_Resolution", -1), "is nan, not a number"),
    ],
)
def test_damaged_heads_are_refused(tmp_path, events, spoil, said):
    source = ptu(tmp_path / "a.ptu", records_of(events))
    spoil(source)
    with pytest.raises(DataFileError, match=said):
        import_scan(source, tmp_path / "a.h5", **GRID)
    assert [path.name for path in tmp_path.iterdir()] == ["a.ptu"]


def test_memory_does_not_grow_with_the_records(tmp_path):
    peaks = []
    for times in (1, 8):
        photons = 400_000 * times
        tag = np.arange(photons, dtype=np.int64)
        marks = np.arange(0, photons, photons // 4, dtype=np.int64)
        batch = Batch(
            tag, (tag % 500).astype("u2"), np.zeros(photons, np.int8), marks, np.ones(4, "u1"), marks
        )
        source = ptu(tmp_path / f"{times}.ptu", Encoder(T3).encode(batch))
        tracemalloc.start()
        import_scan(source, tmp_path / f"{times}.h5", **GRID | {"grid": (2, 2)})
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert load(tmp_path / f"{times}.h5")[1].sum() == photons
    # eight times the records are 11 MB more in the file; what is read of them at once stays the same
    assert peaks[1] - peaks[0] < 2e6


def test_records_behind_the_last_are_told_of(tmp_path, events):
    records = records_of(events)
    source = ptu(tmp_path / "a.ptu", np.append(records, [5, 6]).astype("<u4"), said=len(records))
    report = import_scan(source, tmp_path / "a.h5", **GRID)
    assert any("has 2 more, which are left out" in line for line in report.assumed)
    assert load(tmp_path / "a.h5")[1].sum() == 360


def test_more_markers_than_any_plan_has_are_no_scan(tmp_path):
    source = ptu(tmp_path / "a.ptu", np.full(10_000_001, 1 << 31 | 1 << 25, "<u4"))
    with pytest.raises(DataFileError, match="more than 10,000,000 markers"):
        import_scan(source, tmp_path / "a.h5", **GRID)


# --- histograms in


def test_curves_are_the_points_of_a_grid(tmp_path):
    counts = np.random.default_rng(2).poisson(3.0, (6, 20))
    source = phu(tmp_path / "a.phu", counts)
    given = {"grid": (3, 2), "spacing_m": 0.1, "detector": (0.0, 0.1)}
    import_scan(source, tmp_path / "a.h5", **given)
    capture, same = load(tmp_path / "a.h5")
    np.testing.assert_array_equal(same, counts)
    assert capture.bin_width_s == 4e-12
    with pytest.raises(UsageError, match="6 curves, but the plan has 9"):
        import_scan(source, tmp_path / "b.h5", **given | {"grid": (3, 3)})
    source.write_bytes(source.read_bytes()[:-10])
    report = import_scan(source, tmp_path / "b.h5", **given)
    assert any("cut off: 5 of its 6 curves are complete" in line for line in report.assumed)
    np.testing.assert_array_equal(load(tmp_path / "b.h5")[1], counts[:5])
    source.write_bytes(source.read_bytes()[:-400])
    with pytest.raises(DataFileError, match="none of its 6 curves is complete"):
        import_scan(source, tmp_path / "c.h5", **given)


# --- records out


def write_scan(path, counts, laser_m, detector_m, **more):
    described = ScanDescription(laser_m, detector_m, counts.shape[-1], 8e-12, 2e-9, **more)
    with ScanWriter.create(path, described) as writer:
        for row in counts:
            writer.append(row, 1e-3)


LINES_M = np.array([[x, y, 0.0] for y in (-0.1, 0.0, 0.1) for x in (-0.2, -0.1, 0.0, 0.1)])


def test_a_scan_survives_the_way_to_records_and_back(tmp_path):
    counts = np.random.default_rng(1).poisson(0.6, (12, 30)).astype("u4")
    delays = PathDelays(np.array([0.3, 0.0, 2.0]), np.array([-0.2, 0.1, 2.1]), 5e-9)
    write_scan(
        tmp_path / "a.h5", counts, LINES_M, np.array([[0.2, 0.1, 0.0]]), delays=delays, fade_from_s=0.1e-9
    )
    assert export(tmp_path / "a.h5", tmp_path / "a.ptu") == "PicoQuant records, T3"
    import_scan(tmp_path / "a.ptu", tmp_path / "b.h5")
    (before, first), (after, second) = load(tmp_path / "a.h5"), load(tmp_path / "b.h5")
    np.testing.assert_array_equal(first, second)
    for name in ("laser_m", "detector_m", "bin_width_s"):
        np.testing.assert_array_equal(getattr(before, name), getattr(after, name))
    np.testing.assert_allclose(after.first_bin_s, before.first_bin_s, rtol=0, atol=1e-20)
    with ScanFile(tmp_path / "b.h5") as scan:
        assert scan.fade_from_s == 0.1e-9


def test_channels_are_told_apart_by_their_inputs(tmp_path):
    counts = np.random.default_rng(1).poisson(0.6, (4, 2, 30)).astype("u4")
    seen_m = np.array([[[0.2, 0.1, 0.0], [0.3, 0.1, 0.0]]])
    write_scan(tmp_path / "a.h5", counts, LINES_M[:4], seen_m)
    export(tmp_path / "a.h5", tmp_path / "a.ptu")
    import_scan(tmp_path / "a.ptu", tmp_path / "b.h5")
    (before, first), (after, second) = load(tmp_path / "a.h5"), load(tmp_path / "b.h5")
    np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(before.detector_m, after.detector_m)
    with pytest.raises(UsageError, match=r"--grid 2x2 contradicts"):
        import_scan(tmp_path / "a.ptu", tmp_path / "c.h5", grid=(2, 2))


def test_what_cannot_be_records_is_refused(tmp_path):
    write_scan(tmp_path / "a.h5", np.full((4, 5), 0.5, "f4"), LINES_M[:4], LINES_M[:1], dtype="<f4")
    write_scan(tmp_path / "b.h5", np.zeros((1, 40_000), "u4"), LINES_M[:1], LINES_M[:1])
    with pytest.raises(UsageError, match="expectation values, not photons"):
        export(tmp_path / "a.h5", tmp_path / "a.ptu")
    with pytest.raises(UsageError, match="40,000 bins; a record can hold 32,768"):
        export(tmp_path / "b.h5", tmp_path / "a.ptu")
    with pytest.raises(UsageError, match=r"--rectified is not for \.ptu"):
        export(tmp_path / "b.h5", tmp_path / "a.ptu", rectify=True)
    assert not (tmp_path / "a.ptu").exists()


def test_ptufile_reads_what_is_exported_record_for_record(tmp_path):
    ptufile = pytest.importorskip("ptufile", reason="ptufile is not installed: pip install 'nlos-rig[dev]'")
    counts = np.random.default_rng(1).poisson(0.6, (12, 30)).astype("u4")
    write_scan(tmp_path / "a.h5", counts, LINES_M, LINES_M[:1])
    export(tmp_path / "a.h5", tmp_path / "a.ptu")
    with ptufile.PtuFile(tmp_path / "a.ptu") as file:
        assert file.record_type.name == "HydraHarp2T3"
        assert (file.tcspc_resolution, file.number_markers) == (8e-12, 12)
        decoded = file.decode_records()
    photons, markers = decoded[decoded["channel"] >= 0], decoded[decoded["marker"] > 0]
    # a point is 1 ms at 10 MHz
    np.testing.assert_array_equal(markers["time"], 10_000 * np.arange(12))
    np.testing.assert_array_equal(markers["marker"], [7, 1, 1, 1, 3, 1, 1, 1, 3, 1, 1, 1])
    again = np.zeros((12, 30), int)
    np.add.at(again, (photons["time"] // 10_000, photons["dtime"]), 1)
    np.testing.assert_array_equal(again, counts)
    assert (np.diff(decoded["time"].astype(np.int64)) >= 0).all()


# --- files of real instruments


def test_a_real_scan_in_t3(tmp_path):
    source = published("original/picoquant/hydraharp/nlos_su_scan_derived_t3.ptu")
    import_scan(published("lct_su.h5"), tmp_path / "dense.h5")
    import_scan(source, tmp_path / "a.h5", places=tmp_path / "dense.h5", point_marker=1, time_zero_s=20e-9)
    capture, counts = load(tmp_path / "a.h5")
    assert (counts.shape[0], counts.sum()) == (4096, 799_798)
    with h5py.File(published("lct_su.h5")) as file:
        all_photons = file["counts"][:]
        np.testing.assert_allclose(capture.laser_m, file["laser_position_m"][:], atol=1e-12)
    first = round(float(capture.first_bin_s[0]) / 16e-12)
    # the photons were drawn from these without putting back
    assert (counts <= all_photons[:, first : first + counts.shape[1]]).all()


def test_a_real_file_in_t2_says_what_it_holds(tmp_path):
    source = published("original/picoquant/hydraharp/v30_t2.ptu")
    with pytest.raises(DataFileError, match="is not a scan: it holds 305,565 photons on input 0; no markers"):
        import_scan(source, tmp_path / "a.h5", bin_width_s=16e-12, **GRID)


def test_the_command_takes_quantities(rig, tmp_path, events):
    ptu(tmp_path / "a.ptu", records_of(events))
    words = (
        "import a.ptu a.h5 --grid 3x3 --spacing 10cm --detector 20cm,-5cm --point-marker 1 --line-marker 2"
    )
    done = rig(*words.split(), "--time-zero", "1ns", "--order=x,y", "--snake", "--input", "0")
    assert done.code == 0, done.err
    capture, _ = load(tmp_path / "a.h5")
    np.testing.assert_allclose(capture.detector_m, [[0.2, -0.05, 0]])
    assert rig("export", "a.h5", "b.ptu").code == 0
    for option, value in [("--detector", "here"), ("--order", "z,x"), ("--grid", "3")]:
        refused = rig("import", "a.ptu", "c.h5", *words.split()[3:], option, value)
        assert (refused.code, option in refused.err) == (2, True)
