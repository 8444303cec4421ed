"""No file crashes a reader, keeps it for ever, or leads it elsewhere: a short attack, and what was found."""

import os
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from attacks.files import PARSERS, attack, import_as_it_is, read_scan, scan_file, tal_file
from rig.errors import DataFileError
from rig.files.trial import tried
from support import tried as doing

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


@pytest.mark.parametrize(("chunks", "written"), [((64, 12), 0), ((64, 12), 1), (None, 0)])
def test_an_import_of_what_was_never_written(tmp_path, chunks, written):
    path = tal_file(tmp_path)
    with h5py.File(path, "r+") as file:
        del file["H"]
        file.create_dataset("H", (2**31, 12), "i8", chunks=chunks)
        if written:
            file["H"][:64] = 1
    began_s = time.monotonic()
    with pytest.raises(DataFileError, match="written"):
        import_as_it_is(path)
    assert time.monotonic() - began_s < 5


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
    for verb in ("stats", "plot", "resume", "recon", "measure"):
        done = subprocess.run(
            [sys.executable, "-m", "rig", verb, named],
            cwd=tmp_path,
            capture_output=True,
            check=False,
            env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])},
        )
        assert b"Traceback" not in done.stderr, done.stderr
