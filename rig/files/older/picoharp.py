"""Heads of a PicoHarp 300: ``.pt2``, ``.pt3`` (records) and ``.phd`` (histograms), format 2.0.

Sources: the fields and their order are those of libpicoquant (T. Bischof, ``ph_v20.h``) and of
phconvert's reader of ``.pt3``, which agree. A ``.phd`` proves the part that all three share, and the
curves. A board always has four routing inputs, whatever its head says (libpicoquant). UNCONFIRMED by a
file: what follows in ``.pt2`` and ``.pt3``, and that offsets count picoseconds (libpicoquant; in the file
all are zero, and those of the other instruments count nanoseconds).
"""

from typing import Any

import numpy as np

from rig.files.older.fields import CREATED, DISPLAY, Fields, integers, table
from rig.files.older.tags import histogram_tags, record_tags

VERSIONS = ("2.0",)

_MAIN = table(
    *CREATED,
    *integers("curves bits routing boards active mode submode range offset_ps"),
    *integers("acquisition_ms stop_at stop_on_overflow restart logarithmic"),
    ("pad", "<i4", (4,)),
    *DISPLAY,
)
_BOARD = table(
    ("model", "S16"),
    ("version", "S8"),
    *integers("serial sync_divider zero_0_mv level_0_mv zero_1_mv level_1_mv"),
    ("resolution_ns", "<f4"),
    *integers("router enabled"),
    ("pad", "<i4", (4, 6)),
)
_RECORDS = table(
    *integers("external pad_1 pad_2 rate_0_hz rate_1_hz stopped_after_ms stop_reason records image_words")
)
_CURVE = table(
    *integers("index recorded"),
    ("model", "S16"),
    ("version", "S8"),
    *integers("serial sync_divider zero_0_mv level_0_mv zero_1_mv level_1_mv offset_ps routing external"),
    *integers("mode submode"),
    ("pad", "<f4", (3,)),
    ("range", "<i4"),
    ("resolution_ns", "<f4"),
    *integers("bins acquisition_ms stopped_after_ms stop_reason rate_0_hz rate_1_hz histogram_hz"),
    ("photons", "<i8"),
    *integers("pad_1 place router enabled"),
    ("pad", "<i4", (6,)),
)
_HISTOGRAMS, _T2, _T3 = 0, 2, 3
_TYPES = {_T2: 0x00010203, _T3: 0x00010303}
_T2_UNIT_S = 4e-12


def read(fields: Fields, version: str) -> dict[str, Any]:
    """Read the head, as the tags of a unified file.

    Raises
    ------
    DataFileError
        If it is damaged, or does not come to its end.
    """
    main = fields.take(_MAIN)
    mode = int(main["mode"])
    boards = fields.rows(_BOARD, int(main["boards"]), "board")
    if mode == _HISTOGRAMS:
        curves = fields.rows(_CURVE, int(main["curves"]), "curve")
        width_s = curves["resolution_ns"] * 1e-9
        return histogram_tags(
            int(main["bits"]), curves["place"], curves["bins"], width_s, curves["offset_ps"] * 1e-3
        )
    if mode not in _TYPES or not len(boards):
        raise fields.damaged(f"mode {mode} (0, 2 and 3 are known) and {len(boards)} boards")
    of_records = fields.take(_RECORDS)
    fields.rows(np.dtype("<u4"), int(of_records["image_words"]), "word of an image")
    sync_hz = int(of_records["rate_0_hz"])
    unit_s = _T2_UNIT_S if mode == _T2 else 1 / sync_hz if sync_hz > 0 else None
    bin_s = float(boards["resolution_ns"][0]) * 1e-9
    return record_tags(int(main["bits"]), _TYPES[mode], int(of_records["records"]), bin_s, unit_s)
