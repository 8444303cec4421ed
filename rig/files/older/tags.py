"""What an older head says, under the names that the tags of a unified file have."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


def record_tags(
    bits: int, kind: int, number: int, resolution_s: float, unit_s: float | None
) -> dict[str, Any]:
    """Return the tags of time-tagged records.

    Parameters
    ----------
    bits
        Of a record.
    kind, number
        Type of the records, and how many there are.
    resolution_s
        Width of a bin.
    unit_s
        What tags count; None if the head does not say it.
    """
    tags = {
        "TTResultFormat_BitsPerRecord": bits,
        "TTResultFormat_TTTRRecType": kind,
        "TTResult_NumberOfRecords": number,
        "MeasDesc_Resolution": resolution_s,
    }
    return tags if unit_s is None else tags | {"MeasDesc_GlobalResolution": unit_s}


def histogram_tags(
    bits: int,
    place: NDArray[np.integer],
    bins: NDArray[np.integer],
    width_s: NDArray[np.floating],
    offset_ns: NDArray[Any],
) -> dict[str, Any]:
    """Return the tags of histograms.

    Parameters
    ----------
    bits
        Of a bin.
    place
        (curves,) where each begins in the file [bytes].
    bins, width_s, offset_ns
        (curves,) how many bins each has, how wide they are, and when the first begins.
    """
    return {
        "HistoResult_NumberOfCurves": len(place),
        "HistoResult_BitsPerBin": bits,
        "HistResDscr_DataOffset": place.tolist(),
        "HistResDscr_HistogramBins": bins.tolist(),
        "HistResDscr_MDescResolution": width_s.tolist(),
        "HistResDscr_MDescOffset": offset_ns.tolist(),
    }
