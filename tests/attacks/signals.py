"""Attacks on programs that scan: a signal at a random moment, judged by what the served devices did.

PYTHONPATH=tests python -m attacks.signals --number 60 [--first 0] [--mode continuous]
"""

import json
import os
import signal
import subprocess
import sys
import time
from argparse import ArgumentParser
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from statistics import median
from tempfile import TemporaryDirectory

import numpy as np

from rig.errors import DataFileError
from rig.files import ScanFile
from support.served_bench import Served, rig_command, served

#: What is scanned, by mode: 96 positions, and 792; one and three seconds of light.
PLANS = {
    "step": ("--grid", "12x9", "--spacing", "15cm", "--exposure", "10ms", "--yes"),
    "continuous": ("--mode=continuous", "--grid=40x20", "--spacing=4cm", "--exposure=4ms", "--yes"),
}

#: Longest wait for a program's end, and for darkness after it.
PATIENCE_S = 60.0

#: How a program is hit; each is given its process and its guard's.
Hit = Callable[[Random, "subprocess.Popen[bytes]"], None]


def one(name: str) -> Hit:
    """Send a signal once."""
    return lambda random, program: program.send_signal(getattr(signal, name))


def ctrl_c(times: int) -> Hit:
    """Press Ctrl-C so often, 0 to 20 ms apart."""

    def hit(random: Random, program: "subprocess.Popen[bytes]") -> None:
        for _ in range(times):
            program.send_signal(signal.SIGINT)
            time.sleep(random.choice([0, 0.001, 0.005, 0.02]))

    return hit


def held(random: Random, program: "subprocess.Popen[bytes]") -> None:
    """Hold Ctrl-C for two seconds, as a keyboard repeats it."""
    for _ in range(60):
        program.send_signal(signal.SIGINT)
        time.sleep(1 / 30)


def stopped(random: Random, program: "subprocess.Popen[bytes]") -> None:
    """Suspend it for a while, which it cannot prevent."""
    program.send_signal(signal.SIGSTOP)
    time.sleep(random.uniform(0.1, 4.0))
    program.send_signal(signal.SIGCONT)


def guard(name: str) -> Hit:
    """Send a signal to its guard, if there is one."""

    def hit(random: Random, program: "subprocess.Popen[bytes]") -> None:
        command = ["pgrep", "-P", str(program.pid), "-f", "rig.light.process"]
        for found in subprocess.run(command, capture_output=True, check=False).stdout.split():
            with suppress(ProcessLookupError):
                os.kill(int(found), getattr(signal, name))

    return hit


HITS: dict[str, Hit] = {
    "SIGKILL": one("SIGKILL"),
    "SIGHUP": one("SIGHUP"),
    "SIGTERM": one("SIGTERM"),
    "Ctrl-C once": ctrl_c(1),
    "Ctrl-C twice": ctrl_c(2),
    "Ctrl-C ten times, 0 to 20 ms apart": ctrl_c(10),
    "Ctrl-C held for 2 s": held,
    "SIGQUIT": one("SIGQUIT"),
    "Ctrl-Z (SIGTSTP)": one("SIGTSTP"),
    "SIGSTOP, later SIGCONT": stopped,
    "SIGSEGV": one("SIGSEGV"),
    "the guard: SIGKILL": guard("SIGKILL"),
    "the guard: SIGTERM": guard("SIGTERM"),
}


@dataclass
class Run:
    """What became of a program that was hit; times since then [s], None where nothing was on.

    ``wrong`` has what must not be.
    """

    hit: str
    lit: bool = False
    dark_s: float | None = None
    closed_s: float | None = None
    end_s: float = 0.0
    code: int | None = None
    resumed: str = ""
    wrong: list[str] = field(default_factory=list)


