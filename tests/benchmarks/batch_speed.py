"""How long 100 small scans take by `rig batch` on one worker and on two.

    PYTHONPATH=.:tests python tests/benchmarks/batch_speed.py [SCANS]

By the clock, the start of the workers included, so the machine is to be quiet; the processor time beside it
shows whether it was. The target is 1.8 times as quick on two.
"""

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from support.point_scans import write_point_scan

JOBS = """
[[job]]
scans = ["*.h5"]
wavelength = "8cm"
depth = "0.5m:1m:1cm"
"""


def seconds(jobs: Path, workers: int) -> tuple[float, float]:
    """Return clock and processor time of a batch."""
    out = jobs.with_name(f"on-{workers}")
    command = [sys.executable, "-m", "rig", "batch", jobs, "--cluster", f"local:{workers}", "--out", out]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    began_s = time.monotonic()
    subprocess.run(list(map(str, command)), check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    processor_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.monotonic() - began_s, processor_s


def main() -> None:
    """Print the table."""
    number = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    with tempfile.TemporaryDirectory() as folder:
        jobs = Path(folder) / "jobs.toml"
        jobs.write_text(JOBS)
        for index in range(number):
            write_point_scan(jobs.with_name(f"scan{index:03d}.h5"), shape=(32, 32), spacing_m=0.03)
        print(f"{number} scans | workers | clock [s] | processor [s] | times as quick")
        first_s = 0.0
        for workers in (1, 2):
            clock_s, processor_s = seconds(jobs, workers)
            first_s = first_s or clock_s
            print(f"| {workers} | {clock_s:.1f} | {processor_s:.1f} | {first_s / clock_s:.2f} |", flush=True)


if __name__ == "__main__":
    main()
