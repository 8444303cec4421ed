"""Attacks on scan files by full disks, power cuts and interrupts: what was saved stays, the scan goes on.

PYTHONPATH=tests python -m attacks.disks --number 2000 [--step 4]     as root: small disks are mounted
"""

import os
import random
import re
import shutil
import subprocess
import sys
import time
from argparse import ArgumentParser
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import h5py
import numpy as np

from rig.errors import DataFileError
from rig.files import ScanFile
from rig.files.journal import journal_of
from support.served_bench import rig_command

sys.path.insert(0, str(Path(__file__).parents[1] / "rig"))
import test_scan_file_interrupted as writing

#: A disk of so many bytes, on which a scan is begun; one of 384 positions and 0.24 MB.
DISK = 128 << 20
PAGE = 4096
PLAN = ("--grid", "24x16", "--spacing", "5cm", "--exposure", "2ms")
PATIENCE_S = 120.0
#: How a scan file holds its photons.
FORMS = ("histograms", "photons")


@dataclass
class Row:
    """What became of one kind of attack.

    Attributes
    ----------
    unread, lost, wrong, not_resumed
        How often the file could not be read, had fewer positions than were said to be safe, had a mark
        without its counts, or could not be made complete and equal to the scan that nobody disturbed.
    told
        How often a traceback or nothing at all was said, where something should be.
    """

    name: str
    tried: int = 0
    unread: int = 0
    lost: int = 0
    wrong: int = 0
    not_resumed: int = 0
    told: int = 0
    first: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        cells = [self.name, self.tried, self.unread, self.lost, self.wrong, self.not_resumed, self.told]
        return "| " + " | ".join(map(str, cells)) + " |"

    def judge(self, path: Path, safe: int) -> None:
        """Judge a file of `test_scan_file_interrupted`, and take it up again."""
        self.tried += 1
        try:
            kept = writing.measured_and_right(path)
            self.lost += kept < safe
            writing.assert_right(path)
        except DataFileError as problem:
            self.unread += 1
            self.first.append(str(problem))
        except AssertionError as problem:
            self.wrong += 1
            self.first.append(str(problem))


HEAD = (
    "| attack | tried | unreadable | saved positions lost | marked without counts | not resumed to equal "
    "| traceback or no word |\n" + "|" + " --- |" * 7
)


