"""What a scan file says beside its photons: quick to read, whatever its size."""

from functools import cached_property
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.errors import DataFileError, in_shell
from rig.files import content, mend
from rig.files.blocks import read
from rig.files.check import check_format, check_layout, plain, reading
from rig.files.content import Note
from rig.files.journal import Journal
from rig.files.layout import SCANS
from rig.files.recorded import RecordedFile
from rig.model.calibrations.chosen import Calibrations
from rig.model.calibrations.chosen import recorded as recorded_calibrations
from rig.model.plan import ScanPlan
from rig.model.state import RigState


class ScanOutline(RecordedFile):
    """A scan file, read without its photons and without their checksums; use as a context manager.

    Attributes
    ----------
    path
        Where it is.
    version
        Of its layout.
    steps
        Steps planned S.
    growing
        Whether a scan writes it: what was on disk when it was opened is here.
    mended
        What was done to read the file in spite of its program's end, in words; empty if nothing.

    Raises
    ------
    DataFileError
        If the file is missing, truncated, foreign, or lacks what is needed.
    """

    def _open(self) -> h5py.File:
        self.mended, self.growing = "", False
        journal = mend.open_journal(self.path, alone=False)
        if journal is None:
            return super()._open()
        try:
            self.digested, self.growing = journal.path, journal.growing
            return self._open_mended(journal)
        finally:
            journal.close()

    def _open_mended(self, journal: Journal) -> h5py.File:
        self.mended = why_mended(self.path, journal)
        return mend.outline(journal)

    def _read(self) -> None:
        self.version = check_format(self.path, self._file, "rig-scan", tuple(SCANS))
        self._sizes = check_layout(self.path, self._file, SCANS[self.version])
        self.steps = self._sizes["steps"]

    @property
    def status(self) -> str:
        """``running``, ``complete``, ``interrupted`` or ``failed``."""
        return "running" if self.growing else str(self._attribute("stop", "status", "interrupted"))

    @property
    def reason(self) -> str:
        """Why the run ended, in words."""
        unsaid = "" if "stop" in self._file or self.growing else "it has no closing record"
        return str(self._attribute("stop", "reason", unsaid))

    @property
    def photons(self) -> int:
        """Sum of all counts as the closing record has it; 0 without one."""
        return int(self._attribute("stop", "photons", 0))

    @property
    def closed(self) -> bool:
        """Whether it has a closing record."""
        return "stop" in self._file

    @cached_property
    def marked(self) -> NDArray[np.bool_]:
        """(S,) which steps are marked as measured."""
        with reading(self.path):
            transients = self._file["transients"]
            return (
                read(transients["done"]).astype(bool) if "done" in transients else np.ones(self.steps, bool)
            )

    @property
    def live_time_s(self) -> NDArray[np.float32]:
        """(S,) measurement time of each step; NaN where unknown.

        Raises
        ------
        DataFileError
            If one is infinite or negative.
        """
        if "live_time_s" not in self._file["transients"]:
            return np.full(self.steps, np.nan, np.float32)
        with reading(self.path):
            found = read(self._file["transients/live_time_s"]).astype(np.float32)
        wrong = np.flatnonzero(np.isinf(found) | (found < 0))
        if len(wrong):
            raise DataFileError(
                f"{self.path}: /transients/live_time_s of step {wrong[0]} is {found[wrong[0]]:g}, "
                "which is not a time; the file is damaged: copy it again from where it came from"
            )
        return found

    @property
    def notes(self) -> dict[str, str]:
        """What people said of it: ``operator``, ``sample``, ``purpose`` and ``note``, as far as they did."""
        with reading(self.path):
            said = dict(self._file["notes"].attrs) if "notes" in self._file else {}
            return {name: str(plain(text)) for name, text in said.items() if name != "description"}

    @property
    def events(self) -> list[Note]:
        """What happened during the scan, in the order in which it began."""
        with reading(self.path):
            return content.read_events(self._file)

    @property
    def warnings(self) -> list[str]:
        """What went less than well, each sentence once."""
        noted = [note.sentence for note in self.events if note.kind == "warning"]
        return list(dict.fromkeys([*map(str, self._json("stop", "warnings", "[]", list)), *noted]))

    @cached_property
    def plan(self) -> ScanPlan | None:
        """The scan plan; None where the file does not say.

        Raises
        ------
        DataFileError
            If it is damaged.
        """
        text = str(self._attribute("start", "plan", "{}"))
        return None if text == "{}" else ScanPlan.from_json(text, self.path)

    @property
    def frames(self) -> int:
        """How often all positions were to be visited, all passes together."""
        passes = self.plan.passes if self.plan and len(self.plan) == self.steps else ()
        return sum(one.frames for one in passes) or 1

    @cached_property
    def calibrations(self) -> Calibrations:
        """The calibrations that the scan used.

        Raises
        ------
        DataFileError
            If one is damaged.
        """
        with reading(self.path):
            group = self._file.get("calibration", {})
            documents = {kind: dataset.asstr()[()] for kind, dataset in group.items()}
            beside = self._file.get("calibration_data", {})
            arrays = {name: read(dataset) for name, dataset in beside.items()}
        return recorded_calibrations(documents, arrays, self.path)

    @cached_property
    def state(self) -> RigState | None:
        """The rig as it was; None where the file does not say.

        Raises
        ------
        DataFileError
            If it is damaged, or of a newer program.
        """
        return RigState(self.config, self.calibrations) if self.config else None

    @property
    def imported(self) -> dict[str, Any]:
        """File, sha256, layout and assumptions of an import; empty for a scan."""
        found: dict[str, Any] = self._json("start", "imported", "{}", dict)
        return found

    @property
    def estimated(self) -> list[str]:
        """Values that the imported file lacked and that were estimated from its data, in words."""
        with reading(self.path):
            return [str(value["words"]) for value in self.imported.get("estimated", ())]

    @property
    def tagged(self) -> bool:
        """Whether the file holds the bin index of each photon rather than histograms."""
        return "photons" in self._file["transients"]

    @property
    def expectation(self) -> bool:
        """Whether the counts are a rendered or processed signal rather than photons."""
        counts = self._file["transients"].get("counts")
        return counts is not None and plain(counts.attrs.get("kind")) == "expectation"


def why_mended(path: Path, journal: Journal) -> str:
    """Say why a scan file is read from its journal."""
    if journal.growing:
        return f"{path} is being written by a scan: only the lines that are finished are read"
    told = (
        f"{path} was not closed by the program that wrote it: it is read from its journal, {journal.path}, "
        f"and was not changed. {in_shell('rig', 'resume', path)} continues it"
    )
    torn = journal.torn_bytes
    return told + (f". The journal's last {torn} bytes are incomplete and were left out" if torn else "")
