"""No file crashes a reader, keeps it for ever, or leads it elsewhere: a short attack, and what was found."""

import os
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import h5py
import numpy as np
import pytest

from attacks.files import PARSERS, attack, read_scan, scan_file
from rig.errors import DataFileError
from rig.files.trial import tried
from support import tried as doing
from support.thorough import some

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="the attack's workers are forked")

REPRO = Path(os.environ.get("RIG_TEST_FAULTS") or Path(__file__).parents[3] / "shared" / "faults" / "repro")


@pytest.mark.parametrize("parser", PARSERS)
def test_readers_read_or_refuse(parser):
    assert attack(parser, 20) == []


def plain_file(folder):
    (folder / "good.txt").write_bytes(bytes(100))
    return folder / "good.txt"


@pytest.mark.parametrize(
    ("read", "what", "deadline_s"),
    [
        (doing.die, "the process died: -", 20.0),
        (doing.swallow, "MemoryError", 20.0),
        (doing.turn, "longer than 0.5 s", 0.5),
        (lambda path: 1 // 0, "ZeroDivisionError", 20.0),
    ],
)
def test_an_attack_finds_what_must_not_be(monkeypatch, read, what, deadline_s):
    def sometimes(path):
        if path.parent.name == "1":
            read(path)

    monkeypatch.setitem(PARSERS, "planted", (plain_file, sometimes))
    found = attack("planted", 3, deadline_s=deadline_s)
    assert [one.seed for one in found] == [1]
    assert what in found[0].what


@pytest.mark.parametrize(
    ("trial", "outcome"),
    [
        (doing.die, "refused"),
        (doing.swallow, "refused"),
        (doing.turn, "refused"),
        (doing.size, "read"),
    ],
)
def test_trials_that_share_a_process_spoil_no_other(monkeypatch, trial, outcome):
    def sometimes(path):
        assert tried(path, trial if path.parent.name == "1" else doing.size) > 0

    told = Counter()
    monkeypatch.setitem(PARSERS, "planted", (plain_file, sometimes))
    assert attack("planted", 4, told=told) == []
    assert told == Counter(["read"] * 3 + [outcome])


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    return scan_file(tmp_path_factory.mktemp("good"))


def edited(good, tmp_path, edit):
    path = tmp_path / "edited.h5"
    path.write_bytes(good.read_bytes())
    with h5py.File(path, "r+") as file:
        edit(file)
    return path


def external_link(file):
    del file["geometry/laser_m"]
    file["geometry/laser_m"] = h5py.ExternalLink("other.h5", "/x")


def external_storage(file):
    del file["geometry/laser_m"]
    file.create_dataset("geometry/laser_m", (40, 3), "f8", external=[("other.bin", 0, 960)])


def virtual(file):
    del file["geometry/laser_m"]
    layout = h5py.VirtualLayout((40, 3), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "x", (40, 3))
    file.create_virtual_dataset("geometry/laser_m", layout)


def two_deflates(file):
    del file["geometry/laser_m"]
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plist.set_chunk((40, 3))
    plist.set_deflate(9)
    plist.set_deflate(9)
    space = h5py.h5s.create_simple((40, 3))
    h5py.h5d.create(file["geometry"].id, b"laser_m", h5py.h5t.IEEE_F64LE, space, plist)


def large_chunk(file):
    del file["geometry/laser_m"]
    file.create_dataset("geometry/laser_m", (2**24, 3), "f8", chunks=(2**24, 3))


def short_chunk(file):
    file["transients/counts"].id.write_direct_chunk((0, 0, 0), b"\x78\x9c\x03\x00\x00\x00\x00\x01")


def unwritten(file):
    counts = file["transients/counts"]
    kept, chunks = dict(counts.attrs), counts.chunks
    del file["transients/counts"]
    file.create_dataset("transients/counts", (40, 1, 400), "u4", chunks=chunks).attrs.update(kept)


def endless(file):
    file["transients/live_time_s"][3] = np.inf


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (endless, "live_time_s of step 3 is inf, which is not a time"),
        (external_link, "is a link to another file"),
        (external_storage, "keeps its values in another file"),
        (virtual, "put together from other files"),
        (two_deflates, "filters"),
        (large_chunk, "chunks of 402653184 bytes"),
        (short_chunk, "a chunk"),
        (unwritten, "chunks of 0 bytes were written"),
    ],
)
def test_what_is_refused_and_why(good, tmp_path, edit, said):
    path = edited(good, tmp_path, edit)
    with pytest.raises(DataFileError, match=said) as caught:
        read_scan(path)
    assert "edited.h5" in str(caught.value)