def full_disks(step: int, folder: Path) -> Row:
    """Fill the disk while ``rig scan`` runs, to each level; resume on it, and where there is room."""
    row = Row("disk full while `rig scan` runs, each level; resume on it, then with room")
    whole = folder / "whole.h5"
    _rig("scan", *PLAN, "--out", whole)
    with h5py.File(whole) as file:
        right = file["transients/counts"][()]
    with small_disk(folder / "disk") as disk:
        for free in range(0, whole.stat().st_size // PAGE + 2, step):
            full_disk(row, disk, free * PAGE, right)
    return row


def fill(hog: Path, free: int) -> None:
    """Take all of a disk but so many bytes, while somebody else writes to it."""
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        hog.unlink(missing_ok=True)
        left = shutil.disk_usage(hog.parent).free
        with hog.open("wb") as file, suppress(OSError):  # there was more room when it was asked for
            if left > free:
                os.posix_fallocate(file.fileno(), 0, left - free)
            return
    raise TimeoutError(f"{hog.parent} cannot be filled")


def full_disk(row: Row, disk: Path, free: int, right: np.ndarray) -> None:
    """Leave so many bytes on the disk when the first exposure begins."""
    path, hog = disk / "a.h5", disk / "hog"
    row.tried += 1
    with subprocess.Popen(
        rig_command("scan", *PLAN, "--out", path), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as program:
        deadline_s = time.monotonic() + PATIENCE_S
        log = path.with_suffix(".log")
        while program.poll() is None and time.monotonic() < deadline_s:
            if log.exists() and "exposing" in log.read_text():
                break
            time.sleep(0.002)
        fill(hog, free)
        _, said = program.communicate(timeout=PATIENCE_S)
    ended_well = program.returncode == 0
    row.told += "Traceback" in said or not (ended_well or "rig resume" in said)
    promised = re.search(r"first ([\d,]+) of|([\d,]+) of [\d,]+ positions are safe", said)
    safe = int((promised[1] or promised[2]).replace(",", "")) if promised else 0
    kept = held(row, path, right)
    row.lost += kept < safe
    if not ended_well:
        again = _rig("resume", path)
        row.told += "Traceback" in again.stderr or again.returncode == 1
        row.lost += held(row, path, right) < kept
    hog.unlink()
    if not ended_well:
        _rig("resume", path)
    row.not_resumed += held(row, path, right) < len(right) or journal_of(path).exists()
    for one in disk.iterdir():
        one.unlink()


def held(row: Row, path: Path, right: np.ndarray) -> int:
    """Return how many positions are marked; those whose counts are others are told."""
    try:
        with ScanFile(path) as scan:
            marked = np.flatnonzero(scan.done)
            if not len(marked):
                return 0
            counts = np.concatenate([block for _, block in scan.capture().histograms.blocks()])
    except DataFileError as problem:
        row.unread += 1
        row.first.append(str(problem))
        return -1
    row.wrong += not np.array_equal(counts, right.reshape(len(right), -1)[marked])
    return len(marked)


@contextmanager
def small_disk(folder: Path) -> Iterator[Path]:
    """Mount a small disk, for which one has to be root."""
    folder.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={DISK}", "tmpfs", str(folder)], check=True)
    try:
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def recorded(folder: Path, form: str) -> "writing.States":
    """Write a scan file, and keep what both files held after each line of what writes them."""
    kept = writing.States(folder / "scan.h5")
    kept.writer = writing.create(folder / "scan.h5", form)
    try:
        sys.settrace(kept)
        writing.measure(kept.writer, 0)
    finally:
        sys.settrace(None)
    return kept


def power_cuts(number: int, folder: Path, form: str) -> Row:
    """Cut the power at any line; each page on the disk may be as any write since the last sync left it."""
    states, path, rng = recorded(folder, form), folder / "cut.h5", random.Random(7)
    row = Row(f"{form}: power cut at any line of what writes, pages on the disk in any order")
    for turn in range(number):
        moment = turn % len(states.kept)
        _put(path, states.after_a_power_cut(moment, rng))
        row.judge(path, states.safe[moment])
    return row


def cut_journals(number: int, folder: Path, form: str) -> Row:
    """Cut journal and file at any length."""
    states, path, rng = recorded(folder, form), folder / "cut.h5", random.Random(8)
    row = Row(f"{form}: journal and file cut at any length")
    whole, journal = next(one for one in reversed(states.kept) if None not in one)
    for _ in range(number):
        length = rng.randrange(len(states.kept[0][1]), len(journal))
        _put(path, [whole[: rng.randrange(len(whole))], journal[:length]])
        _judge_cut(row, path)
    return row


def flipped_bits(number: int, folder: Path, form: str) -> Row:
    """Flip a bit of the journal."""
    states, path, rng = recorded(folder, form), folder / "cut.h5", random.Random(9)
    row = Row(f"{form}: a bit of the journal flipped")
    whole, journal = next(one for one in reversed(states.kept) if None not in one)
    for _ in range(number):
        flipped = bytearray(journal)
        flipped[rng.randrange(len(states.kept[0][1]), len(journal))] ^= 1 << rng.randrange(8)
        _put(path, [whole, bytes(flipped)])
        _judge_cut(row, path)
    return row


def _judge_cut(row: Row, path: Path) -> None:
    """Judge, where what was noted may be lost with what was cut off."""
    row.tried += 1
    try:
        writing.measured_and_right(path)
        writing.noted_or_not(path)
    except (AssertionError, DataFileError) as problem:
        row.wrong += 1
        row.first.append(str(problem))


def interrupts(number: int, folder: Path, form: str) -> Row:
    """Interrupt at any executed line of what writes."""
    row = Row(f"{form}: an interrupt at any executed line of what writes")
    places = writing.interrupt_at(folder / "whole.h5", form, None)
    for at in random.Random(10).sample(range(len(places)), min(number, len(places))):
        path = folder / "cut.h5"
        _put(path, [None, None])
        writing.interrupt_at(path, form, at)
        row.judge(path, 0)
    return row


def _put(path: Path, content: list[bytes | None]) -> None:
    for file, held_by_it in zip((path, journal_of(path)), content, strict=True):
        file.unlink(missing_ok=True)
        if held_by_it is not None:
            file.write_bytes(held_by_it)


def _rig(*arguments: object) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        rig_command(*arguments), capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )


ATTACKS: tuple[Callable[[int, Path, str], Row], ...] = (power_cuts, cut_journals, flipped_bits, interrupts)


def main() -> None:
    """Attack from the command line; exit with 1 where something was wrong."""
    parser = ArgumentParser(description="Full disks, power cuts, interrupts; print a table.")
    parser.add_argument("--number", type=int, default=500, help="tries of each kind")
    parser.add_argument("--step", type=int, default=4, help="between levels of the full disk, in 4 kB")
    given = parser.parse_args()
    print(HEAD)
    rows = []
    tries = [partial(attack, given.number, form=form) for form in FORMS for attack in ATTACKS]
    for attack in (*tries, partial(full_disks, given.step)):
        with TemporaryDirectory(prefix="rig-attacks-") as folder:
            rows.append(attack(folder=Path(folder)))
            print(rows[-1], flush=True)
            for said in rows[-1].first[:3]:
                print(said[:300], file=sys.stderr)
    sys.exit(any(row.first or row.lost or row.not_resumed or row.told or row.wrong for row in rows))


if __name__ == "__main__":
    main()
