"""Time-tagged records of a scan in PicoQuant's layout: their head, and a recorder that writes them.

The head says what T3 records these are, as the vendor's programs want it. Places, delays and what
else the layout has no form for are in tags of this program's own (`rig.files.picoquant`).
"""

import os
import shutil
import struct
import uuid
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from io import RawIOBase
from itertools import count
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.files.description import ScanDescription
from rig.files.mend import RESERVE_BYTES
from rig.files.picoquant import (
    BINS,
    DELAY,
    DETECTOR,
    EXPOSURE,
    FADE,
    FIRST_BIN,
    INPUTS,
    LAG,
    LASER,
    MAGIC_RECORDS,
    STEPS,
    SWEEPS,
    head_bytes,
    place_of,
)

#: The laser's rate where nobody says it, if the bins fit between two pulses [Hz].
RATE_HZ = 10e6
#: The overflow record: one wrap of 1024 sync pulses.
_WRAP, _OVERFLOW = 1024, 127 << 25
_COUNT = "TTResult_NumberOfRecords"
#: A line that fails is measured again, in a sweep of its own; so many of them have room in the head.
_REPEATED = 64
#: Spots of a line differ less than this across it [m].
_SAME_M = 1e-6


@dataclass(frozen=True)
class RecordedBy:
    """What a file says of the instrument that recorded; by default a HydraHarp 400.

    Attributes
    ----------
    hardware
        Its name.
    record_type
        Type of its T3 records; their layout is the same for all types that are written.
    base_s
        Its finest bin width.
    """

    hardware: str = "HydraHarp 400"
    record_type: int = 0x01010304
    base_s: float = 1e-12


@dataclass(frozen=True)
class RecordsHead:
    """What the head of a file of records says.

    Attributes
    ----------
    comment
        In words.
    laser_m
        (P, 3) spots, one for each marker of a point.
    detector_m
        (1 or P, C, 3) spots that the channels see.
    inputs
        Of the C channels.
    bins, bin_width_s, first_bin_s
        The time axis; the left edge of dtime 0.
    rate_hz
        Sync pulses a second.
    duration_s
        How long it lasts.
    delay_s
        (P, C) what to subtract for rectified time; None where that is nothing.
    fade_from_s
        Rectified time before which the record holds the wall's own light, where known.
    recorded_by
        The instrument.
    """

    comment: str
    laser_m: NDArray[np.float64]
    detector_m: NDArray[np.float64]
    inputs: tuple[int, ...]
    bins: int
    bin_width_s: float
    first_bin_s: float
    rate_hz: float
    duration_s: float
    delay_s: NDArray[np.float64] | None
    fade_from_s: float | None
    recorded_by: RecordedBy = RecordedBy()

    def tags(self) -> Iterator[tuple[str, Any]]:
        """Yield the tags: those that the layout demands, then our own; the number of records comes last."""
        yield "File_GUID", f"{{{str(uuid.uuid4()).upper()}}}"
        yield "CreatorSW_Name", "nlos-rig"
        yield "CreatorSW_Version", "1"
        yield "File_Comment", self.comment
        yield "Measurement_Mode", 3
        yield "Measurement_SubMode", 0
        yield "TTResult_StopReason", 0
        yield "TTResultFormat_TTTRRecType", self.recorded_by.record_type
        yield "TTResultFormat_BitsPerRecord", 32
        yield "MeasDesc_BinningFactor", max(1, round(self.bin_width_s / self.recorded_by.base_s))
        yield "MeasDesc_Offset", 0
        yield "MeasDesc_AcquisitionTime", max(1, round(self.duration_s * 1e3))
        yield "HW_Type", self.recorded_by.hardware
        yield "HW_BaseResolution", self.recorded_by.base_s
        yield "HW_InpChannels", max(self.inputs) + 1
        yield "HWSync_Divider", 1
        yield "MeasDesc_Resolution", self.bin_width_s
        yield "MeasDesc_GlobalResolution", 1 / self.rate_hz
        yield "TTResult_SyncRate", round(self.rate_hz)
        yield LASER, self.laser_m.ravel()
        yield DETECTOR, self.detector_m.ravel()
        yield INPUTS, np.array(self.inputs, float)
        yield FIRST_BIN, float(self.first_bin_s)
        yield BINS, self.bins
        if self.delay_s is not None:
            yield DELAY, self.delay_s.ravel()
        if self.fade_from_s is not None:
            yield FADE, float(self.fade_from_s)
        yield _COUNT, 0


