"""What `rig recon --dry-run` estimates beside what `rig recon` takes, in processor time.

PYTHONPATH=.:tests python tests/benchmarks/forecast_check.py
"""

import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from support.point_scans import write_point_scan

SIZES = [
    ((24, 20), 0.03, ("--wavelength", "8cm", "--depth", "0.5m:0.9m:2cm")),
    ((64, 64), 0.02, ("--wavelength", "6cm", "--depth", "0.5m:1.5m:2cm")),
    ((64, 64), 0.02, ("--wavelength", "6cm", "--depth", "0.5m:1m:1cm", "--voxel", "1cm")),
    ((128, 128), 0.01, ("--wavelength", "4cm", "--depth", "0.5m:1m:1cm")),
]


def rig(*arguments: object) -> tuple[str, float]:
    """Run a command; return its stdout and its processor time."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-m", "rig", *map(str, arguments)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return done.stdout, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Print the table."""
    print("| positions | voxels | estimated [s] | measured [s] | estimated / measured |")
    print("| --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as folder:
        for number, (shape, spacing_m, options) in enumerate(SIZES):
            scan = write_point_scan(Path(folder) / f"{number}.h5", shape, spacing_m)
            told = json.loads(rig("recon", scan, *options, "--dry-run", "--json")[0])
            _, taken_s = rig("recon", scan, *options, "--json")
            voxels, estimated_s = " x ".join(map(str, told["voxels"])), told["processor_s"]
            print(
                f"| {shape[0]} x {shape[1]} | {voxels} | {estimated_s:.1f} | {taken_s:.1f} | "
                f"{estimated_s / taken_s:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
