"""The two files of a probe: a transcript for people, and the same for programs."""

import json
import platform
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import rig
from rig.acquire.probing.private import Placeholders
from rig.acquire.probing.run import Settled
from rig.acquire.probing.transcript import DeviceTranscript, json_lines, text_lines
from rig.atomic import appearing
from rig.errors import UsageError, reason

TEXT, LINES = "transcript.txt", "transcript.jsonl"

LEFT_OUT = (
    "Left out: serial numbers, names of users, computers and the rig, addresses and paths. "
    "The same value has the same placeholder everywhere, e.g. <serial 1>."
)
#: Said where the answers are a simulator's.
SIMULATED = (
    "These devices are simulated: the answers are from this program, and prove nothing about a real device."
)


def refuse_existing(folder: Path) -> None:
    """Refuse to write over a transcript.

    Raises
    ------
    UsageError
        If the folder has one, or is no folder.
    """
    for name in (TEXT, LINES):
        if (folder / name).exists():
            raise UsageError(f"{folder / name} exists and is not overwritten; give another --out")
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"{folder} is not a folder; give another --out")


def write(
    folder: Path,
    devices: list[DeviceTranscript],
    facts: list[Settled],
    hidden: Placeholders,
    *,
    simulated: bool,
) -> None:
    """Write both files into a folder, which is made.

    Raises
    ------
    UsageError
        If it cannot be written.
    """
    about = {
        "when": datetime.now(UTC).isoformat(timespec="seconds"),
        "rig": rig.__version__,
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "pyserial": version("pyserial"),
        "pyusb": version("pyusb"),
    }
    text = [
        f"# rig devices probe: {', '.join(f'{name} {value}' for name, value in about.items())}",
        *([f"# {SIMULATED}"] if simulated else []),
        f"# {LEFT_OUT}",
        "# > to the device, < from it; on USB in hexadecimal; after it the time since the start",
        *text_lines(devices, hidden),
        "",
        *_facts_as_text(facts),
    ]
    lines = [
        json.dumps({"format": "rig-probe", "version": 1, "simulated": simulated, **about}),
        *json_lines(devices, hidden),
        *(json.dumps(as_dict(one)) for one in facts),
    ]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _write(folder / TEXT, text)
        _write(folder / LINES, lines)
    except OSError as problem:
        raise UsageError(f"{folder} cannot be written ({reason(problem)}); give another --out") from None


def as_dict(one: Settled) -> dict[str, str]:
    """Return what became of a fact, for programs."""
    fact = one.fact
    return {
        "fact": fact.name,
        "device": fact.section,
        "kind": fact.kind,
        "believed": fact.believed,
        "settled_by": fact.settled_by,
        "verdict": one.verdict.value,
        "came": one.came,
    }


def _facts_as_text(facts: Iterable[Settled]) -> Iterator[str]:
    yield "# ---- what this shows ----"
    for one in facts:
        yield f"# {one.verdict.value}: {one.fact.name}, by {one.fact.settled_by}: {one.came}"
        yield f"#     {one.fact.believed}"


def _write(path: Path, lines: Iterable[str]) -> None:
    with appearing(path) as partial:
        partial.write_text("\n".join(lines) + "\n", encoding="utf-8")
