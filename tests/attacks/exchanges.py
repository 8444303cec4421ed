"""A fault at the k-th exchange of any wire of a tiny scan, for every k.

PYTHONPATH=tests python -m attacks.exchanges [FAULT...] [--every 25]

Each scan is judged by the bench's physical state at its end, by what was said, by the file's counts, and by
whether `rig resume` ends it as if nothing had happened. Results are printed as a table.
"""

import sys
import tempfile
import time
from argparse import ArgumentParser
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from attacks.scene import End, Kept, attacked_rig, kept, scan, tiny_config, tiny_plan
from attacks.taps import Fault, Tap
from drivers.errors import DeviceError
from rig.acquire import acquisition
from rig.errors import DataFileError, RigError
from rig.files.journal import journal_of

#: What goes wrong at an exchange, as the table calls it.
FAULTS = {
    "raises, once": Fault("raise"),
    "times out, once": Fault("time out"),
    "dropped, once": Fault("drop"),
    "one bit flipped": Fault("flip"),
    "empty reply": Fault("empty"),
    "twice": Fault("twice"),
    "dead from then on": Fault("raise", lasting=True),
    "mute from then on": Fault("drop", lasting=True),
    "times out from then on": Fault("time out", lasting=True),
    "1 KeyboardInterrupt": Fault("interrupt"),
    "3 in a row": Fault("interrupt", times=3),
    "10 in a row": Fault("interrupt", times=10),
}

#: The section of each kind of laser.
LASERS = {
    "katana": {"power_setpoint": 10.0},
    "katana-08hp": {"kind": "katana-08hp", "power": "3.1W"},
    "nkt": {"kind": "nkt", "level_percent": 100},
}

#: The sections of each kind of detector; one that runs freely bears little light.
DETECTORS = {
    "mpd": {"detector": {"kind": "mpd"}},
    "id120": {"detector": {"kind": "id120"}, "laser": {"power_setpoint": 0.01}},
}

#: Words that tell of a laser that may emit, and of a detector that may detect, or of its delayer.
EMITTING, SENSITIVE = "EMITTING", ("BIASED", "gate as OPEN")

#: Calls of the timing instrument's library that say that all is well and leave no trace if they did nothing.
UNSEEN = "tcspc"


@dataclass(frozen=True)
class Outcome:
    """One scan: where the fault was, how it ended, and what the file and its resumption gave.

    Attributes
    ----------
    struck
        Device and operation.
    end
        How the scan ended.
    file
        ``absent``, ``unreadable`` or its status.
    wrong
        Positions that are marked as measured and whose counts differ from those of the uninterrupted scan.
    resumed
        ``equal``, or what was not.
    """

    struck: tuple[str, str]
    end: End
    file: str
    wrong: int
    resumed: str

    @property
    def told(self) -> bool:
        """Whether whatever was left on was told."""
        light = not self.end.emitting or EMITTING in self.end.said
        return light and (not self.end.sensitive or self.detector_told)

    @property
    def detector_told(self) -> bool:
        """Whether a person was told of the detector."""
        return any(words in self.end.said for words in SENSITIVE)


class Attacked:
    """The tiny scan, and how it ends when nothing goes wrong.

    Parameters
    ----------
    folder
        For scan files.
    laser
        Kind of laser.
    detector
        Kind of detector.
    """

    def __init__(self, folder: Path, laser: str = "katana", detector: str = "mpd") -> None:
        self._folder = folder
        self._config = tiny_config({"laser": LASERS[laser], **DETECTORS[detector]})
        self._plan = tiny_plan(self._config)
        tap = Tap()
        reference = folder / "reference.h5"
        end = self._scan(tap, reference)
        assert end.code == 0, end
        self.exchanges = tuple(tap.seen)
        self._counts = kept(reference).counts

    def outcomes(self, fault: Fault, every: int, begin: int = 0) -> Iterator[Outcome]:
        """Put a fault into each exchange in turn, or into every so many."""
        for first in range(begin, len(self.exchanges), every):
            yield self.outcome(fault, first)

    def outcome(self, fault: Fault, first: int) -> Outcome:
        """Put a fault into one exchange."""
        path = self._folder / "a.h5"
        for left in (path, journal_of(path), path.with_suffix(".log")):
            left.unlink(missing_ok=True)
        tap = Tap(fault, first)
        end = self._scan(tap, path)
        file = _read(path)
        status = file.status if isinstance(file, Kept) else file
        wrong = self._wrong(file) if isinstance(file, Kept) else 0
        return Outcome(tap.struck or ("", ""), end, status, wrong, self._resumed(path, status))

    def _scan(self, tap: Tap, path: Path) -> End:
        with attacked_rig(self._config, tap) as rig:
            return scan(rig, self._config, self._plan, path)

    def _wrong(self, file: Kept) -> int:
        differs = (file.counts != self._counts).any(axis=1)
        return int(np.count_nonzero(differs & file.done))

    def _resumed(self, path: Path, status: str) -> str:
        """Take the scan up again where it was interrupted, on a rig without faults."""
        if status == "absent":
            return "equal"  # the next scan begins anew
        try:
            if status != "complete":
                acquisition.resume(*acquisition.interrupted(path), path)
            file = kept(path)
        except (RigError, DeviceError) as error:
            return f"refused: {error}"
        except Exception as error:
            return f"{type(error).__name__}: {error}"
        same = file.status == "complete" and file.done.all() and not self._wrong(file)
        return "equal" if same else "differs"


