"""A scan file is right wherever an exception comes, and wherever writing fails."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

from rig.errors import DataFileError
from rig.files import ScanDescription, ScanFile, ScanWriter
from rig.files import writer as writer_module

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


class Disk:
    """Refuses the n-th write of a chunk, and counts what is tried after that."""

    def __init__(self, monkeypatch, number):
        self.left, self.tried_after = number, 0
        real = ScanWriter._write_chunk

        def write(writer):
            self.left -= 1
            if self.left == 0:
                with writer._writing():
                    raise OSError(28, "No space left on device")
            self.tried_after += self.left < 0
            real(writer)

        monkeypatch.setattr(ScanWriter, "_write_chunk", write)


@pytest.mark.parametrize("number", range(1, 8))
def test_after_a_write_that_failed_nothing_more_is_written(tmp_path, monkeypatch, number):
    path = tmp_path / "scan.h5"
    with monkeypatch.context() as patched:
        disk = Disk(patched, number)
        with pytest.raises(DataFileError, match="No space left"):
            measure(create(path), 0)
        assert disk.tried_after == 0
    with ScanFile(path) as scan:
        assert scan.status == "interrupted"
    assert_right(path)


@pytest.mark.parametrize("looks", range(1, 8))
def test_a_disk_that_fills_up_ends_the_scan_while_the_file_can_still_be_closed(tmp_path, monkeypatch, looks):
    path, left = tmp_path / "scan.h5", iter(range(looks, -1000, -1))
    with monkeypatch.context() as patched:
        plenty, little = SimpleNamespace(free=10**12), SimpleNamespace(free=10**7)
        patched.setattr(writer_module, "disk_usage", lambda folder: plenty if next(left) > 1 else little)
        with pytest.raises(DataFileError, match=r"only 10 MB free.*rig resume"):
            measure(create(path), 0)
    with ScanFile(path) as scan:
        assert scan.status == "failed"
        assert scan.done[: np.count_nonzero(scan.done)].all()
    assert assert_right(path) >= LINE
