"""A scan file is right wherever an exception comes, wherever writing fails, and whatever reached the disk."""

import json
import linecache
import os
import random
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

import h5py
import numpy as np
import pytest

from rig.errors import DataFileError, RefusedError, UsageError
from rig.files import ScanDescription, ScanFile, ScanWriter, form_counts, form_photons
from rig.files import content as content_module
from rig.files import journal as journal_module
from rig.files import writer as writer_module
from rig.files.journal import journal_of
from support.thorough import THOROUGH, some

POSITIONS, BINS, LINE = 40, 130, 7
CHUNK_PHOTONS = 1024
#: What a disk writes at once or not at all.
PAGE = 4096
#: Set to any word, these tests try everything; without it, samples.


@pytest.fixture(params=["histograms", "photons"], scope="module")
def form(request):
    """Each test writes files of either form."""
    return request.param


@pytest.fixture(autouse=True)
def _written_within_lines(monkeypatch):
    """Write each chunk as soon as it is whole, as far longer lines do."""
    monkeypatch.setattr(form_photons, "GATHERED_CHUNKS", 1)


def row(position):
    return np.random.default_rng([3, position]).poisson(120 / BINS, BINS).astype("u4")


def photons(position):
    """The same photons one by one, as they came."""
    bins = np.repeat(np.arange(BINS, dtype="u2"), row(position))
    return np.random.default_rng([4, position]).permutation(bins)


def add(writer, position):
    if writer.tagged:
        bins = photons(position)
        writer.append_photons(bins, np.array([len(bins)]), 0.01)
    else:
        writer.append(row(position), 0.01)


def measure(writer, done):
    """Do as the scan engine does: what does not count, because it was not recorded, is withdrawn."""
    status = "failed"
    try:
        while done < POSITIONS:
            if done in {3, 4, 5, 20}:
                writer.note("a bin is full", done, done)
            add(writer, done)
            done += 1
            if done % LINE == 0:
                writer.checkpoint()
        status = "complete"
    finally:
        writer.withdraw(done)
        writer.close(status)


def create(path, form):
    description = ScanDescription(
        np.zeros((POSITIONS, 3)), np.zeros((1, 3)), BINS, 4e-12, 0.0, tagged=form == "photons"
    )
    # the 4800 photons are of several chunks, as those of a scan are
    with patch.object(form_photons, "CHUNK_PHOTONS", CHUNK_PHOTONS):
        return ScanWriter.create(path, description)


def measured_and_right(path):
    """Return how many positions are marked; each of them has its counts."""
    with ScanFile(path) as scan:
        measured = np.flatnonzero(scan.done)
        assert not scan.altered.any()
        if len(measured):
            for where, block in scan.capture().histograms.blocks():
                for position, counts in zip(measured[where], block, strict=True):
                    np.testing.assert_array_equal(counts, row(position))
        if scan.status == "complete":
            assert len(measured) == POSITIONS
        return len(measured)


def assert_right(path):
    """Every mark has its counts, and resuming gives the file of an uninterrupted scan."""
    measured = measured_and_right(path)
    try:
        again = ScanWriter.resume(path)
    except UsageError:
        assert measured == POSITIONS
    else:
        assert again.appended == measured
        measure(again, again.appended)
    assert not journal_of(path).exists()
    with h5py.File(path) as file:
        transients = file["transients"]
        assert_all_there(transients)
        np.testing.assert_array_equal(transients["live_time_s"][()], np.full(POSITIONS, 0.01, "f4"))
        assert transients["done"][()].all()
        assert file["stop"].attrs["status"] == "complete"
        assert file["stop"].attrs["photons"] == sum(int(row(n).sum()) for n in range(POSITIONS))
        noted = {n for one in file["events"][()] for n in range(one["first"], one["last"] + 1)}
        assert noted == {3, 4, 5, 20}
    return measured


