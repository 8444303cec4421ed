"""Time-tagged records: the bulk decoder against one that reads record by record, and the encoder."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from drivers.harp.records import (
    MAX_CHANNEL,
    SYNC_CHANNEL,
    T2,
    T2_VERSION_1,
    T3,
    T3_VERSION_1,
    Batch,
    DamagedRecordsError,
    Decoder,
    Encoder,
)

FORMATS = {"t3": T3, "t2": T2, "t3 v1": T3_VERSION_1, "t2 v1": T2_VERSION_1}
OVERFLOW = 1 << 31 | 63 << 25


def one_by_one(records, name):
    """Read records as the vendor's description says, one after the other: the slow reference."""
    t3, version_1 = name.startswith("t3"), name.endswith("v1")
    photons, markers, base, overflows, unknown = [], [], 0, 0, 0
    for record in map(int, records):
        special, channel = record >> 31, record >> 25 & 0b111111
        dtime, count = (record >> 10 & 0x7FFF, record & 0x3FF) if t3 else (0, record & 0x1FFFFFF)
        if not special:
            photons.append((base + count, dtime, channel))
        elif channel == 63:
            wraps = 1 if version_1 or count == 0 else count
            base += wraps * (1024 if t3 else 33_552_000 if version_1 else 33_554_432)
            overflows += wraps
        elif 1 <= channel <= 15:
            markers.append((base + count, channel, len(photons)))
        elif channel == 0 and not t3:
            photons.append((base + count, 0, -1))
        else:
            unknown += 1
    return photons, markers, overflows, unknown


def told(batch):
    photons = list(zip(batch.tag.tolist(), batch.dtime.tolist(), batch.channel.tolist(), strict=True))
    markers = list(
        zip(batch.marker_tag.tolist(), batch.marker_mask.tolist(), batch.marker_photon.tolist(), strict=True)
    )
    return photons, markers, batch.overflows, batch.unknown


def in_pieces(decoder, records, cuts):
    """Decode piece by piece, and put the pieces together again."""
    photons, markers, overflows, unknown = [], [], 0, 0
    for piece in np.split(records, sorted(cuts)):
        seen, marked, wraps, strange = told(decoder.decode(piece))
        markers += [(tag, mask, before + len(photons)) for tag, mask, before in marked]
        photons += seen
        overflows, unknown = overflows + wraps, unknown + strange
    return photons, markers, overflows, unknown


field = st.integers(0, (1 << 25) - 1)
photon = st.builds(lambda channel, low: channel << 25 | low, st.integers(0, 63), field)
marker = st.builds(lambda mask, low: 1 << 31 | mask << 25 | low, st.integers(1, 15), field)
overflow = st.builds(lambda low: OVERFLOW | low, st.sampled_from([0, 1, 2, 3, 1023, 1024]) | field)
anything = st.integers(0, (1 << 32) - 1)
streams = st.lists(photon | marker | overflow | anything, max_size=60).map(lambda r: np.array(r, np.uint32))


@pytest.mark.parametrize("name", FORMATS)
@given(streams, st.lists(st.integers(0, 60), max_size=5))
@example(np.array([OVERFLOW | 3, 1 << 31 | 0b0101 << 25 | 7, 1 << 31 | 0b1000 << 25 | 7], np.uint32), [1, 2])
def test_any_records_cut_anywhere_are_read_as_one_by_one(name, records, cuts):
    expected = one_by_one(records, name)
    assert in_pieces(Decoder(FORMATS[name]), records, cuts) == expected
    assert told(Decoder(FORMATS[name]).decode(records)) == expected


@given(streams, st.integers(0, 60))
def test_a_truncated_stream_gives_what_is_whole(records, end):
    assert told(Decoder(T3).decode(records[:end])) == one_by_one(records[:end], "t3")


