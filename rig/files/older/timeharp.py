"""Heads of a TimeHarp 200: ``.thd`` (histograms), formats 2.0, 3.0, 5.0 and 6.0.

Sources: the fields and their order are those of libpicoquant (T. Bischof, ``th_v20.h`` to ``th_v60.h``); a
file of each format, with that program's text of it, proves them. Each curve is described right before its
counts. Records (``.t3r``) have the same head, and are not read.
"""

from typing import Any

import numpy as np

from rig.errors import DataFileError
from rig.files.older.fields import CREATED, DISPLAY, MOST_CURVES, Field, Fields, integers, table
from rig.files.older.tags import histogram_tags

VERSIONS = ("2.0", "3.0", "5.0", "6.0")

#: Formats before 6.0 name the hardware's version, not the program.
_OLD_BEGIN: tuple[Field, ...] = (
    ("pad", "S16"),
    ("pad", "S6"),
    ("pad", "S6"),
    ("pad", "S18"),
    ("pad", "S2"),
    ("pad", "S256"),
)
_BODY: tuple[Field, ...] = (
    *integers("bins curves bits routing boards active mode submode range offset_ns"),
    *integers("acquisition_ms stop_at stop_on_overflow restart logarithmic"),
    ("pad", "<i4", (4,)),
    *DISPLAY,
)
_BOARD: tuple[Field, ...] = (
    *integers("serial zero_mv level_mv sync_level_mv curve_offset"),
    ("resolution_ns", "<f4"),
)
_CURVE = table(
    *integers("index recorded serial zero_mv level_mv sync_level_mv curve_offset routing submode mode"),
    ("pad", "<f4", (3,)),
    *integers("range offset_ns acquisition_ms stopped_after_ms stop_reason"),
    *integers("sync_hz input_hz histogram_hz photons"),
    ("resolution_ns", "<f4"),
    ("pad", "<i4", (2,)),
)
_HISTOGRAMS, _RECORDS = 0, 2


def read(fields: Fields, version: str) -> dict[str, Any]:
    """Read the head, as the tags of a unified file.

    Raises
    ------
    DataFileError
        If it holds records, is damaged, or does not come to its end.
    """
    new = version == "6.0"
    main = fields.take(table(*(CREATED if new else _OLD_BEGIN), *_BODY))
    if int(main["mode"]) == _RECORDS:
        raise DataFileError(
            f"{fields.path} holds records of a TimeHarp 200 (.t3r), which are not read: save or convert it "
            "as .ptu"
        )
    if int(main["mode"]) != _HISTOGRAMS:
        raise fields.damaged(f"that it was measured in mode {int(main['mode'])}, which is not 0 or 2")
    board = table(("pad", "S16"), ("pad", "S8"), *_BOARD) if new else table(*_BOARD)
    fields.rows(board, int(main["boards"]), "board")
    return _curves(fields, int(main["curves"]), int(main["bins"]), int(main["bits"]))


def _curves(fields: Fields, number: int, bins: int, bits: int) -> dict[str, Any]:
    """Go from curve to curve; those of a file that was cut off are told of where they would lie."""
    if not 0 <= number <= MOST_CURVES or bins < 0:
        raise fields.damaged(f"{number:,} curves of {bins:,} bins")
    stride = _CURVE.itemsize + 4 * bins
    place = fields.place + _CURVE.itemsize + stride * np.arange(number)
    described = [_described(fields, at) for at in place[place <= fields.size].tolist()]
    if not described:
        raise fields.damaged(f"{number:,} curves, and the file holds none")
    fields.go_to(int(place[0]))
    there = np.array(described + described[-1:] * (number - len(described)))
    return histogram_tags(
        bits, place, np.full(number, bins), there["resolution_ns"] * 1e-9, there["offset_ns"]
    )


def _described(fields: Fields, place: int) -> Any:
    """Return what is said of the curve whose counts begin there."""
    fields.go_to(place - _CURVE.itemsize)
    return fields.take(_CURVE)
