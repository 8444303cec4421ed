"""How fast time-tagged records are decoded, beside ptufile's decoder on the same 20 million records.

Both decode in pieces of 131,072 records into memory that is used again, as a driver does; ptufile also
decodes all at once, as its own `decode_records` does. The ratio is told, and nothing is asserted.
Run with ``pytest tests/benchmarks/test_records_speed.py -n 0 --benchmark-only -s``.
"""

from time import perf_counter

import numpy as np
import pytest

from drivers.harp.records import T3, Batch, Decoder, Encoder
from rig.files.picoquant import read_head
from rig.importers.tagged import Records, blocks
from support.picoquant_files import ptu

PIECE = 131_072


@pytest.fixture(scope="module")
def records():
    """19 million photons at 2 MHz of 10 MHz, a marker each millisecond, and the overflows between."""
    rng = np.random.default_rng(0)
    tag = np.cumsum(rng.geometric(0.2, 19_000_000)).astype(np.int64)
    marker_tag = np.arange(0, tag[-1], 10_000, dtype=np.int64)
    dtime, channel = rng.integers(0, 25_000, len(tag)).astype("u2"), rng.integers(0, 2, len(tag)).astype("i1")
    mask = np.ones(len(marker_tag), np.uint8)
    return Encoder(T3).encode(Batch(tag, dtime, channel, marker_tag, mask, np.searchsorted(tag, marker_tag)))


def pieces(records):
    return [records[start : start + PIECE] for start in range(0, len(records), PIECE)]


def best_s(call, rounds=5):
    """Return the least time of several calls: what a busy machine adds is never negative."""
    took = []
    for _ in range(rounds):
        began = perf_counter()
        call()
        took.append(perf_counter() - began)
    return min(took)


def test_decoding(records, benchmark):
    ptufile = pytest.importorskip("ptufile", reason="ptufile is not installed: pip install 'nlos-rig[dev]'")
    from ptufile._ptufile import decode_t3_records

    decoder, some = Decoder(T3), pieces(records)

    def ours():
        decoder.base = 0
        for piece in some:
            decoder.decode(piece)

    held = np.zeros(PIECE, ptufile.ptufile.T3_RECORD_DTYPE).view(np.recarray)

    def theirs():
        for piece in some:
            decode_t3_records(held[: len(piece)], piece, 0x01010304)

    def theirs_at_once():
        out = np.zeros(len(records), ptufile.ptufile.T3_RECORD_DTYPE).view(np.recarray)
        decode_t3_records(out, records, 0x01010304)

    ours()
    benchmark.pedantic(ours, rounds=5)
    ours_s, theirs_s, at_once_s = best_s(ours), best_s(theirs), best_s(theirs_at_once, 3)
    rates = [len(records) / seconds / 1e6 for seconds in (ours_s, theirs_s, at_once_s)]
    print(
        f"\n{len(records):,} records: {rates[0]:.0f} million a second, ptufile {rates[1]:.0f} in the same "
        f"pieces (ratio {theirs_s / ours_s:.2f}), {rates[2]:.0f} at once (ratio {at_once_s / ours_s:.2f})"
    )


def test_histograms_of_a_file(records, benchmark, tmp_path):
    """From a file on disk to a histogram of each input, beside ptufile's own function for it."""
    ptufile = pytest.importorskip("ptufile", reason="ptufile is not installed: pip install 'nlos-rig[dev]'")
    needed = {"Measurement_SubMode": 0, "TTResultFormat_BitsPerRecord": 32}  # by ptufile
    needed |= {"TTResult_SyncRate": 10_000_000, "HW_InpChannels": 2, "MeasDesc_AcquisitionTime": 10_000}
    path = ptu(tmp_path / "a.ptu", records, MeasDesc_Resolution=4e-12, **needed)
    head = read_head(path)

    def ours():
        whole = (
            np.zeros(1, np.int64),
            np.array([len(records)]),
        )  # one point, from the first photon to the last
        return next(blocks(Records.of(head), 4e-12, (0, 1), range(25_000), whole))

    def theirs():
        with ptufile.PtuFile(path) as file:
            return file.decode_histogram(dtype=np.uint32)

    counts, other = ours(), np.asarray(theirs())
    np.testing.assert_array_equal(counts[:, : other.shape[-1]], other)
    benchmark.pedantic(ours, rounds=3)
    ours_s, theirs_s = best_s(ours, 3), best_s(theirs, 3)
    rates = [len(records) / seconds / 1e6 for seconds in (ours_s, theirs_s)]
    print(
        f"\n{len(records):,} records of a file to histograms: {rates[0]:.0f} million a second, ptufile "
        f"{rates[1]:.0f} (ratio {theirs_s / ours_s:.2f})"
    )
