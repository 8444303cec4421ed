"""A scan file is right wherever an exception comes, and wherever writing fails."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rig.errors import DataFileError
from rig.files import ScanDescription, ScanFile, ScanWriter
from rig.files import writer as writer_module
from rig.files.writer import GROWTH_BYTES

POSITIONS, BINS, LINE = 40, 60, 7


def row(position):
    return np.random.default_rng([3, position]).poisson(2.0, BINS).astype("u4")


def measure(writer, done):
    """Do as the scan engine does: what does not count, because it was not recorded, is withdrawn."""
    status = "failed"
    try:
        while done < POSITIONS:
            writer.append(row(done), 0.01)
            done += 1
            if done % LINE == 0:
                writer.checkpoint()
        status = "complete"
    finally:
        sys.settrace(None)
        writer.withdraw(done)
        writer.close(status)


def create(path):
    laser_m = np.zeros((POSITIONS, 3))
    return ScanWriter.create(path, ScanDescription(laser_m, np.zeros((1, 3)), BINS, 4e-12, 0.0))


def assert_right(path):
    """Every mark has its counts, and resuming gives the whole scan."""
    with ScanFile(path) as scan:
        measured = np.flatnonzero(scan.done)
        if len(measured):
            for where, block in scan.capture().histograms.blocks():
                for position, counts in zip(measured[where], block, strict=True):
                    np.testing.assert_array_equal(counts, row(position))
        if scan.status == "complete":
            assert len(measured) == POSITIONS
            return len(measured)
    with ScanWriter.resume(path) as again:
        measure(again, again.appended)
    with ScanFile(path) as scan:
        assert scan.status == "complete"
        assert scan.photons == sum(int(row(position).sum()) for position in range(POSITIONS))
        (whole,) = [block for _, block in scan.capture().histograms.blocks()]
    np.testing.assert_array_equal(whole, [row(position) for position in range(POSITIONS)])
    return len(measured)


class At:
    """Raises at the n-th executed line of the writer."""

    def __init__(self, number):
        self.number, self.lines = number, 0

    def __call__(self, frame, event, argument):
        if frame.f_code.co_filename != writer_module.__file__ or frame.f_code.co_name == "close":
            return None
        return self.line

    def line(self, frame, event, argument):
        if event == "line":
            self.lines += 1
            if self.lines == self.number:
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
    return at.lines


def test_an_interrupt_at_any_line_of_the_writer_leaves_no_wrong_mark(tmp_path):
    lines = interrupt_at(tmp_path / "whole.h5", None)
    assert_right(tmp_path / "whole.h5")
    # the lines around the first chunk (position 16) and a checkpoint in it, and samples of all the others
    kept = []
    for number in [*range(1, 330), *range(330, lines, 11)]:
        path = tmp_path / f"{number}.h5"
        interrupt_at(path, number)
        kept.append(assert_right(path))
        path.unlink()
    assert max(kept) > 30


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
    os._exit(0)  # HDF5 stumbles over a file that it could not close


def limited(writer, number):
    """Let no file grow by more than ``number`` bytes: the system answers as it does for a quota."""
    import resource

    size = writer.path.stat().st_size
    resource.setrlimit(resource.RLIMIT_FSIZE, (size + number, resource.RLIM_INFINITY))
    return writer


@pytest.mark.skipif(sys.platform != "linux", reason="the limit on a file's size is Linux's here")
def test_a_file_that_may_not_grow_ends_the_scan_with_what_was_measured(tmp_path):
    enough = GROWTH_BYTES + 4 * 16 * BINS * 4  # 16 positions a chunk, 4 bytes a count
    limits = [0, 3000, *range(enough, enough + 6000, 400)]
    errors = in_a_process_of_its_own(limited, tmp_path, limits)
    kept = []
    for limit, error in zip(limits, errors, strict=True):
        assert error == "" or limit < enough or re.search("may not grow .*File too large.*rig resume", error)
        with ScanFile(tmp_path / f"{limit}.h5") as scan:
            assert limit < enough or scan.status == ("failed" if error else "complete")
        kept.append(assert_right(tmp_path / f"{limit}.h5"))
    assert kept == sorted(kept)
    assert kept[0] == 0
    assert 0 < kept[2] < kept[-1] == POSITIONS


class Unplugged:
    """A writer whose disk turns read-only before its n-th position."""

    def __init__(self, writer, number):
        self.writer, self.left = writer, number

    def append(self, counts, live_time_s):
        if self.left == 0:
            path = str(self.writer.path.resolve())
            (ours,) = (n for n in Path("/proc/self/fd").iterdir() if os.path.realpath(n) == path)
            os.dup2(os.open(path, os.O_RDONLY), int(ours.name))
        self.left -= 1
        self.writer.append(counts, live_time_s)

    def __getattr__(self, name):
        return getattr(self.writer, name)


@pytest.mark.skipif(sys.platform != "linux", reason="open files are found as Linux names them")
@pytest.mark.parametrize(
    ("number", "kept"),
    # a line ends at 7, 14, 21 and so on; a chunk, full at 16 and 32, has its marks again with the next line
    [(0, 0), (10, 7), (20, 0), (23, 21), (33, 16)],
)
def test_after_writing_failed_the_file_is_as_it_was_saved_last(tmp_path, number, kept):
    (error,) = in_a_process_of_its_own(Unplugged, tmp_path, [number])
    assert re.search("cannot close .* What was saved before is still in the file", error)
    assert assert_right(tmp_path / f"{number}.h5") == kept


@pytest.mark.parametrize("looks", range(1, 8))
def test_a_disk_that_fills_up_ends_the_scan_while_the_file_can_still_be_closed(tmp_path, monkeypatch, looks):
    path, left = tmp_path / "scan.h5", iter(range(looks, -1000, -1))
    with monkeypatch.context() as patched:
        plenty, little = SimpleNamespace(free=10**12), SimpleNamespace(free=10**7)
        patched.setattr(shutil, "disk_usage", lambda folder: plenty if next(left) > 1 else little)
        with pytest.raises(DataFileError, match=r"only 10 MB free.*rig resume"):
            measure(create(path), 0)
    with ScanFile(path) as scan:
        assert scan.status == "failed"
        assert scan.done[: np.count_nonzero(scan.done)].all()
    assert assert_right(path) >= LINE