#: Layouts whose counts are read in parts, and what these are called. Counts of others are read at once, and
#: no more than a file of its size can hold.
COUNTS = {"tal": "H", "neutral": "counts", "znlos": "data", "liu2019": "dataset/data", "dirac": "data_t"}
COUNTS |= {"lct": "rect_data", "aligned": "final_meas"}
#: Where their number of bins is also that of another array, and the places of some layouts.
BINS = {"neutral": "time_s", "dirac": "da"}
PLACES = {"tal": "sensor_grid_xyz", "neutral": "laser_position_m", "znlos": "cameraGridPositions"}
PLACES |= {"liu2019": "dataset/laserPos", "dirac": "xg", "cmu": "lighting"}


def test_an_attribute_that_cannot_be_opened_hides_others(good, tmp_path):
    """Listed, none of them can be opened; by name, those before it can, and the value of one was a crash."""
    content = bytearray(good.read_bytes())
    name = content.index(b"software\0")
    content[name - 4 : name - 2] = b"\xff\xff"  # the size of its type
    path = tmp_path / "edited.h5"
    path.write_bytes(content)
    with pytest.raises(DataFileError, match=r"edited\.h5 is damaged: an attribute of / cannot be opened"):
        read_scan(path)


def example(layout, folder):
    """Return a good HDF5 file of a layout, what reads it, and the name of its counts."""
    make, read = PARSERS[f"import-{layout}"]
    return make(folder), read, COUNTS[layout]


@pytest.mark.parametrize(("chunked", "written"), [(True, False), (True, True), (False, False)])
@pytest.mark.parametrize("layout", COUNTS)
def test_an_import_of_what_was_never_written(tmp_path, layout, chunked, written):
    path, read, name = example(layout, tmp_path)
    with h5py.File(path, "r+") as file:
        bins = 2**31 if layout not in BINS else 2**20 if chunked else 2**24
        if layout in BINS:
            del file[BINS[layout]]
            file[BINS[layout]] = 1e-12 * np.arange(bins)
        times, shape = 1 if layout in {"neutral", "znlos"} else 0, file[name].shape
        del file[name]
        endless = (*shape[:times], bins, *shape[times + 1 :])
        chunks = tuple(min(size, 64) for size in endless)
        file.create_dataset(name, endless, "i8", chunks=chunks if chunked else None)
        if written:
            file[name][tuple(map(slice, chunks))] = 1
    began_s = time.monotonic()
    with pytest.raises(DataFileError, match="written"):
        read(path)
    assert time.monotonic() - began_s < 5


@pytest.mark.parametrize("chunked", [True, False])
@pytest.mark.parametrize(
    ("layout", "axis"), [("lct", 2), ("lct", 1), ("aligned", 2), ("znlos", 2), ("tal", 1)]
)
def test_an_import_of_places_and_bounces_that_were_never_written(tmp_path, layout, axis, chunked):
    path, read, name = example(layout, tmp_path)
    with h5py.File(path, "r+") as file:
        shape = list(file[name].shape)
        shape[axis] = 2**40
        del file[name]
        chunks = tuple(min(size, 64) for size in shape) if chunked else None
        file.create_dataset(name, shape, "u1", chunks=chunks)
    with pytest.raises(DataFileError, match="written"):
        read(path)


