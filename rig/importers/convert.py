"""From a file of any known layout to a scan file."""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from recon.estimate import Estimate
from rig.errors import DataFileError, UsageError, in_shell, printable
from rig.files import ScanDescription, ScanWriter
from rig.importers import (
    ahn,
    aligned,
    cc_socr,
    cc_socr_cube,
    cmu,
    dirac,
    dlct,
    general_raw,
    lct,
    lindell2019,
    liu2019,
    liu2020,
    neutral,
    phu,
    ptu,
    rsd3d,
    tal,
    wu2021,
    xiao,
    znlos,
)
from rig.importers.content import Content
from rig.importers.estimated import completed, in_words
from rig.importers.held import hold_against
from rig.importers.options import Given, Options
from rig.importers.places import with_places
from rig.importers.plausible import plausible
from rig.importers.recognise import recognise
from rig.importers.source import open_source

#: Values that are turned into the file's type at once.
_PIECE_VALUES = 2**20

#: The known layouts: modules with NAME, SIGN (what they hold, in words), PARTS (the names that
#: tell them), recognise(source) and read(source, options).
LAYOUTS: tuple[ModuleType, ...] = (
    neutral,
    tal,
    znlos,
    liu2019,
    liu2020,
    lct,
    lindell2019,
    ahn,
    xiao,
    wu2021,
    cc_socr,
    cc_socr_cube,
    general_raw,
    rsd3d,
    aligned,
    cmu,
    dlct,
    dirac,
    ptu,
    phu,
)


@dataclass(frozen=True)
class ImportReport:
    """What an import found and did.

    Attributes
    ----------
    layout
        Name of the layout that was recognised.
    positions, bins
        Size of the scan.
    time_origin
        ``wall`` or ``laser``.
    assumed
        What the file did not say and was taken for granted, as plain sentences.
    """

    layout: str
    positions: int
    bins: int
    time_origin: str
    assumed: tuple[str, ...]


def import_scan(
    source: str | Path, target: str | Path, *, estimate: Sequence[str] = (), **given: Unpack[Given]
) -> ImportReport:
    """Read a file of a known layout, told by its content, and write it as a scan file.

    Parameters
    ----------
    source, target
        The file to read, and the scan file to make.
    estimate
        What to estimate from the data, of `rig.importers.estimated.NAMES`.
    **given
        What the file may lack; see `rig.importers.options.Given`.

    Raises
    ------
    UsageError
        If ``target`` exists, the file lacks something that was not given, or says otherwise than was given,
        or the data cannot tell what is to be estimated.
    DataFileError
        If the file is damaged, of no known layout, or of two. Then no ``target`` is left.
    """
    source, target = Path(source), Path(target)
    if target.exists():
        raise UsageError(f"{target} exists and is not overwritten; give another name, or move it away")
    with open_source(source) as opened:
        layout = recognise(opened, LAYOUTS)
        opened.require_written()
        found = completed(partial(layout.read, opened), given, estimate, source)
        options = Options(**found.given)
        content = hold_against(layout.read(opened, options), options, source, layout.NAME)
        content = plausible(found.applied(with_places(content, source)), source)
        if content.frame is not None:
            content = replace(content, assumed=(*content.assumed, content.frame.in_words()))
        _write(source, target, layout.NAME, content, found.estimates)
    return ImportReport(
        layout=layout.NAME,
        positions=len(content.laser_m),
        bins=content.bins,
        time_origin=content.time_origin,
        assumed=tuple(content.assumed),
    )


def _write(source: Path, target: Path, name: str, content: Content, estimates: tuple[Estimate, ...]) -> None:
    with source.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    imported: dict[str, Any] = {"file": source.name, "sha256": digest, "layout": name}
    imported["assumed"] = list(content.assumed)
    if estimates:
        imported["estimated"] = [{**vars(value), "words": in_words(value)} for value in estimates]
    if content.frame is not None and not content.frame.still:
        imported["moved"] = {"origin_m": content.frame.origin_m.tolist(), "axes": content.frame.axes.tolist()}
    description = ScanDescription(
        laser_m=content.laser_m[:: content.pixels or 1],
        detector_m=content.detector_m[None, : content.pixels] if content.pixels else content.detector_m,
        bins=content.bins,
        bin_width_s=content.bin_width_s,
        first_bin_s=content.first_bin_s,
        delays=content.delays,
        delay_s=content.delay_s,
        simulated=content.simulated,
        command=in_shell("rig", "import", printable(source.name)),
        fade_from_s=content.fade_from_s,
        instrument_response_s=content.instrument_response_s,
        dtype=content.dtype,
        imported=imported,
    )
    with ScanWriter.whole(target, description) as writer:
        for steps in _steps(source, content):
            writer.extend(steps)
        writer.close("complete", f"imported from {printable(source.name)}")


def _steps(source: Path, content: Content) -> Iterator[NDArray]:
    """Yield (steps, channels, bins) counts in the type of the scan file, a few megabytes at once."""
    for block in content.blocks:
        steps = block.reshape(-1, content.pixels or 1, content.bins)
        some = max(1, _PIECE_VALUES // max(1, steps[:1].size))
        for first in range(0, len(steps), some):
            with np.errstate(over="ignore"):
                piece = steps[first : first + some].astype(content.dtype, copy=False)
            if piece.dtype.kind == "f" and not np.isfinite(piece).all():
                raise DataFileError(
                    f"{source} holds a value that is not a finite number; it cannot be imaged"
                )
            yield piece
