"""PicoQuant's older files, written for a test with ``struct`` alone, field after field.

It shares nothing with the reader: a mistake in one of them shows.
"""

import struct

#: Sync pulses are 100 ns apart, bins are 16 ps wide.
PERIOD_PS, BIN_PS = 100_000, 16
POINT, LINE = 1, 2


def pack(*parts):
    """Return pairs of format and values as bytes, without gaps."""
    packed = b""
    for form, *values in parts:
        packed += struct.pack("<" + form, *values)
    return packed


def begin(instrument, version, created=True):
    """Return what a person can read of a head."""
    names = (("18s", b"AcqUI"), ("12s", b"1.2.0.0")) if created else (("6s", b"2.4"),)
    rest = ("18s", b"14/02/12 15:48:19"), ("2s", b"\r\n"), ("256s", b"a scan")
    return pack(("16s", instrument), ("6s", version), *names, *rest)


DISPLAY = pack(
    ("4i", 0, 2100, 0, 400_000), ("16i", *range(16)), ("9f", *range(9)), ("4i", 0, 1, 0, 0), ("20s", b"x")
)


def hydraharp(version, mode, *, inputs=2, curves=0, image=(), records=b"", said=None, tail=b""):
    """Return a ``.ht2`` (mode 2), a ``.ht3`` (mode 3) or the head of a ``.hhd`` (mode 0, with its tail)."""
    head = begin(b"HydraHarp", version)
    head += pack(("6i", curves, 32, 0, mode, 0, 4), ("d", BIN_PS), ("6i", 0, 10_000, -1, 0, 0, 1))
    head += DISPLAY + pack(
        ("16s", b"HydraHarp 400"), ("8s", b"930011"), ("2i", 1_000_000, 3), ("20i", *range(20))
    )
    head += pack(("d", 1.0), ("q", 15), ("8i", inputs, 0, 0, 15, 1, 200, 10, 0))
    head += b"".join(pack(("4i", n, 50, 10, 0)) for n in range(inputs))
    if mode == 0:
        return head + tail
    head += pack((f"{inputs}i", *range(inputs)), ("4i", 10_000_000, 10_000, 0, len(image)))
    head += pack(("q", len(records) // 4 if said is None else said), (f"{len(image)}I", *image))
    return head + records


def hhd(counts, version=b"1.0", bin_ps=4.0, offset_ns=0):
    """Return (curves, bins) counts as a ``.hhd``."""
    curves, bins = counts.shape
    first = len(hydraharp(version, 0)) + 264 * curves
    tail = b""
    for n, row in enumerate(counts):
        tail += pack(
            ("2i", n, 0), ("16s", b"HydraHarp 400"), ("8s", b"930011"), ("2i", 1, 3), ("20i", *range(20))
        )
        tail += pack(
            ("d", 1.0), ("q", 15), ("16i", *[2] * 16), ("d", bin_ps), ("4i", offset_ns, 1000, 1000, 0)
        )
        tail += pack(("3f", 0, 0, 0), ("3i", 1, 1, 1), ("q", row.sum()), ("2i", bins, first + 4 * bins * n))
    return hydraharp(version, 0, curves=curves, tail=tail + counts.astype("<u4").tobytes())


def thd(counts, version=b"6.0", bin_ns=0.004):
    """Return (curves, bins) counts as a ``.thd``."""
    curves, bins = counts.shape
    head = begin(b"TimeHarp 200", version, created=version == b"6.0")
    head += pack(("15i", bins, curves, 32, 1, 1, 0, 0, 0, 1, 0, 1000, 65_535, 0, 0, 1)) + DISPLAY
    if version == b"6.0":
        head += pack(("16s", b"TimeHarp 200"), ("8s", b"2.4"))
    head += pack(("5i", 17, 20, 80, -100, 0), ("f", bin_ns))
    for n, row in enumerate(counts):
        head += pack(("10i", n, *[1] * 9), ("3f", 0, 0, 0), ("5i", 1, 0, 1000, 1000, 0))
        head += (
            pack(("4i", 10_000_000, 1, 1, min(row.sum(), 2**31 - 1)), ("f", bin_ns), ("2i", 0, 0))
            + row.astype("<u4").tobytes()
        )
    return head


def picoharp(mode, *, curves=0, image=(), records=b"", tail=b""):
    """Return a ``.pt2`` (mode 2), a ``.pt3`` (mode 3) or the head of a ``.phd`` (mode 0, with its tail)."""
    head = begin(b"PicoHarp 300", b"2.0")
    head += pack(("14i", curves, 32, 1, 1, 0, mode, 0, 0, 0, 1000, -1, 0, 0, 1)) + DISPLAY
    head += pack(
        ("16s", b"PicoHarp 300"),
        ("8s", b"2.0"),
        ("6i", 1, 1, 10, 50, 10, 50),
        ("f", BIN_PS / 1e3),
        ("2i", 0, 0),
    )
    head += pack(("24i", *[0] * 24))
    if mode == 0:
        return head + tail
    head += pack(
        ("9i", 0, 0, 0, 10_000_000, 1000, 1000, 0, len(records) // 4, len(image)), (f"{len(image)}I", *image)
    )
    return head + records


def phd(counts, bin_ns=0.004):
    """Return (curves, bins) counts as a ``.phd``."""
    curves, bins = counts.shape
    first = len(picoharp(0)) + 172 * curves
    tail = b""
    for n, row in enumerate(counts):
        tail += pack(
            ("2i", n, 0), ("16s", b"PicoHarp 300"), ("8s", b"2.0"), ("11i", *[0] * 11), ("3f", 0, 0, 0)
        )
        tail += pack(("i", 0), ("f", bin_ns), ("7i", bins, *[1] * 6), ("q", row.sum()))
        tail += pack(("4i", 0, first + 4 * bins * n, 0, 0), ("6i", *[0] * 6))
    return picoharp(0, curves=curves, tail=tail + counts.astype("<u4").tobytes())


# --- records: events are (pulse, "photon", bin, input) and (pulse, "marker", mask), in order of time


def in_t3(events, *, several):
    """Write HydraHarp T3 records; wraps one by one (version 1), or several in a record (version 2)."""
    return _with_wraps(events, 1024, _hydraharp_t3, 1 << 31 | 63 << 25, several)


def in_t2(events, *, several):
    """Write HydraHarp T2 records, in 0.5 ps (version 1) or 1 ps (version 2), sync pulses before photons."""
    unit, period = (1, 1 << 25) if several else (2, 33_552_000)
    return _with_wraps(_with_syncs(events, unit), period, _hydraharp_t2, 1 << 31 | 63 << 25, several)


def in_picoharp_t3(events):
    """Write PicoHarp T3 records; input 0 of an event is input 1 there."""
    return _with_wraps(events, 65_536, _picoharp_t3, 15 << 28, several=False)


def in_picoharp_t2(events):
    """Write PicoHarp T2 records, in 4 ps."""
    return _with_wraps(_with_syncs(events, 0.25), 210_698_240, _picoharp_t2, 15 << 28, several=False)


def _with_wraps(events, period, write, overflow, several):
    words, wraps = [], 0
    for time, *event in events:
        missing = time // period - wraps
        words += ([overflow | missing] if missing else []) if several else [overflow] * missing
        wraps = time // period
        words.append(write(time % period, *event))
    return struct.pack(f"<{len(words)}I", *words)


def _with_syncs(events, per_ps):
    for pulse, kind, *values in events:
        time = int(pulse * PERIOD_PS * per_ps)
        if kind == "photon":
            yield time, "sync"
            yield time + int(values[0] * BIN_PS * per_ps), kind, *values
        else:
            yield time, kind, *values


def _hydraharp_t3(count, kind, *values):
    return (
        1 << 31 | values[0] << 25 | count if kind == "marker" else values[1] << 25 | values[0] << 10 | count
    )


def _hydraharp_t2(count, kind, *values):
    code = {
        "sync": 1 << 6,
        "marker": 1 << 6 | values[0] if values else 0,
        "photon": values[-1] if values else 0,
    }
    return code[kind] << 25 | count


def _picoharp_t3(count, kind, *values):
    return (
        15 << 28 | values[0] << 16 | count
        if kind == "marker"
        else values[1] + 1 << 28 | values[0] << 16 | count
    )


def _picoharp_t2(count, kind, *values):
    if kind == "marker":
        return 15 << 28 | count // 16 * 16 | values[0]
    return (0 if kind == "sync" else values[1] + 1) << 28 | count