def assert_all_there(transients):
    """The whole scan is in the file, as other programs read it."""
    if "counts" in transients:
        np.testing.assert_array_equal(transients["counts"][:, 0], [row(n) for n in range(POSITIONS)])
        return
    offset = np.cumsum([0, *(int(row(n).sum()) for n in range(POSITIONS))])
    np.testing.assert_array_equal(transients["photon_offset"][()], offset)
    np.testing.assert_array_equal(
        transients["photons"][()], np.concatenate([photons(n) for n in range(POSITIONS)])
    )


class At:
    """Raises at the n-th executed line of what writes scan files; keeps the lines' places."""

    FILES = tuple(
        module.__file__
        for module in (writer_module, journal_module, content_module, form_counts, form_photons)
    )

    def __init__(self, number):
        self.number, self.places = number, []

    def __call__(self, frame, event, argument):
        # what an exception raises in a destructor is lost, and so is the test's
        destructor = "__del__" in {frame.f_code.co_name, frame.f_back.f_code.co_name}
        return None if destructor or frame.f_code.co_filename not in self.FILES else self.line

    def line(self, frame, event, argument):
        if event == "line":
            self.places.append((frame.f_code.co_filename, frame.f_lineno))
            if len(self.places) - 1 == self.number:
                sys.settrace(None)
                raise KeyboardInterrupt
        return self.line


def interrupt_at(path, form, number):
    at = At(number)
    writer = create(path, form)
    try:
        sys.settrace(at)
        measure(writer, 0)
    except KeyboardInterrupt:
        pass
    finally:
        sys.settrace(None)
    return at.places


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # files left to the collector
def test_an_interrupt_at_any_line_of_the_writer_leaves_no_wrong_mark(tmp_path, form):
    places = interrupt_at(tmp_path / "whole.h5", form, None)
    assert_right(tmp_path / "whole.h5")
    first = {place: number for number, place in reversed(list(enumerate(places)))}
    last = {place: number for number, place in enumerate(places)}
    some = {(first if place[1] % 2 else last)[place] for place in first}
    # most lines are passed with both forms: each has an eighth of them, in turn
    tried = range(len(places)) if THOROUGH else sorted(some)[4 * (form == "photons") :: 8]
    kept = []
    for number in tried:
        path = tmp_path / f"{number}.h5"
        interrupt_at(path, form, number)
        kept.append(assert_right(path))
        path.unlink()
    assert max(kept) == POSITIONS
    print(f"{len(tried)} of {len(places)} executed lines")


class States:
    """Keeps what the two files held at each line of what writes them, and how often each was made permanent.

    Before an fsync any page may be on the disk as any write left it, whatever was written later.
    """

    def __init__(self, path):
        self.files = (path, journal_of(path))
        self.kept = []  # for each moment: the bytes of both files, None where there is none
        self.permanent = []  # for each moment: since which moment nothing older can be on the disk
        self.since = [0, 0]
        self.safe = []
        self.writer = None

    def __call__(self, frame, event, argument):
        ours = frame.f_code.co_filename in At.FILES and "__del__" not in frame.f_back.f_code.co_name
        return self.line if ours else None

    def line(self, frame, event, argument):
        held = tuple(path.read_bytes() if path.exists() else None for path in self.files)
        if self.kept and held == self.kept[-1]:
            # a line that syncs is followed by another one, with nothing written in between
            self.synced(frame)
            return self.line
        self.kept.append(held)
        self.permanent.append(tuple(self.since))
        self.safe.append(self.writer.safe if self.writer else 0)
        self.synced(frame)
        return self.line

    def synced(self, frame):
        source = linecache.getline(frame.f_code.co_filename, frame.f_lineno)
        which = {"os.fsync(closed.fileno())": 0, "os.fsync(self.descriptor)": 1}.get(source.strip())
        if which is not None:
            self.since[which] = len(self.kept) - 1

    def after_a_power_cut(self, moment, rng):
        """Return what the disk may hold of both files if the power fails then, pages mixed at random."""
        held = []
        for which in range(2):
            past = [state[which] for state in self.kept[self.permanent[moment][which] : moment + 1]]
            if past[-1] is None:
                held.append(None)
                continue
            past = [state for state in past if state is not None]
            size = len(rng.choice(past)) if rng.random() < 0.7 else rng.randint(len(past[0]), len(past[-1]))
            pages = [
                rng.choice(past)[at : at + PAGE].ljust(PAGE, b"\0") for at in range(0, max(size, 1), PAGE)
            ]
            held.append(b"".join(pages)[:size])
        return held