def put_count(file: BinaryIO | RawIOBase, head: bytes, records: int) -> None:
    """Say in a file's head how many records it holds; its end is where writing goes on."""
    _put(file, place_of(head, _COUNT), struct.pack("<q", records))


def begins_line(laser_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (P,) at which points a line begins; it goes on as long as one coordinate stays."""
    begins = np.zeros(len(laser_m), bool)
    begins[0] = True
    moved = np.abs(np.diff(laser_m, axis=0)) > _SAME_M
    across = 0 if len(moved) and not moved[0, 0] else 1  # the coordinate that stays in the first line
    begins[1:] = moved[:, across]
    return begins


class PtuRecorder:
    """Writes the records of a timing instrument into a ``.ptu`` while it measures.

    They are in the file as they came, one sweep of the mirror after another: where the instrument counts its
    sync pulses from zero again, a record of 1024 further ones is put between, so that time goes on. The head
    says with which step each sweep began, and, at the end, how many records there are and how many steps can
    be trusted; a file that was not closed says 0 records, and is read up to its end.

    The records are there beside the scan file, which holds all that is needed. So a failure to write them,
    or a disk that gets full, ends them and never the scan: `problem` says why.

    Parameters
    ----------
    path
        The file, which must not exist.
    description
        The scan.
    first
        The step with which it goes on.
    sync_hz
        Sync pulses a second; None: as the laser is set.
    recorded_by
        The instrument.

    Raises
    ------
    UsageError
        If the file exists, or cannot be created.
    """

    def __init__(
        self,
        path: Path,
        description: ScanDescription,
        first: int = 0,
        sync_hz: float | None = None,
        recorded_by: RecordedBy = RecordedBy(),
    ) -> None:
        self.path = path
        self.problem = ""
        self._first = first
        self._head = head_bytes(MAGIC_RECORDS, _recorded_tags(description, first, sync_hz, recorded_by))
        self._room = _sweeps_room(description, first)
        self._sweeps = 0
        self._wraps = 0  # of all records, that is how often 1024 sync pulses went by
        try:
            # what the instrument gives at once is enough for a write: nothing is held that a kill could take
            self._file = path.open("xb", buffering=0)
            _write_all(self._file, self._head)
        except FileExistsError:
            raise UsageError(f"{path} exists and is not overwritten; move it away, or name another") from None
        except OSError as error:
            with suppress(OSError):
                path.unlink()
            raise UsageError(f"cannot create {path}: {error.strerror}") from None

    def add(self, words: NDArray[np.uint32], step: int | None = None) -> None:
        """Write records.

        Parameters
        ----------
        words
            (n,) as the instrument gives them; copied.
        step
            The step that is measured next, where the instrument counts its sync pulses from zero again.
        """
        if self.problem or self._file.closed:
            return
        try:
            if step is not None:
                self._begin_sweep(step)
            self._write(words)
        except OSError as error:
            self._give_up(f"it cannot be written: {error.strerror}")

    def _begin_sweep(self, step: int) -> None:
        if self._sweeps == self._room:
            self._give_up(f"its header has room for {self._room} sweeps")
            return
        if self._sweeps:
            self._write(np.array([_OVERFLOW | 1], np.uint32))
        place = place_of(self._head, SWEEPS) + 8 + 16 * self._sweeps
        _put(self._file, place, struct.pack("<dd", self._wraps * _WRAP, step - self._first))
        self._sweeps += 1

    def _write(self, words: NDArray[np.uint32]) -> None:
        if self.problem:
            return
        free = shutil.disk_usage(self.path.absolute().parent).free
        # the scan file ends the scan before its own reserve is touched; this ends earlier
        if free < 4 * RESERVE_BYTES + words.nbytes:
            self._give_up(f"its disk has only {free / 1e6:.0f} MB free")
            return
        _write_all(self._file, np.ascontiguousarray(words, "<u4").tobytes())
        overflows = words[words >> np.uint32(25) == 127] & np.uint32(_WRAP - 1)
        self._wraps += int(np.maximum(overflows, 1).sum())

    def _give_up(self, reason: str) -> None:
        self.problem = (
            f"{self.path.name} ends here, {reason}. The scan goes on, and its file holds all photons of its "
            "positions"
        )
        with suppress(OSError):
            self._shut(-1)

    def close(self, steps: int | None) -> None:
        """End the file; one without records goes.

        Parameters
        ----------
        steps
            How many steps of the scan can be trusted; None where it did not come to its end.
        """
        if self.problem or self._file.closed:
            return
        try:
            self._shut(-1 if steps is None else steps - self._first)
            if not self._sweeps:
                self.path.unlink()
        except OSError as error:
            self.problem = f"{self.path.name} could not be closed properly: {error.strerror}"

    def _shut(self, steps: int) -> None:
        """Complete the head and close the file; a record that was not wholly written is left out."""
        with self._file as file:
            records = (file.seek(0, os.SEEK_END) - len(self._head)) // 4
            file.truncate(len(self._head) + 4 * records)
            _put(file, place_of(self._head, STEPS), struct.pack("<q", steps))
            put_count(file, self._head, records)
            os.fsync(file.fileno())


def beside(scan: Path, *, again: bool = False) -> Path:
    """Return where the records of a scan belong; ``again``: of one taken up again, where no others are."""
    path = scan.with_suffix(".ptu")
    if not (again and path.exists()):
        return path
    others = (scan.with_name(f"{scan.stem}-{number}.ptu") for number in count(2))
    return next(other for other in others if not other.exists())


def _recorded_tags(
    description: ScanDescription, first: int, sync_hz: float | None, recorded_by: RecordedBy
) -> Iterator[tuple[str, Any]]:
    state = description.state
    nominal_hz = state.config.laser.repetition_hz if state is not None else RATE_HZ
    exposure_s = description.plan.exposures_s[first:] if description.plan is not None else np.zeros(0)
    detector_m = description.detector_m.reshape(-1, description.channel_count, 3)
    delay_s = description.rectified_by_s()
    head = RecordsHead(
        comment="as recorded; marker 1: point, 2: first point of a line, without marker 1: its end, 3: frame",
        laser_m=description.laser_m[first:],
        detector_m=detector_m if len(detector_m) == 1 else detector_m[first:],
        inputs=tuple(one.input for one in description.channels) or tuple(range(description.channel_count)),
        bins=description.bins,
        bin_width_s=description.bin_width_s,
        first_bin_s=description.first_bin_s,
        rate_hz=sync_hz or nominal_hz,
        duration_s=float(exposure_s.sum()),
        delay_s=None if delay_s is None else delay_s[first:],
        fade_from_s=description.fade_from_s,
        recorded_by=recorded_by,
    )
    yield SWEEPS, np.full(2 * _sweeps_room(description, first), -1.0)
    yield STEPS, -1
    yield LAG, float(state.mirror_lag_s) if state is not None else 0.0
    yield EXPOSURE, exposure_s
    yield from head.tags()


def _sweeps_room(description: ScanDescription, first: int) -> int:
    """Return how many sweeps there can be: one for each line, and those that are repeated."""
    return int(np.count_nonzero(begins_line(description.laser_m[first:]))) + _REPEATED


def _put(file: BinaryIO | RawIOBase, place: int, data: bytes) -> None:
    """Write into the middle of a file; its end is where writing goes on."""
    file.seek(place)
    file.write(data)
    file.seek(0, os.SEEK_END)


def _write_all(file: RawIOBase, data: bytes) -> None:
    left = memoryview(data)
    while left:
        left = left[file.write(left) or 0 :]
