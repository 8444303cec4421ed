"""Photons of a stream go into their windows and channels, as a slow search in numpy puts them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from rig.model.sorting import count_photons, sort_photons


def slowly(tag, dtime, channel, edges, inputs, bins):
    """Sort by search and stable sort, without a loop over photons."""
    window = np.searchsorted(edges, tag, side="right") - 1
    column = np.full(256, -1)
    column[list(inputs)] = np.arange(len(inputs))
    place = column[channel.astype(int) % 256]
    kept = (window >= 0) & (window < len(edges) - 1) & (place >= 0) & (dtime < bins)
    row = window[kept] * len(inputs) + place[kept]
    shape = len(edges) - 1, len(inputs)
    counts = np.bincount(row, minlength=np.prod(shape)).reshape(shape)
    return dtime[kept][np.argsort(row, kind="stable")], counts, int((tag < edges[-1]).sum())


def agree(*given):
    for ours, theirs in zip(sort_photons(*given), slowly(*given), strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("inputs", [(0,), (3, 0), (0, 1, 2, 3, 4, 5, 6, 7)])
@pytest.mark.parametrize("dtype", ["u2", "u4"])
def test_each_photon_is_in_its_window_and_channel(inputs, dtype):
    rng = np.random.default_rng(len(inputs))
    tag = np.cumsum(rng.geometric(0.3, 50_000)) - 100
    dtime = rng.integers(0, 3000, len(tag)).astype(dtype)
    channel = rng.integers(-1, 8, len(tag)).astype(np.int8)
    edges = np.sort(rng.integers(0, tag[-1], 301))
    agree(tag, dtime, channel, edges, inputs, 2500)
    assert sort_photons(tag, dtime, channel, edges, inputs, 2500).photon_bins.dtype == dtype


@settings(max_examples=200, derandomize=True, deadline=None)
@given(st.data())
def test_windows_may_be_empty_and_photons_outside(data):
    number = data.draw(st.integers(0, 30))
    tag = np.sort(data.draw(arrays(np.int64, number, elements=st.integers(0, 40))))
    dtime = data.draw(arrays(np.uint16, number, elements=st.integers(0, 9)))
    channel = data.draw(arrays(np.int8, number))
    edges = np.sort(data.draw(arrays(np.int64, st.integers(1, 12), elements=st.integers(-5, 45))))
    inputs = data.draw(st.lists(st.integers(0, 127), max_size=4, unique=True))
    agree(tag, dtime, channel, edges, inputs, 7)


def test_a_stream_in_pieces_gives_what_it_gives_whole():
    rng = np.random.default_rng(4)
    tag = np.sort(rng.integers(0, 10_000, 5000))
    dtime, channel = rng.integers(0, 100, 5000).astype("u2"), rng.integers(0, 2, 5000).astype("i1")
    edges = np.arange(0, 10_001, 500)
    whole = sort_photons(tag, dtime, channel, edges, (0, 1), 100)
    starts = np.insert(np.cumsum(whole.counts), 0, 0)
    rows, counts = [[] for _ in range(whole.counts.size)], np.zeros_like(whole.counts)
    for piece in np.array_split(np.arange(5000), 7):
        part = sort_photons(tag[piece], dtime[piece], channel[piece], edges, (0, 1), 100)
        counts += part.counts
        for row, some in enumerate(np.split(part.photon_bins, np.cumsum(part.counts)[:-1])):
            rows[row].append(some)
    np.testing.assert_array_equal(counts, whole.counts)
    for row, some in enumerate(rows):
        np.testing.assert_array_equal(np.concatenate(some), whole.photon_bins[starts[row] : starts[row + 1]])


def test_what_belongs_to_later_windows_is_told():
    tag, dtime, channel = np.array([1, 5, 9, 12]), np.array([1, 2, 3, 4], "u2"), np.zeros(4, "i1")
    first = sort_photons(tag, dtime, channel, np.array([0, 4, 9]), (0,), 10)
    assert (first.photon_bins.tolist(), first.counts.tolist(), first.taken) == ([1, 2], [[1], [1]], 2)


def test_a_time_that_falls_back_stays_where_it_stands():
    tag, dtime, channel = np.array([1, 12, 2, 13]), np.array([1, 2, 3, 4], "u2"), np.zeros(4, "i1")
    found = sort_photons(tag, dtime, channel, np.array([0, 10, 20]), (0,), 10)
    assert (found.photon_bins.tolist(), found.counts.tolist()) == ([1, 2, 3, 4], [[1], [3]])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"dtime": np.zeros(1, "u2")}, "2 tags, 1 bins and 2 inputs"),
        ({"edges": np.array([5, 4])}, "must not decrease"),
        ({"edges": np.array([], int)}, "one or more"),
        ({"inputs": (0, 0)}, "must differ"),
        ({"inputs": (128,)}, "0 to 127"),
    ],
)
def test_what_does_not_fit_is_refused(change, said):
    good = {"tag": np.array([1, 2]), "dtime": np.zeros(2, "u2"), "channel": np.zeros(2, "i1")}
    good |= {"edges": np.array([0, 3]), "inputs": (0,), "bins": 4}
    with pytest.raises(ValueError, match=said):
        sort_photons(**good | change)


@pytest.mark.parametrize("dtype", ["u2", "u4"])
def test_photons_are_counted_by_channel(dtype):
    rng = np.random.default_rng(2)
    of_channel = np.array([700, 0, 1300])
    photon_bins = rng.integers(0, 40, 2000).astype(dtype)
    counts = count_photons(photon_bins, of_channel, 41)
    for channel, some in enumerate(np.split(photon_bins, np.cumsum(of_channel)[:-1])):
        np.testing.assert_array_equal(counts[channel], np.bincount(some, minlength=41))
    for wrong in (photon_bins[:-1], np.append(photon_bins[:-1], 41).astype(dtype)):
        with pytest.raises(ValueError, match="photons are not the"):
            count_photons(wrong, of_channel, 41)
