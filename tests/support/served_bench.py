"""``rig sim serve`` in a process of its own, for the length of a test."""

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Served:
    """A server, what it printed, and its files."""

    process: subprocess.Popen
    told: dict
    log: Path
    config: Path

    def changes(self) -> list[tuple[float, str, str]]:
        """Return the log: time, device and what, value."""
        lines = [line.split(maxsplit=3) for line in self.log.read_text().splitlines()]
        return [(float(at), f"{device} {what}", value) for at, device, what, value in lines]

    def values(self, name: str) -> list[str]:
        """Return the values that something was changed to."""
        return [value for _, what, value in self.changes() if what == name]


def rig_command(*arguments) -> list[str]:
    return [sys.executable, "-m", "rig", *map(str, arguments)]


@contextmanager
def served(folder: Path, *arguments) -> Iterator[Served]:
    log, config = folder / "changes.log", folder / "served.toml"
    command = rig_command("sim", "serve", "--log", log, "--write-config", config, *arguments)
    said = folder / "server.txt"
    with (
        said.open("w") as err,
        subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=err) as process,
    ):
        try:
            document = b""
            while not document.endswith(b"\n}\n") and (line := process.stdout.readline()):
                document += line
            assert document, said.read_text()
            yield Served(process, json.loads(document), log, config)
        finally:
            process.terminate()
            process.wait(20)


def scan_served(rig, bench: Served, out: Path, *options):
    """Scan a served bench, and return how that ended: 0."""
    done = rig("scan", "--config", bench.config, "--out", out, "--yes", *options)
    assert done.code == 0, done.err
    return done