def _read(path: Path) -> Kept | str:
    if not (path.exists() or journal_of(path).exists()):
        return "absent"
    try:
        return kept(path)
    except DataFileError:
        return "unreadable"


HEADER = (
    "fault", "runs", "exit 0 / 3 / 4 / 6 / 1 / 130", "laser on", "of these told", "detector sensitive",
    "of these told", "unreadable", "wrong", "resume not equal",
)  # fmt: skip


def row(name: str, outcomes: Iterable[Outcome]) -> tuple[str, ...]:
    """Return a row of the table."""
    every = list(outcomes)
    codes = Counter(one.end.code for one in every)
    lit = [one for one in every if one.end.emitting]
    sensitive = [one for one in every if one.end.sensitive]
    return (
        name,
        str(len(every)),
        " / ".join(str(codes[code]) for code in (0, 3, 4, 6, 1, 130)),
        str(len(lit)),
        str(sum(EMITTING in one.end.said for one in lit)),
        str(len(sensitive)),
        str(sum(one.detector_told for one in sensitive)),
        str(sum(one.file == "unreadable" for one in every)),
        str(sum(one.wrong > 0 for one in every)),
        str(sum(one.resumed != "equal" for one in every)),
    )


def bad(one: Outcome) -> str:
    """Return what is bad about an end, empty where nothing is."""
    found = []
    if not one.told:
        found.append("left on and not told")
    if one.end.code == 1:
        found.append("a defect")
    if one.file == "unreadable":
        found.append("unreadable")
    if one.wrong:
        found.append(f"{one.wrong} positions wrong")
    if one.resumed != "equal":
        found.append(f"resume: {one.resumed}")
    return ", ".join(found)


def main() -> None:
    """Run attacks from the command line, and print the table."""
    parser = ArgumentParser(description="Put faults into the exchanges of a tiny scan, and judge the end.")
    parser.add_argument("faults", nargs="*", help=f"by default all: {', '.join(FAULTS)}")
    parser.add_argument("--every", type=int, default=1, help="try each so many exchanges")
    parser.add_argument("--laser", choices=list(LASERS), default="katana", help="kind of laser")
    parser.add_argument("--detector", choices=list(DETECTORS), default="mpd", help="kind of detector")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        attacked = Attacked(Path(folder), given.laser, given.detector)
        by_device = Counter(device for device, _ in attacked.exchanges)
        counted = ", ".join(f"{number} {device}" for device, number in by_device.items())
        print(f"{len(attacked.exchanges)} exchanges: {counted}\n")
        print("| " + " | ".join(HEADER) + " |\n" + "| --- " * len(HEADER) + "|")
        for name in given.faults or FAULTS:
            began_s = time.monotonic()
            outcomes = list(attacked.outcomes(FAULTS[name], given.every))
            print("| " + " | ".join(row(name, outcomes)) + " |", flush=True)
            print(f"{name}: {time.monotonic() - began_s:.0f} s", file=sys.stderr)
            for number, one in enumerate(outcomes):
                if what := bad(one):
                    print(f"  {number * given.every} {one.struck}: {what}: {one.end}", file=sys.stderr)


if __name__ == "__main__":
    main()
