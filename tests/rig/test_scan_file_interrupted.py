"""A scan file is right wherever an exception comes, wherever writing fails, and whatever reached the disk."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

from rig.errors import DataFileError, RefusedError, UsageError
from rig.files import ScanDescription, ScanFile, ScanWriter
from rig.files import content as content_module
from rig.files import journal as journal_module
from rig.files import writer as writer_module
from rig.files.journal import journal_of

POSITIONS, BINS, LINE = 40, 60, 7
#: Set to any word, these tests try everything; without it, samples.
THOROUGH = bool(os.environ.get("RIG_TEST_THOROUGH"))


def row(position):
    return np.random.default_rng([3, position]).poisson(2.0, BINS).astype("u4")


def measure(writer, done):
    """Do as the scan engine does: what does not count, because it was not recorded, is withdrawn."""
    status = "failed"
    try:
        while done < POSITIONS:
            if done in {3, 4, 5, 20}:
                writer.note("a bin is full", done, done)
            writer.append(row(done), 0.01)
            done += 1
            if done % LINE == 0:
                writer.checkpoint()
        status = "complete"
    finally:
        writer.withdraw(done)
        writer.close(status)


def create(path):
    laser_m = np.zeros((POSITIONS, 3))
    return ScanWriter.create(path, ScanDescription(laser_m, np.zeros((1, 3)), BINS, 4e-12, 0.0))


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
        np.testing.assert_array_equal(transients["counts"][:, 0], [row(n) for n in range(POSITIONS)])
        np.testing.assert_array_equal(transients["live_time_s"][()], np.full(POSITIONS, 0.01, "f4"))
        assert transients["done"][()].all()
        assert file["stop"].attrs["status"] == "complete"
        assert file["stop"].attrs["photons"] == sum(int(row(n).sum()) for n in range(POSITIONS))
        noted = {n for one in file["events"][()] for n in range(one["first"], one["last"] + 1)}
        assert noted == {3, 4, 5, 20}
    return measured


class At:
    """Raises at the n-th executed line of what writes scan files; keeps the lines' places."""

    FILES = (writer_module.__file__, journal_module.__file__, content_module.__file__)

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


def interrupt_at(path, number):
    at = At(number)
    writer = create(path)
    try:
        sys.settrace(at)
        measure(writer, 0)
    except KeyboardInterrupt:
        pass
    finally:
        sys.settrace(None)
    return at.places


def test_an_interrupt_at_any_line_of_the_writer_leaves_no_wrong_mark(tmp_path):
    places = interrupt_at(tmp_path / "whole.h5", None)
    assert_right(tmp_path / "whole.h5")
    first = {place: number for number, place in reversed(list(enumerate(places)))}
    last = {place: number for number, place in enumerate(places)}
    tried = range(len(places)) if THOROUGH else sorted({*first.values(), *last.values()})
    kept = []
    for number in tried:
        path = tmp_path / f"{number}.h5"
        interrupt_at(path, number)
        kept.append(assert_right(path))
        path.unlink()
    assert max(kept) == POSITIONS
    print(f"{len(tried)} of {len(places)} executed lines")


def in_a_process_of_its_own(fault, folder, numbers):
    """Measure a file for each number, each with its fault; return the errors."""
    here = Path(__file__)
    code = f"import sys; sys.path.insert(0, {str(here.parent)!r}); import {here.stem} as t; "
    code += f"t.measure_with(t.{fault.__name__}, {str(folder)!r}, {list(numbers)})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def measure_with(fault, folder, numbers):
    errors = []
    for number in numbers:
        writer = create(Path(folder) / f"{number}.h5")
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
def test_a_file_that_may_not_grow_ends_the_scan_with_what_was_measured(tmp_path):
    limits = range(0, 12000, 100 if THOROUGH else 800)
    errors = in_a_process_of_its_own(limited, tmp_path, limits)
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
    assert kept[0] < kept[len(kept) // 2] < kept[-1] == POSITIONS


class Unplugged:
    """A writer whose disk turns read-only before its n-th position."""

    def __init__(self, writer, number):
        self.writer, self.left = writer, number

    def append(self, counts, live_time_s):
        if self.left == 0:
            for path in (self.writer.path, journal_of(self.writer.path)):
                named = str(path.resolve())
                (ours,) = (n for n in Path("/proc/self/fd").iterdir() if os.path.realpath(n) == named)
                os.dup2(os.open(path, os.O_RDONLY), int(ours.name))
        self.left -= 1
        self.writer.append(counts, live_time_s)

    def __getattr__(self, name):
        return getattr(self.writer, name)


@pytest.mark.skipif(sys.platform != "linux", reason="open files are found as Linux names them")
@pytest.mark.parametrize("number", [0, 10, 20, 23, 33, 39])
def test_after_writing_failed_the_file_is_as_it_was_saved_last(tmp_path, number):
    (error,) = in_a_process_of_its_own(Unplugged, tmp_path, [number])
    assert re.search("cannot write .*Bad file descriptor.*rig resume", error)
    kept = assert_right(tmp_path / f"{number}.h5")
    # the last line's end; steps of a chunk that filled up since are there too, though nobody promised them
    assert number // LINE * LINE <= kept <= number


@pytest.mark.parametrize("looks", range(1, 8))
def test_a_disk_that_fills_up_ends_the_scan_while_the_file_can_still_be_closed(tmp_path, monkeypatch, looks):
    path, left = tmp_path / "scan.h5", iter(range(looks, -1000, -1))
    with monkeypatch.context() as patched:
        plenty, little = SimpleNamespace(free=10**12), SimpleNamespace(free=10**7)
        patched.setattr(shutil, "disk_usage", lambda folder: plenty if next(left) > 1 else little)
        with pytest.raises(DataFileError, match=r"only 10 MB free.*rig resume"):
            measure(create(path), 0)
        before = path.read_bytes()
        with pytest.raises(RefusedError, match="was not touched"):
            ScanWriter.resume(path)
        assert path.read_bytes() == before
        assert not journal_of(path).exists()
    with ScanFile(path) as scan:
        assert scan.status == "failed"
        assert scan.done[: np.count_nonzero(scan.done)].all()
    assert assert_right(path) >= LINE