@st.composite
def batches(draw, t3):
    """Photons and markers in the order of time, with gaps from none to several overflow records."""
    gaps = st.integers(0, 3) | st.integers(0, 5000) | st.integers(0, (1 << 36) if t3 else (1 << 55))
    events = draw(st.lists(st.tuples(gaps, st.booleans()), max_size=30))
    tag = np.cumsum([gap for gap, _ in events], dtype=np.int64)
    is_marker = np.array([marked for _, marked in events], bool)
    photons, markers = int((~is_marker).sum()), int(is_marker.sum())
    lowest, longest = (0, 0x7FFF) if t3 else (SYNC_CHANNEL, 0)
    channels = draw(st.lists(st.integers(lowest, MAX_CHANNEL), min_size=photons, max_size=photons))
    dtimes = draw(st.lists(st.integers(0, longest), min_size=photons, max_size=photons))
    masks = draw(st.lists(st.integers(1, 15), min_size=markers, max_size=markers))
    return Batch(
        tag[~is_marker],
        np.array(dtimes, np.uint16),
        np.array(channels, np.int8),
        tag[is_marker],
        np.array(masks, np.uint8),
        np.cumsum(~is_marker)[is_marker],
    )


@pytest.mark.parametrize("name", ["t3", "t2"])
@given(st.data())
def test_what_was_encoded_is_decoded(name, data):
    encoder, decoder = Encoder(FORMATS[name]), Decoder(FORMATS[name])
    late = 0
    for batch in data.draw(st.lists(batches(name == "t3"), max_size=3)):
        batch.tag[:] += late
        batch.marker_tag[:] += late
        late = max([late, *batch.tag[-1:].tolist(), *batch.marker_tag[-1:].tolist()])
        assert told(decoder.decode(encoder.encode(batch)))[:2] == told(batch)[:2]
    assert encoder.last == late


def test_idle_time_is_written_in_few_records():
    # an hour at 10 MHz is 35,156,250 wraps of 1024 pulses, up to 1023 of them in a record, and the photon
    records = Encoder(T3).encode(photons_at(36_000_000_000))
    assert len(records) == -(-35_156_250 // 1023) + 1


def photons_at(*tags, dtime=0, channel=0):
    nothing = np.empty(0, np.int64)
    count = len(tags)
    return Batch(
        np.array(tags, np.int64),
        np.full(count, dtime, np.uint16),
        np.full(count, channel, np.int8),
        nothing,
        nothing.astype(np.uint8),
        nothing,
    )


@pytest.mark.parametrize(
    ("batch", "reason"),
    [
        (photons_at(5, 4), "times decrease"),
        (photons_at(5, dtime=0x8000), "dtime of 32768"),
        (photons_at(5, channel=63), "channel is outside 0 to 62"),
        (photons_at(5, channel=SYNC_CHANNEL), "channel is outside 0 to 62"),
    ],
)
def test_what_fits_no_record_is_refused(batch, reason):
    with pytest.raises(ValueError, match=reason):
        Encoder(T3).encode(batch)


def test_a_batch_is_overwritten_by_the_next_unless_copied():
    decoder = Decoder(T3)
    first = decoder.decode(np.array([1 << 10 | 1, 2 << 10 | 2], np.uint32))
    kept = first.copy()
    decoder.decode(np.array([3 << 10 | 3], np.uint32))
    assert kept.dtime.tolist() == [1, 2]
    assert first.dtime[0] == 3


def test_wraps_beyond_any_measurement_are_damage():
    records = np.full(20_000, OVERFLOW | 0x1FFFFFF, np.uint32)  # each 2^50 ps, together 260 days
    decoder = Decoder(T2)
    with pytest.raises(DamagedRecordsError, match="longest measurement"):
        decoder.decode(records)
    assert decoder.base == 0


@pytest.mark.parametrize("wrong", [np.zeros(4, np.int32), np.zeros((2, 2), np.uint32), np.zeros(4, ">u4")])
def test_only_records_are_decoded(wrong):
    with pytest.raises(ValueError, match="uint32"):
        Decoder(T3).decode(wrong)
