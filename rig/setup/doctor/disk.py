"""Room and speed of the disk that scans go to."""

import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from rig.setup.doctor.finding import Finding

#: Free space below which a long scan may not fit.
ENOUGH_BYTES = 2e9
#: What is written to measure: it takes a tenth of a second on a disk that is just fast enough.
SAMPLE_BYTES = 4_000_000
#: Records of a continuous scan at the largest rate of a timing instrument, 4 bytes each at 10 MHz.
SLOWEST_BYTES_PER_S = 40e6
#: A line of 180 positions at 1 ms, the fastest scan; each line is put on disk before the next but one ends.
LONGEST_SYNC_S = 0.18


def check(folder: Path) -> Iterator[Finding]:
    """Return how much is free in a folder, and how fast it takes a file, which is removed again."""
    where = folder.resolve()
    free = shutil.disk_usage(where).free
    remedy = (
        ""
        if free > ENOUGH_BYTES
        else "A long scan may need more: free some space, or scan with --out in another folder"
    )
    yield Finding(
        f"disk space in {where}", "warning" if remedy else "ok", f"{free / 1e9:.1f} GB free", remedy
    )
    yield _speed(where)


def _speed(folder: Path) -> Finding:
    what = f"disk speed in {folder}"
    try:
        write_s, sync_s = _measured(folder)
    except OSError as problem:
        return Finding(
            what, "missing", f"cannot be written ({problem.strerror})", "Scan with --out in another folder"
        )
    rate = SAMPLE_BYTES / max(write_s, 1e-9)
    found = f"{rate / 1e6:.0f} MB/s, {sync_s * 1e3:.0f} ms for a line to be on disk"
    if rate < SLOWEST_BYTES_PER_S or sync_s > LONGEST_SYNC_S:
        return Finding(
            what, "warning", found, "Scan to a local disk; a network disk may be too slow for fast scans"
        )
    return Finding(what, "ok", found)


def _measured(folder: Path) -> tuple[float, float]:
    """Return how long a sample takes to be written and put on disk, and a little more after that."""
    sample = os.urandom(SAMPLE_BYTES)  # some disks compress
    with tempfile.TemporaryFile(dir=folder) as file:
        began_s = time.perf_counter()
        file.write(sample)
        file.flush()
        os.fsync(file.fileno())
        written_s = time.perf_counter()
        file.write(bytes(64))
        file.flush()
        os.fsync(file.fileno())
        return written_s - began_s, time.perf_counter() - written_s