@pytest.fixture(scope="module")
def states(tmp_path_factory, form):
    path = tmp_path_factory.mktemp("states") / "scan.h5"
    kept = States(path)
    kept.writer = create(path, form)
    # of what `create` wrote the journal alone was made permanent
    try:
        sys.settrace(kept)
        measure(kept.writer, 0)
    finally:
        sys.settrace(None)
    return kept


def test_after_a_power_cut_all_that_was_saved_is_there(states, tmp_path):
    rng, path = random.Random(1), tmp_path / "scan.h5"
    moments = [moment for moment in range(len(states.kept)) for _ in range(40 if THOROUGH else 2)]
    for moment in moments:
        for file, content in zip(
            (path, journal_of(path)), states.after_a_power_cut(moment, rng), strict=True
        ):
            file.unlink(missing_ok=True)
            if content is not None:
                file.write_bytes(content)
        assert states.safe[moment] <= assert_right(path)
    print(f"{len(moments)} power cuts at {len(states.kept)} moments")


def test_a_journal_cut_anywhere_gives_its_whole_records(states, tmp_path):
    path = tmp_path / "scan.h5"
    whole, journal = next(held for held in reversed(states.kept) if None not in held)
    head = states.kept[0][1]
    rng = random.Random(2)
    kept = []
    lengths = sorted(rng.randrange(len(head), len(journal)) for _ in range(300 if THOROUGH else 20))
    for length in lengths:
        path.write_bytes(whole[: rng.randrange(len(whole))])  # the HDF5 file may be in any state
        journal_of(path).write_bytes(journal[:length])
        kept.append(measured_and_right(path))
        with ScanFile(path) as scan:
            assert "read from its journal" in scan.doubts[0]
        noted_or_not(path)
    assert kept == sorted(kept)
    assert kept[0] < LINE * 2 < kept[-1]


def noted_or_not(path):
    """The scan goes on; what was noted in what was cut off is not known any more."""
    with ScanWriter.resume(path) as again:
        for position in range(again.appended, POSITIONS):
            add(again, position)
    assert measured_and_right(path) == POSITIONS


def test_a_flipped_bit_in_the_journal_is_never_taken_for_data(states, tmp_path):
    path = tmp_path / "scan.h5"
    whole, journal = next(held for held in reversed(states.kept) if None not in held)
    head, rng = len(states.kept[0][1]), random.Random(3)
    for _ in range(300 if THOROUGH else 20):
        flipped = bytearray(journal)
        flipped[rng.randrange(head, len(journal))] ^= 1 << rng.randrange(8)
        path.write_bytes(whole)
        journal_of(path).write_bytes(flipped)
        measured_and_right(path)
        noted_or_not(path)


