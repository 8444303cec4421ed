"""PicoQuant's older files are read as their unified successors are, or refused for what they are."""

import struct
import tracemalloc
from functools import partial

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rig.errors import DataFileError, RigError, UsageError
from rig.files.older import read_older_head
from rig.importers import LAYOUTS, import_scan
from rig.importers.options import Options
from rig.importers.recognise import recognise
from rig.importers.source import open_source
from rig.importers.tagged import Records
from support import older_picoquant_files as older
from support.picoquant_files import counts_of, ptu, scan_events
from support.published import published
from support.scan_files import load
from support.thorough import THOROUGH

GRID = {"grid": (3, 1), "spacing_m": 1e-3, "detector": "confocal"}
RECORDS = GRID | {"point_marker": 1}
FOLDER = "original/picoquant"

#: By name: what writes events as a file, and what an import needs beside.
WRITERS = {
    "1.ht3": (
        lambda events, **how: older.hydraharp(b"1.0", 3, records=older.in_t3(events, several=False), **how),
        {},
    ),
    "2.ht3": (
        lambda events, **how: older.hydraharp(b"2.0", 3, records=older.in_t3(events, several=True), **how),
        {},
    ),
    "1.ht2": (
        lambda events, **how: older.hydraharp(b"1.0", 2, records=older.in_t2(events, several=False), **how),
        {"bin_width_s": 16e-12},
    ),
    "2.ht2": (
        lambda events, **how: older.hydraharp(b"2.0", 2, records=older.in_t2(events, several=True), **how),
        {"bin_width_s": 16e-12},
    ),
    "2.pt3": (lambda events, **how: older.picoharp(3, records=older.in_picoharp_t3(events), **how), {}),
    "2.pt2": (
        lambda events, **how: older.picoharp(2, records=older.in_picoharp_t2(events), **how),
        {"bin_width_s": 16e-12},
    ),
}
CURVES = {
    "1.hhd": older.hhd,
    "2.hhd": lambda counts: older.hhd(counts, b"2.0"),
    "2.thd": lambda counts: older.thd(counts, b"2.0"),
    "3.thd": lambda counts: older.thd(counts, b"3.0"),
    "5.thd": lambda counts: older.thd(counts, b"5.0"),
    "6.thd": older.thd,
    "2.phd": older.phd,
}


def scan(name, events=None, **how):
    """Return a file of three points, and what an import of it is given."""
    write, more = WRITERS[name]
    return write(scan_events(3, 40) if events is None else events, **how), RECORDS | more


@pytest.mark.parametrize("name", WRITERS)
@settings(
    max_examples=15 if THOROUGH else 6,
    derandomize=True,
    deadline=None,
    suppress_health_check=list(HealthCheck),
)
@given(data=st.data())
def test_records_come_back_photon_for_photon(name, data, tmp_path_factory):
    folder = tmp_path_factory.mktemp("records")
    events = scan_events(3, data.draw(st.integers(1, 60)), seed=data.draw(st.integers(0, 99)))
    how = {"image": data.draw(st.lists(st.integers(0, 2**32 - 1), max_size=5))}
    if "ht" in name:
        how["inputs"] = data.draw(st.integers(0, 8))
    content, given_ = scan(name, events, **how)
    (folder / name).write_bytes(content)
    import_scan(folder / name, folder / "a.h5", **given_)
    capture, counts = load(folder / "a.h5")
    low = min(event[2] for event in events if event[1] == "photon")
    np.testing.assert_array_equal(counts, counts_of(events, range(low, low + counts.shape[1])))
    assert capture.bin_width_s == pytest.approx(16e-12, rel=1e-6)  # float32 in a PicoHarp's head
    np.testing.assert_allclose(capture.first_bin_s, low * 16e-12, rtol=1e-6)


@pytest.mark.parametrize(
    ("kind", "write"),
    [
        (0x00010303, older.in_picoharp_t3),
        (0x00010203, older.in_picoharp_t2),
        *[(kind, partial(older.in_t3, several=True)) for kind in (0x00010305, 0x00010306, 0x00010307)],
    ],
)
def test_unified_files_have_the_same_records(tmp_path, kind, write):
    events = scan_events(3, 40)
    words = np.frombuffer(write(events), "<u4")
    changes = {"TTResultFormat_TTTRRecType": kind, "MeasDesc_GlobalResolution": 4e-12}
    source = ptu(tmp_path / "a.ptu", words, **changes)
    t2 = {"bin_width_s": 16e-12} if kind == 0x00010203 else {}
    import_scan(source, tmp_path / "a.h5", **RECORDS | t2)
    counts = load(tmp_path / "a.h5")[1]
    np.testing.assert_array_equal(counts, counts_of(events, range(100, 100 + counts.shape[1])))


