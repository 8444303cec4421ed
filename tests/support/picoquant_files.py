"""PicoQuant's files, written for a test: records from photons and markers, one by one, and histograms."""

import struct

import numpy as np

from rig.files.picoquant import MAGIC_HISTOGRAMS, MAGIC_RECORDS, head_bytes

T3, T2 = 0x01010304, 0x01010204


def records_of(events):
    """Write T3 events (pulse, "photon", dtime, channel) and (pulse, "marker", mask) as records."""
    records, wraps = [], 0
    for pulse, kind, *values in events:
        if pulse // 1024 > wraps:
            records.append(1 << 31 | 63 << 25 | pulse // 1024 - wraps)
            wraps = pulse // 1024
        if kind == "marker":
            records.append(1 << 31 | values[0] << 25 | pulse % 1024)
        else:
            records.append(values[1] << 25 | values[0] << 10 | pulse % 1024)
    return np.array(records, "<u4")


def ptu(path, records, *, said=None, **changes):
    tags = {
        "Measurement_Mode": 3,
        "TTResultFormat_TTTRRecType": T3,
        "MeasDesc_Resolution": 16e-12,
        "MeasDesc_GlobalResolution": 100e-9,
        "TTResult_NumberOfRecords": len(records) if said is None else said,
    } | changes
    path.write_bytes(head_bytes(MAGIC_RECORDS, tags.items()) + records.tobytes())
    return path


def scan_events(points, photons, seed=1):
    """Return events of so many points, 5,000 pulses each, with markers 1 (point) and 2 (line of 3 points)."""
    rng = np.random.default_rng(seed)
    events = []
    for point in range(points):
        start = 5000 * point
        events.append((start, "marker", 1 if point % 3 else 3))
        pulses = np.sort(rng.integers(0, 5000, photons))
        events += [(start + int(pulse), "photon", int(rng.integers(100, 140)), 0) for pulse in pulses]
    return events


def counts_of(events, bins=range(100, 140)):
    """(points, bins) counts, added up event by event."""
    rows = []
    for _, kind, *values in events:
        if kind == "marker":
            rows.append(np.zeros(len(bins), int))
        elif rows:
            rows[-1][values[0] - bins.start] += 1
    return np.array(rows)


def phu(path, counts, width_s=4e-12):
    """Write (curves, bins) counts."""
    curves, bins = counts.shape

    def head(first):
        tags = {
            "Measurement_Mode": 0,
            "Measurement_SubMode": 2,
            "HistoResult_NumberOfCurves": curves,
            "HistoResult_BitsPerBin": 32,
            "HistResDscr_DataOffset": [first + 4 * bins * curve for curve in range(curves)],
            "HistResDscr_HistogramBins": [bins] * curves,
            "HistResDscr_MDescResolution": [width_s] * curves,
        }
        return head_bytes(MAGIC_HISTOGRAMS, tags.items())

    first = len(head(0))
    path.write_bytes(head(first) + counts.astype("<u4").tobytes())
    return path


def put_tag(path, name, value):
    """Overwrite the eight bytes of a tag's value with a whole number."""
    content = bytearray(path.read_bytes())
    place = content.index(name.encode().ljust(32, b"\0")) + 40
    content[place : place + 8] = struct.pack("<q", value)
    path.write_bytes(content)
