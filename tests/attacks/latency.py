"""How soon it is dark, and the program at its end, in the middle of an exposure of 100 hours.

PYTHONPATH=tests python -m attacks.latency --number 5
"""

import os
import signal
import subprocess
import time
from argparse import ArgumentParser
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import h5py

from rig.files import ScanFile
from support.served_bench import Served, rig_command, served

LONG = ("--grid", "12x9", "--spacing", "15cm", "--exposure", "100h", "--yes")

#: Into the exposure [s].
AFTER_S = 3.0

PATIENCE_S = 60.0


def ctrl_c(bench: Served, path: Path) -> dict[str, float]:
    """Press Ctrl-C once; return times since then [s], and what became of the exposure."""
    program = begun(bench, path)
    hit_unix_s = time.time()
    program.send_signal(signal.SIGINT)
    _, said = program.communicate(timeout=PATIENCE_S)
    times = {"dark": last_dark_s(bench) - hit_unix_s, "end": time.time() - hit_unix_s}
    assert program.returncode == 6, said
    with h5py.File(path) as file:
        (cut,) = file["unfinished"].values()
        assert cut.attrs["step"] == 0
        times |= {"live time": float(cut.attrs["live_time_s"]), "photons": int(cut[()].sum())}
    with ScanFile(path) as scan:
        assert not scan.done.any()
    return times


def interlock(bench: Served, path: Path) -> dict[str, float]:
    """Open the interlock; return when the program has said that it is dark, and its end [s]."""
    program = begun(bench, path)
    bench.process.send_signal(signal.SIGUSR1)
    _, said = program.communicate(timeout=PATIENCE_S)
    end_unix_s = time.time()
    bench.process.send_signal(signal.SIGUSR1)
    assert program.returncode == 4, said
    assert b"dark without a command" in said, said
    opened_unix_s = last_dark_s(bench)
    dark = [line for line in path.with_suffix(".log").read_text().splitlines() if " laser dark, " in line]
    said_unix_s = datetime.fromisoformat(dark[-1].split()[0]).timestamp()
    return {"said to be dark": said_unix_s - opened_unix_s, "end": end_unix_s - opened_unix_s}


def begun(bench: Served, path: Path) -> "subprocess.Popen[bytes]":
    """Begin a scan, and return in the middle of its first exposure."""
    before = len(bench.values("laser emission"))
    program = subprocess.Popen(
        rig_command("scan", "--config", bench.config, *LONG, "--out", path),
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        env={**os.environ, "RIG_STATE": str(path.with_suffix(".state"))},
    )  # fmt: skip
    deadline_s = time.monotonic() + PATIENCE_S
    while bench.values("laser emission")[before:] != ["1"]:
        assert time.monotonic() < deadline_s
        time.sleep(0.02)
    time.sleep(AFTER_S)
    return program


def last_dark_s(bench: Served) -> float:
    """Return the clock time at which the laser went dark."""
    at_s, _, value = [one for one in bench.changes() if one[1] == "laser emission"][-1]
    assert value == "0"
    return bench.told["began_unix_s"] + at_s


ATTACKS: dict[str, Callable[[Served, Path], dict[str, float]]] = {
    "Ctrl-C once": ctrl_c,
    "the interlock opens": interlock,
}


def main() -> None:
    """Measure from the command line; print a table."""
    parser = ArgumentParser(description="Times to darkness and to the end in an exposure of 100 h.")
    parser.add_argument("--number", type=int, default=5, help="runs of each kind")
    number = parser.parse_args().number
    print("| in an exposure of 100 h | runs | median, longest |\n| --- | --- | --- |")
    with TemporaryDirectory(prefix="rig-attacks-") as folder, served(Path(folder)) as bench:
        for name, attack in ATTACKS.items():
            runs = [attack(bench, Path(folder) / f"{attack.__name__}-{n}.h5") for n in range(number)]
            told = [
                f"{what} {median(run[what] for run in runs):.2f}, {max(run[what] for run in runs):.2f}"
                + (" s" if what != "photons" else "")
                for what in runs[0]
            ]
            print(f"| {name} | {number} | {'; '.join(told)} |", flush=True)
    print(f"\nLoad of this machine: {os.getloadavg()[1]:.0f} on {os.cpu_count()} cores.")


if __name__ == "__main__":
    main()