@pytest.mark.parametrize("name", CURVES)
@settings(
    max_examples=10 if THOROUGH else 4,
    derandomize=True,
    deadline=None,
    suppress_health_check=list(HealthCheck),
)
@given(data=st.data())
def test_curves_come_back_count_for_count(name, data, tmp_path_factory):
    folder = tmp_path_factory.mktemp("curves")
    rng = np.random.default_rng(data.draw(st.integers(0, 99)))
    counts = rng.integers(0, 2**31, (data.draw(st.integers(1, 7)), data.draw(st.integers(1, 40))))
    (folder / name).write_bytes(CURVES[name](counts))
    import_scan(folder / name, folder / "a.h5", **GRID | {"grid": (len(counts), 1)})
    capture, same = load(folder / "a.h5")
    np.testing.assert_array_equal(same, counts)
    assert capture.bin_width_s == pytest.approx(4e-12, rel=1e-6)


def test_the_first_bin_begins_where_the_file_says(tmp_path):
    (tmp_path / "a.hhd").write_bytes(older.hhd(np.ones((3, 5), int), offset_ns=20))
    report = import_scan(tmp_path / "a.hhd", tmp_path / "a.h5", **GRID)
    np.testing.assert_allclose(load(tmp_path / "a.h5")[0].first_bin_s, 20e-9)
    assert any("begins 20 ns after a sync pulse" in line for line in report.assumed)


# --- damage


def refused_or_read(source, given_):
    """Read all counts; anything but these or an error of ours that names the file fails the test."""
    try:
        with open_source(source) as opened:
            layout, options = recognise(opened, LAYOUTS), Options(**given_)
            content = layout.read(opened, options)
            rows = sum(len(block) for block in content.blocks)
    except UsageError:
        return None
    except RigError as error:
        if source.name not in str(error):
            pytest.fail(f"the error does not name the file: {error}")
        return None
    assert rows == len(content.laser_m)
    return content


def _files():
    """Return name, content, size of the head and what an import is given, of each kind of file."""
    for name in WRITERS:
        content, given_ = scan(name, scan_events(3, 4), image=(1, 2))
        yield name, content, len(scan(name, [], image=(1, 2))[0]), given_
    for name, write in CURVES.items():
        content = write(np.arange(12).reshape(3, 4))
        yield name, content, len(content) - 16, GRID


FILES = list(_files())


@pytest.mark.parametrize(("name", "content", "head", "given_"), FILES, ids=[*WRITERS, *CURVES])
def test_a_file_cut_off_anywhere_is_read_as_far_as_it_goes_or_refused(tmp_path, name, content, head, given_):
    source = tmp_path / name
    for size in range(1, len(content)):
        source.write_bytes(content[:size])
        found = refused_or_read(source, given_)
        if found is not None:
            assert any("cut off" in line for line in found.assumed), size
            assert len(found.laser_m) < 3
        assert size < len(content) - 4 or found is not None  # all but the last record or bin


#: Values that a damaged field takes, in turn or, at full length, all.
DAMAGES, EACH = (0xFFFFFFFF, 0x7FFFFFFF, 0x80000000, 0, 0x00100000), 1 if THOROUGH else 5


