"""Heads of a HydraHarp 400: ``.ht2``, ``.ht3`` (records) and ``.hhd`` (histograms), formats 1.0 and 2.0.

Sources: the fields and their order are those of libpicoquant (T. Bischof, ``hh_v10.h``, ``hh_v20.h``) and
of phconvert's reader of ``.ht3``, which agree. An ``.ht2`` and an ``.ht3`` of each format, and an ``.hhd`` of
1.0, prove them. Both formats have the same head, and differ in their records as the record types of
unified files do.

The times of ``.ht2`` 1.0 count 0.5 ps, though its head gives 1 ps as the base resolution. A wrap takes
16.8 us or 33.6 us accordingly, and the 174.6 thousand records a second of a real file are then 115.0 or 144.8
thousand photons; its rate meters add up to 115.5 (libpicoquant says 0.5 ps, too). That times of ``.ht2`` 2.0
wrap after 2^25 is the vendor's word for the same records in unified files; libpicoquant has 33,552,000.
UNCONFIRMED: no file is long enough to tell.
"""

from typing import Any

import numpy as np

from rig.files.older.fields import CREATED, DISPLAY, Fields, integers, table
from rig.files.older.tags import histogram_tags, record_tags

VERSIONS = ("1.0", "2.0")

_MAIN = table(
    *CREATED,
    *integers("curves bits active mode submode binning"),
    ("resolution_ps", "<f8"),
    *integers("offset_ns acquisition_ms stop_at stop_on_overflow restart logarithmic"),
    ("pad", "<u4", (4,)),
    *DISPLAY,
    ("model", "S16"),
    ("part", "S8"),
    *integers("serial modules"),
    ("pad", "<i4", (10, 2)),
    ("base_resolution_ps", "<f8"),
    ("enabled", "<i8"),
    *integers("inputs reference external markers sync_divider"),
    *integers("sync_level_mv sync_zero_mv sync_offset_ps"),
)
_INPUT = table(*integers("module level_mv zero_mv offset_ps"))
_RATE = table(("rate_hz", "<i4"))
_RECORDS = table(*integers("sync_hz stopped_after_ms stop_reason image_words"), ("records", "<i8"))
_CURVE = table(
    *integers("index recorded"),
    ("model", "S16"),
    ("part", "S8"),
    *integers("serial modules"),
    ("pad", "<i4", (10, 2)),
    ("base_resolution_ps", "<f8"),
    ("enabled", "<i8"),
    *integers("inputs reference external markers sync_divider sync_level_mv sync_zero_mv sync_offset_ps"),
    *integers("input_module input_level_mv input_zero_mv input_offset_ps input mode submode binning"),
    ("resolution_ps", "<f8"),
    *integers("offset_ns acquisition_ms stopped_after_ms stop_reason"),
    ("pad", "<f4", (3,)),
    *integers("sync_hz input_hz histogram_hz"),
    ("photons", "<i8"),
    *integers("bins place"),
)
#: Modes of measurement.
_HISTOGRAMS, _T2, _T3 = 0, 2, 3
#: By format and mode: type of the records in a unified file.
_TYPES = {
    ("1.0", _T2): 0x00010204,
    ("1.0", _T3): 0x00010304,
    ("2.0", _T2): 0x01010204,
    ("2.0", _T3): 0x01010304,
}
#: What the times of T2 count.
_T2_UNIT_S = {"1.0": 0.5e-12, "2.0": 1e-12}


def read(fields: Fields, version: str) -> dict[str, Any]:
    """Read the head, as the tags of a unified file.

    Raises
    ------
    DataFileError
        If it is damaged, or does not come to its end.
    """
    main = fields.take(_MAIN)
    mode = int(main["mode"])
    fields.rows(_INPUT, int(main["inputs"]), "input")
    if mode == _HISTOGRAMS:
        curves = fields.rows(_CURVE, int(main["curves"]), "curve")
        return histogram_tags(
            int(main["bits"]),
            curves["place"],
            curves["bins"],
            curves["resolution_ps"] * 1e-12,
            curves["offset_ns"],
        )
    if (version, mode) not in _TYPES:
        raise fields.damaged(f"that it was measured in mode {mode}, which is not 0, 2 or 3")
    fields.rows(_RATE, int(main["inputs"]), "rate")
    of_records = fields.take(_RECORDS)
    fields.rows(np.dtype("<u4"), int(of_records["image_words"]), "word of an image")
    sync_hz = int(of_records["sync_hz"])
    unit_s = _T2_UNIT_S[version] if mode == _T2 else 1 / sync_hz if sync_hz > 0 else None
    return record_tags(
        int(main["bits"]),
        _TYPES[version, mode],
        int(of_records["records"]),
        float(main["resolution_ps"]) * 1e-12,
        unit_s,
    )