def test_an_altered_chunk_is_not_measured_and_is_measured_again(states, tmp_path):
    path, rng = tmp_path / "scan.h5", random.Random(4)
    whole = states.files[0].read_bytes()
    with h5py.File(states.files[0]) as file:
        chunks = file["transients"].get("counts", file["transients"].get("photons"))
        places = [chunks.id.get_chunk_info(number) for number in range(chunks.id.get_num_chunks())]
        ends = file["transients/photon_offset"][1:] if "photons" in file["transients"] else None
    assert len(places) >= 3
    for number in range(30 if THOROUGH else 6):
        altered = bytearray(whole)
        chunk = places[number % len(places)]
        altered[chunk.byte_offset + rng.randrange(chunk.size)] ^= 1 << rng.randrange(8)
        path.write_bytes(altered)
        first, last = chunk.chunk_offset[0], min(chunk.chunk_offset[0] + 16, POSITIONS) - 1
        if ends is not None:  # the steps that have a photon in the chunk
            begin = chunk.chunk_offset[0]
            first, last = np.searchsorted(ends, [begin + 1, min(begin + CHUNK_PHOTONS, ends[-1])])
        with ScanFile(path) as scan:
            assert np.flatnonzero(scan.altered).tolist() == list(range(first, last + 1))
            assert f"positions {first} to {last} changed after they were written" in scan.doubts[0]
            measured = np.flatnonzero(scan.done)
            for where, block in scan.capture().histograms.blocks():
                for position, counts in zip(measured[where], block, strict=True):
                    np.testing.assert_array_equal(counts, row(position))
        with ScanWriter.resume(path) as again:
            assert again.appended == first
            measure(again, first)
        assert measured_and_right(path) == POSITIONS
        # what was right behind the altered chunk is measured again, too, but was not thrown away
        kept = [one.read_bytes() for one in tmp_path.glob("scan-as-found*.h5")]
        assert (bytes(altered) in kept) == (last < POSITIONS - 1)


@pytest.mark.skipif(sys.platform != "linux", reason="an open file's new name is found as Linux tells it")
def test_a_file_moved_under_the_scan_ends_it_and_is_closed_where_it_is(tmp_path, form):
    path, elsewhere = tmp_path / "scan.h5", tmp_path / "other" / "renamed.h5"
    elsewhere.parent.mkdir()
    writer = create(path, form)
    for position in range(10):
        add(writer, position)
    writer.checkpoint()
    path.rename(elsewhere)
    add(writer, 10)
    with pytest.raises(DataFileError, match=r"was moved to .*renamed\.h5.*rig resume"):
        writer.checkpoint()
    writer.close("failed")
    assert not path.exists()
    assert not journal_of(path).exists()
    assert measured_and_right(elsewhere) == 11


def test_a_file_renamed_without_its_journal_is_reported(tmp_path, form):
    path, renamed = tmp_path / "scan.h5", tmp_path / "renamed.h5"
    writer = create(path, form)
    for position in range(POSITIONS):
        add(writer, position)
        if position == POSITIONS - 2:
            writer.checkpoint()
            shutil.copy(path, renamed)  # as a program that is killed here leaves both
            shutil.copy(journal_of(path), tmp_path / "aside")
    writer.close("complete")
    with ScanFile(path) as whole:
        assert whole.doubts == []
    with ScanFile(renamed) as scan:
        (said,) = scan.doubts
    assert "renamed.h5.journal is not in the same folder" in said
    (tmp_path / "aside").rename(journal_of(renamed))
    with ScanFile(renamed) as scan:
        assert "is read from its journal" in scan.doubts[0]
        assert scan.done.sum() == POSITIONS - 1