@pytest.mark.parametrize(("name", "content", "head", "given_"), FILES, ids=[*WRITERS, *CURVES])
def test_any_field_may_be_damaged(tmp_path, name, content, head, given_):
    source = tmp_path / name
    text = 304 if name in {"2.thd", "3.thd", "5.thd"} else 328
    tracemalloc.start()
    for at in range(text, head, 4):
        for value in DAMAGES[at // 4 % EACH :: EACH]:
            source.write_bytes(content[:at] + struct.pack("<I", value) + content[at + 4 :])
            refused_or_read(source, given_)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # an import holds a block of counts (32 MiB at most), pieces of records (14 MiB) and what it imports
    assert peak < 128e6


@pytest.mark.parametrize(
    ("start", "said"),
    [
        (
            b"HydraHarp\0\0\0\0\0\0\x003.0\0\0\0",
            "HydraHarp in .* older format 3.0; of it, 1.0 and 2.0 are read",
        ),
        (b"TimeHarp 100\0\0\0\x006.0\0\0\0", "TimeHarp 100 in .* older format 6.0; it is not read"),
        (b"PicoHarp 300\0\0\0\0", r"PicoHarp 300 in .* older format \(none\); of it, 2.0 are read"),
    ],
)
def test_what_is_not_known_is_named(tmp_path, start, said):
    (tmp_path / "a.ht3").write_bytes(start + bytes(1000))
    with pytest.raises(DataFileError, match=said):
        import_scan(tmp_path / "a.ht3", tmp_path / "a.h5", **RECORDS)


# --- files of real instruments


@pytest.mark.parametrize(
    ("name", "said"),
    [
        # photon for photon what libpicoquant makes of them: 19 and 32
        (
            "hydraharp/v10.ht2",
            "2 photons on input 0; 4 photons on input 1; 6 photons on input 2; 7 photons on",
        ),
        (
            "hydraharp/v10.ht3",
            "6 photons on input 0; 9 photons on input 1; 3 photons on input 2; 14 photons on",
        ),
        ("timeharp/v20.thd", "its curves differ in number or width of bins"),
        ("timeharp/v60.thd", "its curves differ in number or width of bins"),
        ("timeharp/v50.t3r", "holds records of a TimeHarp 200"),
    ],
)
def test_real_files_that_are_no_scans_say_what_they_hold(tmp_path, name, said):
    source = published(f"{FOLDER}/{name}")
    with pytest.raises(DataFileError, match=said):
        import_scan(source, tmp_path / "a.h5", bin_width_s=16e-12, **RECORDS)


def test_the_times_of_a_real_ht2_count_half_picoseconds():
    head = read_older_head(published(f"{FOLDER}/hydraharp/v10.ht2"))
    [(batch, _, _)] = Records.of(head).batches(1e-12)
    assert head.values["MeasDesc_GlobalResolution"] == 0.5e-12
    # first and last photon of the 19 that libpicoquant decodes, in ps
    assert (batch.tag[[0, -1]] // 2).tolist() == [12_588_053, 97_061_834]
    assert (batch.channel[0], batch.channel[-1], batch.photons) == (1, 0, 19)


def test_a_real_ht3_is_decoded_as_by_others():
    head = read_older_head(published(f"{FOLDER}/hydraharp/v10.ht3"))
    [(batch, dtime, _)] = Records.of(head).batches(1e-12)
    assert (head.values["MeasDesc_Resolution"], batch.photons) == (4e-12, 32)
    # input, pulse and ps of the first three photons as libpicoquant decodes them
    first = np.column_stack([batch.channel, batch.tag, 4 * dtime.astype(int)])[:3].tolist()
    assert first == [[0, 5425, 81_920], [3, 18_404, 69_612], [3, 24_332, 55_816]]


@pytest.mark.parametrize(
    ("name", "curves", "before"),
    [("hydraharp/v10.hhd", 8, 0), ("timeharp/mn_IRF.thd", 4, 16), ("timeharp/v30.thd", 1, 16)],
)
def test_real_curves_have_as_many_photons_as_their_heads_say(tmp_path, name, curves, before):
    source = published(f"{FOLDER}/{name}")
    import_scan(source, tmp_path / "a.h5", **GRID | {"grid": (curves, 1)})
    counts, content = load(tmp_path / "a.h5")[1], source.read_bytes()
    if before:  # a TimeHarp's sum lies shortly before the counts of each curve
        size = 4 * counts.shape[1] + 100
        ends = len(content) - size * np.arange(curves, 0, -1) + 100
        said = [struct.unpack_from("<i", content, end - before)[0] for end in ends]
    else:  # a HydraHarp describes all curves first, and ends with sum, number of bins and place
        first = len(content) - 4 * counts.size
        said = [struct.unpack_from("<q", content, first - 264 * n - 16)[0] for n in range(curves - 1, -1, -1)]
    assert counts.sum(axis=1).tolist() == said
    assert counts.sum() > 0