class Bench:
    """A served bench that one program after the other scans with.

    Parameters
    ----------
    running
        The server.
    folder
        Where scans are made.
    mode
        How they are made.
    """

    def __init__(self, running: Served, folder: Path, mode: str = "step") -> None:
        self._bench = running
        self._folder = folder
        self._plan = PLANS[mode]
        self._environment = {**os.environ, "RIG_STATE": str(folder / "state")}
        began_s = time.monotonic()
        whole = self._start(folder / "whole.h5")
        whole.communicate(timeout=120)
        self.whole_s = time.monotonic() - began_s
        with ScanFile(folder / "whole.h5") as scan:
            self._photons = [
                int(counts.sum()) for _, block in scan.capture().histograms.blocks() for counts in block
            ]

    def attack(self, number: int) -> Run:
        """Scan, hit, and judge; the same number is hit in the same way at the same time."""
        name = list(HITS)[number % len(HITS)]
        random = Random(f"signals {number}")
        path = self._folder / f"{number}.h5"
        before = len(self._bench.changes())
        program = self._start(path)
        # half of them at any time from the process's start to after its end, the others while there is light
        lit = random.random() < 0.6
        if lit:
            self._wait(lambda: ("laser emission", "1") in self._since(before) or program.poll() is not None)
        time.sleep(random.uniform(0, 2.0) if lit else random.uniform(0, 1.1 * self.whole_s))
        run = Run(name)
        hit_unix_s = time.time()
        was_on = self._last("laser emission"), self._last("detector bias")
        with suppress(ProcessLookupError):
            HITS[name](random, program)
        self._judge_end(run, program)
        run.end_s = time.time() - hit_unix_s
        self._wait(lambda: self._last("laser emission") == self._last("detector bias") == "0")
        run.lit = ("laser emission", "1") in self._since(before)
        for what, attribute, on in zip(
            ("laser emission", "detector bias"), ("dark_s", "closed_s"), was_on, strict=True
        ):
            if self._last(what) != "0":
                run.wrong.append(f"{what} left on")
            elif on == "1":
                setattr(run, attribute, self._began_s(what, before, "0") - hit_unix_s)
        self._judge_file(run, path)
        return run

    def _start(self, path: Path) -> "subprocess.Popen[bytes]":
        command = rig_command("scan", "--config", self._bench.config, *self._plan, "--out", path)
        return subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=self._environment,
        )

    def _judge_end(self, run: Run, program: "subprocess.Popen[bytes]") -> None:
        try:
            _, said = program.communicate(timeout=PATIENCE_S)
        except subprocess.TimeoutExpired:
            program.kill()
            program.communicate()
            run.wrong.append(f"not ended after {PATIENCE_S:.0f} s")
            return
        run.code = program.returncode
        last = said.decode(errors="replace").strip()[-300:]
        if b"Traceback" in said or run.code == 1:
            run.wrong.append(f"traceback (exit code {run.code}): {last}")
        elif run.code not in {0, 3, 4, 6, 129, 130, 143} and run.code > 0:  # 128 and more: nothing had begun
            run.wrong.append(f"exit code {run.code}: {last}")

    def _judge_file(self, run: Run, path: Path) -> None:
        """Look at what is marked, take the scan up again, and look again."""
        if not (path.exists() or path.with_name(path.name + ".journal").exists()):
            run.resumed = "no file yet"
            return
        try:
            self._judge_counts(run, path)
            again = subprocess.run(
                rig_command("resume", path, "--config", self._bench.config, "--yes"),
                capture_output=True, env=self._environment, timeout=2 * PATIENCE_S, check=False,
            )  # fmt: skip
            with ScanFile(path) as scan:
                whole = bool(scan.done.all()) and scan.status == "complete"
            self._judge_counts(run, path)
        except (DataFileError, subprocess.TimeoutExpired) as problem:
            run.wrong.append(f"file: {problem}")
            return
        run.resumed = "complete before" if again.returncode == 2 and whole else "complete" if whole else "no"
        if not whole:
            run.wrong.append(
                f"resume: exit code {again.returncode}, {again.stderr.decode(errors='replace')[-300:]}"
            )

    def _judge_counts(self, run: Run, path: Path) -> None:
        """Hold positions that are marked as measured against the scan that nobody disturbed.

        Photons are drawn anew at each visit, so that only their number can be compared: 10 sigma and a tenth,
        which dead time and drift stay far below; a position measured half or in the dark does not.
        """
        with ScanFile(path) as scan:
            marked = np.flatnonzero(scan.done)
            if not len(marked):
                return
            counts = [int(one.sum()) for _, block in scan.capture().histograms.blocks() for one in block]
        for position, number in zip(marked, counts, strict=True):
            expected = self._photons[position]
            if abs(number - expected) > 10 * (expected + 1) ** 0.5 + expected / 10:
                run.wrong.append(f"position {position} has {number} photons, {expected} were expected")

    def _since(self, first: int) -> list[tuple[str, str]]:
        return [(what, value) for _, what, value in self._bench.changes()[first:]]

    def _last(self, name: str) -> str:
        return (self._bench.values(name) or ["0"])[-1]

    def _began_s(self, name: str, first: int, value: str = "1") -> float:
        """Return the clock time at which something was last changed to a value."""
        at_s = [at for at, what, to in self._bench.changes()[first:] if (what, to) == (name, value)]
        return self._bench.told["began_unix_s"] + at_s[-1]

    def _wait(self, happened: Callable[[], bool]) -> None:
        deadline_s = time.monotonic() + PATIENCE_S
        while not happened() and time.monotonic() < deadline_s:
            time.sleep(0.01)