def of_no_computer():
    """Return a floating-point type with an exponent of 20 bits."""
    kind = h5py.h5t.IEEE_F64LE.copy()
    kind.set_fields(63, 43, 20, 0, 43)
    return kind


@pytest.mark.parametrize(
    ("layout", "name"), [*COUNTS.items(), ("tal", "sensor_grid_xyz"), ("znlos", "cameraGridPositions")]
)
def test_a_number_type_of_no_computer_is_refused(tmp_path, layout, name):
    path, read, _ = example(layout, tmp_path)
    with h5py.File(path, "r+") as file:
        shape = file[name].shape
        del file[name]
        h5py.h5d.create(file.id, name.encode(), of_no_computer(), h5py.h5s.create_simple(shape))
    with pytest.raises(DataFileError, match=path.name):
        read(path)


@pytest.mark.parametrize("layout", PLACES)
def test_places_that_no_room_has_are_refused(tmp_path, layout):
    make, read = PARSERS[f"import-{layout}"]
    path = make(tmp_path)
    with h5py.File(path, "r+") as file:
        file[PLACES[layout]][...] = 1e308
    with pytest.raises(DataFileError, match=f"{path.name}: .* m away"):
        read(path)


@pytest.mark.parametrize(
    ("layout", "name", "value"),
    [
        ("znlos", "laserGridPositions", 0.0),  # of a confocal scan: read, but not used
        ("znlos", "laserGridPositions", np.zeros((5, 4))),
        ("znlos", "cameraGridNormals", np.zeros(10)),
        ("znlos", "cameraGridNormals", np.zeros((3, 2, 5), "S9")),
        ("dirac", "offset_laser", b"none"),
    ],
)
def test_an_array_of_another_kind_is_refused(tmp_path, layout, name, value):
    path, read, _ = example(layout, tmp_path)
    with h5py.File(path, "r+") as file:
        del file[name]
        file[name] = value
    with pytest.raises(DataFileError, match=name):
        read(path)


def test_a_file_that_cannot_be_read_is_refused_once(tmp_path):
    path = tmp_path / "a.h5"
    path.write_bytes(b"x")
    began_s = time.monotonic()
    for function, said in (
        (doing.die, "crashed"),
        (doing.swallow, "memory"),
        (doing.turn, "did not end"),
    ):
        with pytest.raises(DataFileError, match=said):
            tried(path, function)
    assert time.monotonic() - began_s < 30


@pytest.mark.parametrize("name", ["power-0.h5", "scan-bytes-c84796d8.h5", "volume-struct-28003048.h5"])
@pytest.mark.parametrize("verb", ["stats", "plot", "measure", "resume"])
def test_files_that_looped_or_crashed(rig, name, verb):
    if not (REPRO / name).exists():
        pytest.skip(f"{name} is not in {REPRO}")
    began_s = time.monotonic()
    done = rig(verb, REPRO / name)
    assert done.code == 5
    assert done.err.count("\n") == 1
    assert time.monotonic() - began_s < 15


@pytest.mark.parametrize(
    "name", ["importers-29149906.mat", "importers-16e3e12c.h5", "importers-b81d2b70.mat"]
)
def test_imports_that_crashed(rig, name):
    if not (REPRO / name).exists():
        pytest.skip(f"{name} is not in {REPRO}")
    done = rig("import", REPRO / name, "out.h5", "--bin-width", "4ps")
    assert done.code == 5
    assert done.err.count("\n") == 1
    assert not Path("out.h5").exists()


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not take such names")
def test_a_name_that_is_no_text(good, tmp_path):
    folder = os.fsencode(tmp_path)
    named = os.path.join(folder, b"a\xff.h5")
    Path(os.fsdecode(named)).write_bytes(good.read_bytes())
    for verb in some("recon", "resume", "stats", "plot", "measure", short=2):
        done = subprocess.run(
            [sys.executable, "-m", "rig", verb, named],
            cwd=tmp_path,
            capture_output=True,
            check=False,
            env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])},
        )
        assert b"Traceback" not in done.stderr, done.stderr
