"""What is summed up for the noise while a record is read, against a sum bin by bin."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from recon.capture import ArrayHistograms, Capture
from recon.noise import Tally
from recon.window import Window

BINS, WIDTH_S = 120, 16e-12


def slow(capture, window, tally, runs):
    """Each bin that some run holds, once."""
    counts = capture.histograms.counts
    cells = np.zeros(tally.cells.shape)
    end = window.end_weights(BINS, WIDTH_S)
    wanted = {bin_ for run in runs for bin_ in range(*run.indices(BINS))}
    for position, begin_s in enumerate(np.broadcast_to(capture.first_bin_s, len(counts))):
        for bin_ in wanted:
            cell = bin_ // tally.group
            weight = end[min(cell * tally.group + tally.group // 2, BINS - 1)]
            weight *= window.start_weights_at(begin_s + (cell + 0.5) * tally.group * WIDTH_S)
            cells[tally.tile[position], cell] += counts[position, bin_] * weight
    return cells


@settings(max_examples=25, deadline=None)
@given(
    group=st.integers(1, 50),
    ends=st.lists(st.tuples(st.integers(0, BINS - 1), st.integers(1, BINS)), min_size=1, max_size=3),
    block=st.integers(1, 9),
    start_s=st.none() | st.floats(0, BINS * WIDTH_S),
    dtype=st.sampled_from([np.uint8, np.uint32, np.float64]),
    seed=st.integers(0, 2**32 - 1),
)
def test_every_bin_is_summed_up_once(group, ends, block, start_s, dtype, seed):
    random = np.random.default_rng(seed)
    positions = random.normal(size=(9, 3)) * [1, 1, 0]
    counts = random.poisson(5, (9, BINS)).astype(dtype)
    first_bin_s = random.uniform(0, 1e-10, 9)
    histograms = ArrayHistograms(counts, block)
    capture = Capture(histograms, WIDTH_S, first_bin_s, positions, np.zeros((1, 3)))
    window = Window(start_s, rise_s=3e-10, fall_s=2e-10)
    runs = [slice(min(first, stop - 1), stop) for first, stop in ends]
    tally = Tally(capture, window, group)
    for run in runs:
        for _ in tally.blocks(run):
            pass
    # single precision, of sums of some hundred counts
    np.testing.assert_allclose(tally.cells, slow(capture, window, tally, runs), rtol=1e-5, atol=1e-4)
    assert tally.whole is (dtype is not np.float64)
