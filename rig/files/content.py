"""What is written into a scan file: by the writer, and again where it is made from its journal."""

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.files.description import Settings
from rig.files.layout import SCAN
from rig.files.opened import hdf5_file
from rig.model.plan import MAX_STEPS

#: A row of the table of events.
EVENT = np.dtype(
    [
        ("utc", h5py.string_dtype()),
        ("first", "<i8"),
        ("last", "<i8"),
        ("kind", h5py.string_dtype()),
        ("sentence", h5py.string_dtype()),
    ]
)


@dataclass(frozen=True)
class Note:
    """Something that happened during a scan.

    Attributes
    ----------
    utc
        When it began, UTC, ISO 8601.
    first, last
        The steps that it concerns.
    kind
        ``warning``, or what else it is.
    sentence
        What happened, in words.
    """

    utc: str
    first: int
    last: int
    kind: str
    sentence: str


def mark(file: h5py.File, first: int, live_time_s: NDArray[np.float32]) -> None:
    """Mark steps as measured; their counts must be there."""
    steps = slice(first, first + len(live_time_s))
    file["transients/live_time_s"][steps] = live_time_s
    file["transients/done"][steps] = True


def unmark(file: h5py.File, first: int) -> None:
    """Take back the marks of all steps from ``first`` on."""
    file["transients/done"][first:] = False
    file["transients/live_time_s"][first:] = np.nan


def grow(file: h5py.File, plan: str) -> None:
    """Let a file have the frames of a longer plan: the positions of the first once more, not measured.

    Parameters
    ----------
    file
        Of a scan whose frames go on until it is stopped.
    plan
        The longer plan, as JSON.

    Raises
    ------
    ValueError
        If it has no more frames, or more positions than any scan.
    """
    transients, start = file["transients"], file["start"].attrs
    steps = len(transients["done"])
    before, frames = (json.loads(one)["passes"][0]["frames"] for one in (start["plan"], plan))
    size = steps // before
    if not before < frames <= MAX_STEPS // size:
        raise ValueError(f"{before} frames of {size} positions cannot become {frames}")
    channels = (len(transients["photon_offset"]) - 1) // steps
    for name in ("laser_m", "mirror_rad"):
        positions = file["geometry"].get(name)
        if positions is not None:
            of_a_frame = positions[:size]
            positions.resize(frames * size, axis=0)
            for first in range(steps, frames * size, size):
                positions[first : first + size] = of_a_frame
    for name in ("done", "live_time_s", "step_checksum"):
        transients[name].resize((frames * size,))
    transients["live_time_s"][steps:] = np.nan
    transients["photon_offset"].resize((frames * size * channels + 1,))
    start["plan"] = plan


def write_devices(file: h5py.File, devices: Mapping[str, Settings], pass_index: int) -> None:
    """Write what each device said before a pass, in place of what was there."""
    if pass_index:
        group = file.require_group("passes").require_group(str(pass_index))
        group.attrs.update({name: json.dumps(dict(said)) for name, said in devices.items()})
    else:
        for name, settings in devices.items():
            file["devices"].require_group(name).attrs.update(settings)


def write_event(file: h5py.File, row: int, note: Note) -> None:
    """Write a row of the table of events."""
    if "events" not in file:
        create_events(file)
    table = file["events"]
    if len(table) <= row:
        table.resize((row + 1,))
    table[row] = np.array([astuple(note)], EVENT)[0]


def create_events(file: h5py.File) -> None:
    """Make an empty table of events."""
    table = file.create_dataset("events", (0,), EVENT, maxshape=(None,), chunks=(64,))
    table.attrs["description"] = SCAN["/events"].what


def read_events(file: h5py.File) -> list[Note]:
    """Return the rows of the table of events."""
    if "events" not in file:
        return []
    return [
        Note(
            _text(row["utc"]), int(row["first"]), int(row["last"]), _text(row["kind"]), _text(row["sentence"])
        )
        for row in file["events"][()]
    ]


def _text(value: bytes | str) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value


def reopen(file: h5py.File, when: str) -> None:
    """Note that the scan was taken up again, and take its closing record away."""
    file.pop("stop", None)
    attributes = file["start"].attrs
    attributes["resumed"] = json.dumps([*json.loads(attributes.get("resumed", "[]")), when])


def write_cut(file: h5py.File, step: int, counts: NDArray, live_time_s: float) -> None:
    """Write the counts of an exposure that was cut short, beside what was measured."""
    group = file.require_group("unfinished")
    group.attrs["description"] = SCAN["/unfinished"].what
    one = group.create_dataset(str(len(group)), data=counts, compression="gzip", shuffle=True)
    one.attrs.update({"step": step, "live_time_s": live_time_s})


def write_stop(file: h5py.File, said: Mapping[str, Any]) -> None:
    """Write the closing record."""
    stop = file.require_group("stop")
    stop.attrs["description"] = SCAN["/stop"].what
    stop.attrs.update(said)


def datasets(file: h5py.File) -> list[h5py.Dataset]:
    """Return the datasets that are written to, to be held as long as the file is open.

    HDF5 writes when the last handle of a dataset goes; if it cannot write then, it crashes later.
    """
    return [*file["transients"].values(), *(file[name] for name in ("events",) if name in file)]


@contextmanager
def written(path: Path) -> Iterator[h5py.File]:
    """Open a file to be written to; after a failure nothing more is written.

    Raises
    ------
    OSError, RuntimeError
        If it cannot be written.
    """
    file = hdf5_file(path, "r+")
    try:
        held = datasets(file)
        yield file
        file.flush()
        held.clear()
    except BaseException:
        let_go(file)
        raise
    file.close()


def let_go(file: h5py.File) -> None:
    """Close a file to which nothing may be written any more: what HDF5 still holds of it goes nowhere.

    A file that HDF5 could not close makes it crash later. The null device takes all that it writes, whatever
    the limit on the size of files is.
    """
    with suppress(OSError, RuntimeError):
        elsewhere = os.open(os.devnull, os.O_RDWR)
        os.dup2(elsewhere, file.id.get_vfd_handle())
        os.close(elsewhere)
        file.close()