@pytest.mark.skipif(sys.platform == "win32", reason="Windows does not delete an open file")
@pytest.mark.parametrize("also_the_journal", [False, True])
def test_a_file_deleted_under_the_scan_is_saved_under_another_name(tmp_path, form, also_the_journal):
    path = tmp_path / "scan.h5"
    writer = create(path, form)
    for position in range(10):
        add(writer, position)
    writer.checkpoint()
    path.unlink()
    if also_the_journal:
        journal_of(path).unlink()
    add(writer, 10)
    with pytest.raises(DataFileError, match=r"scan\.h5 was deleted.*saved as .*scan-saved\.h5"):
        writer.checkpoint()
    writer.close("failed")
    assert sorted(one.name for one in tmp_path.iterdir()) == ["scan-saved.h5"]
    assert measured_and_right(tmp_path / "scan-saved.h5") == 11


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no lock on the journal")
def test_a_scan_that_is_being_written_is_read_up_to_its_last_checkpoint_and_not_taken_up(tmp_path, form):
    path = tmp_path / "scan.h5"
    with create(path, form) as writer:
        with ScanFile(path) as scan, pytest.raises(DataFileError, match="no measured position yet"):
            scan.capture()
        for position in range(20):
            add(writer, position)
            if position in {4, 17}:
                writer.checkpoint()
                assert measured_and_right(path) == position + 1
                with ScanFile(path) as scan:
                    assert (scan.status, scan.reason, scan.growing) == ("running", "", True)
                    assert "being written by a scan" in scan.mended
        writer.withdraw(10)
        assert measured_and_right(path) == 10
        with pytest.raises(DataFileError, match="being written by another program"):
            ScanWriter.resume(path)
    with ScanFile(path) as scan:
        assert (scan.status, scan.growing, scan.mended) == ("interrupted", False, "")
        assert scan.done.sum() == 10


def test_a_journal_without_its_file_is_a_scan(states, tmp_path, form):
    path = tmp_path / "scan.h5"
    journal_of(path).write_bytes(next(held for held in reversed(states.kept) if None not in held)[1])
    with pytest.raises(UsageError, match=r"journal exists.*rig resume"):
        create(path, form)
    assert measured_and_right(path) == POSITIONS
    assert assert_right(path) == POSITIONS


def in_a_process_of_its_own(fault, folder, form, numbers):
    """Measure a file for each number, each with its fault; return the errors."""
    here = Path(__file__)
    code = f"import sys; sys.path[:0] = {[str(here.parent), *sys.path]}; import {here.stem} as t; "
    code += f"t.measure_with(t.{fault.__name__}, {str(folder)!r}, {form!r}, {list(numbers)})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def measure_with(fault, folder, form, numbers):
    errors = []
    for number in numbers:
        writer = create(Path(folder) / f"{number}.h5", form)
        try:
            measure(fault(writer, number), 0)
            errors.append("")
        except DataFileError as error:
            errors.append(str(error))
    print(json.dumps(errors), flush=True)


def limited(writer, number):
    """Let no file grow by more than ``number`` bytes: the system answers as it does for a quota."""
    import resource

    size = max(writer.path.stat().st_size, journal_of(writer.path).stat().st_size)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size + number, resource.RLIM_INFINITY))
    return writer


