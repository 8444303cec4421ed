"""The simulated histogram, against photon-by-photon arithmetic in whole femtoseconds."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from simulators.wire.harp.histogram import HistogramMemory, after_edge, bins_of
from simulators.wire.harp.timing import Nonlinearity


@given(
    times_fs=st.lists(st.integers(-150_000_000, 450_000_000), min_size=1, max_size=30),
    shift_ps=st.integers(-199_998, 199_998),
    offset_ns=st.integers(0, 200),
    width_ps=st.sampled_from([1, 4, 1024]),
    length=st.sampled_from([1024, 65536]),
)
def test_bins_of(times_fs, shift_ps, offset_ns, width_ps, length):
    period_fs = 100_000_000
    edges, expected = [], []
    for i, time_fs in enumerate(times_fs):
        time_fs = 2 * time_fs + 1 + 2000 * shift_ps + 2 * period_fs * i  # odd: on no edge
        edges.append(time_fs // (2 * period_fs))
        time_fs = time_fs % (2 * period_fs) - 2_000_000 * offset_ns
        expected.append(min(max(time_fs // (2000 * width_ps) + 1, 0), length + 1))
    edge, after_s = after_edge(
        (2 * np.array(times_fs) + 1) * 0.5e-15,
        np.arange(len(times_fs)),
        period_s=100e-9,
        shift_s=shift_ps * 1e-12,
    )
    got = bins_of(
        after_s,
        offset_s=offset_ns * 1e-9,
        bin_width_s=width_ps * 1e-12,
        length=length,
        clock=Nonlinearity(),
    )
    assert edge.tolist() == edges
    assert got.tolist() == expected


@given(
    bins=st.lists(st.integers(0, 9), min_size=1, max_size=60),
    before=st.lists(st.integers(1, 8), max_size=20),
    stop=st.integers(1, 12),
)
def test_photons_until(bins, before, stop):
    memory = HistogramMemory(65536, 2**32 - 1)
    memory.add(np.array(before, np.int64), 8)
    counts = np.bincount(np.array(before, np.int64), minlength=10)
    expected = 0 if counts[1:9].max() >= stop else None
    for i, b in enumerate(bins if expected is None else []):
        counts[b] += 1
        if 1 <= b <= 8 and counts[b] >= stop:
            expected = i + 1
            break
    assert memory.photons_until(np.array(bins), 8, stop) == expected