@contextmanager
def bench(mode: str = "step") -> Iterator[Bench]:
    """Serve a bench, in a folder that is gone afterwards."""
    with TemporaryDirectory(prefix="rig-attacks-") as folder, served(Path(folder)) as running:
        yield Bench(running, Path(folder), mode)


def table(runs: list[Run]) -> str:
    """Return what became of them, a row for each way to hit."""
    rows = [
        "| hit | runs | with light | light left on | detector left open | to dark: median, longest [s] "
        "| closed: longest [s] | to the end: longest [s] | exit codes | resumed | anything else wrong |",
        "|" + " --- |" * 11,
    ]
    for name in [hit for hit in HITS if any(run.hit == hit for run in runs)]:
        mine = [run for run in runs if run.hit == name]
        dark = [run.dark_s for run in mine if run.dark_s is not None]
        closed = [run.closed_s for run in mine if run.closed_s is not None]
        wrong = [what for run in mine for what in run.wrong]
        left = [wrong.count(f"{what} left on") for what in ("laser emission", "detector bias")]
        codes = sorted({str(run.code) for run in mine})
        resumed = ", ".join(
            f"{sum(run.resumed == how for run in mine)} {how}" for how in sorted({r.resumed for r in mine})
        )
        cells = [
            name, len(mine), sum(run.lit for run in mine), *left,
            f"{median(dark):.2f}, {max(dark):.2f}" if dark else "-",
            f"{max(closed):.2f}" if closed else "-",
            f"{max(run.end_s for run in mine):.1f}", " ".join(codes), resumed,
            sum("left on" not in what for what in wrong),
        ]  # fmt: skip
        rows.append("| " + " | ".join(map(str, cells)) + " |")
    return "\n".join(rows)


def main() -> None:
    """Attack from the command line; exit with 1 where something was wrong."""
    parser = ArgumentParser(description="Hit scans with signals at random moments; print a table.")
    parser.add_argument("--number", type=int, default=len(HITS), help="how many scans")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument("--mode", choices=list(PLANS), default="step", help="of the scans")
    given = parser.parse_args()
    runs = []
    with bench(given.mode) as attacked:
        for number in range(given.first, given.first + given.number):
            runs.append(attacked.attack(number))
            print(json.dumps({"number": number, **vars(runs[-1])}), file=sys.stderr, flush=True)
    print(table(runs))
    print(f"\nLoad of this machine: {os.getloadavg()[1]:.0f} on {os.cpu_count()} cores.")
    sys.exit(any(run.wrong for run in runs))


if __name__ == "__main__":
    main()