@pytest.mark.skipif(sys.platform != "linux", reason="the limit on a file's size is Linux's here")
def test_a_file_that_may_not_grow_ends_the_scan_with_what_was_measured(tmp_path, form):
    most = {"histograms": 20_000, "photons": 40_000}[form]  # bytes that are enough for all
    limits = range(0, most, most // (200 if THOROUGH else 20))
    errors = in_a_process_of_its_own(limited, tmp_path, form, limits)
    kept = []
    for limit, error in zip(limits, errors, strict=True):
        path = tmp_path / f"{limit}.h5"
        assert error == "" or re.search("cannot write .*File too large.*rig resume", error)
        assert (error == "") == (not journal_of(path).exists())
        kept.append(measured_and_right(path))
        if error:  # as much as was promised; more where a chunk filled up since
            assert int(re.search(r"first (\d+) of 40 positions are safe", error)[1]) <= kept[-1]
        assert_right(path)
    assert kept == sorted(kept)
    assert len(set(kept)) > 2
    assert kept[-1] == POSITIONS


@pytest.fixture
def small_disk(tmp_path):
    """A disk of half a megabyte; only root can have one."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=512k", "tmpfs", str(folder)]
    if not shutil.which("mount") or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("this user cannot mount a small disk")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def measured_on_a_full_disk(path, form):
    """Measure; return what went wrong."""
    try:
        measure(create(path, form), 0)
    except (UsageError, DataFileError) as error:
        return str(error)
    return ""


def test_a_disk_that_is_full_at_any_level_loses_nothing_that_was_saved(
    small_disk, tmp_path, form, monkeypatch
):
    path, hog = small_disk / "scan.h5", small_disk / "hog"
    kept = []
    for free in range(28, 72, 4):
        hog.write_bytes(bytes(2**19 - free * 1024))
        with monkeypatch.context() as patched:
            # as if another program filled the disk after each look at it
            patched.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(free=10**12))
            error = measured_on_a_full_disk(path, form)
            assert not error or "No space left" in error
            if "cannot create" in error:
                assert [one.name for one in small_disk.iterdir()] == ["hog"]
                kept.append(-1)
                continue
            if error:
                with pytest.raises(DataFileError, match="No space left"):
                    ScanWriter.resume(path)
        kept.append(measured_and_right(path))
        assert kept[-1] == POSITIONS or kept[-1] >= int(re.search(r"first (\d+) of 40", error)[1])
        if error:
            with pytest.raises(RefusedError, match="was not changed"):
                ScanWriter.resume(path)
            assert measured_and_right(path) == kept[-1]
        for file in filter(Path.exists, (path, journal_of(path))):  # where there is room
            shutil.move(file, tmp_path / file.name)
        assert [one.name for one in small_disk.iterdir()] == ["hog"]
        assert_right(tmp_path / path.name)
        (tmp_path / path.name).unlink()
    print("positions kept at each level, -1 where no file could be begun:", *kept)
    assert kept == sorted(kept)
    assert kept[0] == -1
    assert kept[-1] == POSITIONS
    assert len(set(kept)) > 3


class Unplugged:
    """A writer whose disk turns read-only before its n-th position."""

    def __init__(self, writer, number):
        self.writer, self.left = writer, number

    def append(self, *step):
        self.unplug()
        self.writer.append(*step)

    def append_photons(self, *step):
        self.unplug()
        self.writer.append_photons(*step)

    def unplug(self):
        if self.left == 0:
            for path in (self.writer.path, journal_of(self.writer.path)):
                named = str(path.resolve())
                (ours,) = (n for n in Path("/proc/self/fd").iterdir() if os.path.realpath(n) == named)
                os.dup2(os.open(path, os.O_RDONLY), int(ours.name))
        self.left -= 1

    def __getattr__(self, name):
        return getattr(self.writer, name)


@pytest.mark.skipif(sys.platform != "linux", reason="open files are found as Linux names them")
@pytest.mark.parametrize("number", some(0, 20, 33, 10, 23, 39, short=3))
def test_after_writing_failed_the_file_is_as_it_was_saved_last(tmp_path, form, number):
    (error,) = in_a_process_of_its_own(Unplugged, tmp_path, form, [number])
    assert re.search("cannot write .*Bad file descriptor.*rig resume", error)
    kept = assert_right(tmp_path / f"{number}.h5")
    # the last line's end; steps of a chunk that filled up since are there too, though nobody promised them
    assert number // LINE * LINE <= kept <= number


@pytest.mark.parametrize("looks", range(1, 8))
def test_a_disk_that_fills_up_ends_the_scan_while_the_file_can_still_be_closed(
    tmp_path, form, monkeypatch, looks
):
    path, left = tmp_path / "scan.h5", iter(range(looks, -1000, -1))
    with monkeypatch.context() as patched:
        plenty, little = SimpleNamespace(free=10**12), SimpleNamespace(free=10**7)
        patched.setattr(shutil, "disk_usage", lambda folder: plenty if next(left) > 1 else little)
        with pytest.raises(DataFileError, match=r"only 10 MB free.*rig resume"):
            measure(create(path, form), 0)
        before = path.read_bytes()
        with pytest.raises(RefusedError, match="was not changed"):
            ScanWriter.resume(path)
        assert path.read_bytes() == before
        assert not journal_of(path).exists()
    with ScanFile(path) as scan:
        assert scan.status == "failed"
        assert scan.done[: np.count_nonzero(scan.done)].all()
    assert assert_right(path) >= LINE
