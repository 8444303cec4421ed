"""Mixing down to baseband against the naive Fourier sum: any bins, bands, runs of bins and precision."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recon.baseband import Mixer
from recon.wave import Band


def naive(counts, weights, band, run, width_s):
    """The sum over a run of bins, term by term in double precision."""
    since_s = (np.arange(run.start, run.stop) + 0.5) * width_s
    terms = np.exp(-1j * np.multiply.outer(band.frequencies_rad_per_s, since_s))
    return terms @ (counts * weights)[:, run].T


def band(cycles_first, cycles_last, many, width_s, bins):
    """Frequencies in cycles of the whole record."""
    rates = 2 * np.pi / (width_s * bins) * np.array([cycles_first, cycles_last])
    return Band(rates[0], (rates[1] - rates[0]) / max(many - 1, 1), np.ones(many))


@settings(max_examples=40, deadline=None)
@given(
    bins=st.integers(1, 400),
    first=st.floats(0, 1),
    width=st.floats(0, 1),
    many=st.integers(1, 9),
    at=st.tuples(st.floats(0, 1), st.floats(0, 1)),
    double=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_run_of_bins_has_its_fourier_sum(bins, first, width, many, at, double, seed):
    width_s, random = 16e-12, np.random.default_rng(seed)
    counts = random.poisson(2.0, (3, bins)).astype(np.uint16)
    weights = random.random(bins)
    # up to twice the highest frequency that the bins could tell apart
    asked = band(first * bins, (first + width) * bins, many, width_s, bins)
    start, stop = sorted(round(one * bins) for one in at)
    run = slice(start, stop)
    edges = sorted({0, start, stop, bins})
    mixer = Mixer([asked], weights, edges, width_s, np.complex128 if double else np.complex64)
    cells = mixer.counts(counts, np.ones((1, 0)))
    found = mixer.spectrum(cells, run, mixer.matrix(asked, run, 0.0))
    # of the sum of counts: the window's error, and the rounding of phases of some thousand radians in double
    tolerance = 1e-12 if double else 1e-6
    np.testing.assert_allclose(
        found, naive(counts, weights, asked, run, width_s), atol=tolerance * max(counts.sum(axis=1).max(), 1)
    )


@pytest.mark.parametrize("edge", [1, 40, 41, 42, 63, 64])
def test_photons_give_what_their_histogram_gives(edge):
    """An edge cuts a record into two runs, wherever among the cells it is."""
    random, width_s, bins = np.random.default_rng(edge), 16e-12, 64
    counts = random.poisson(1.0, (4, bins))
    asked, runs = band(20, 40, 5, width_s, bins), (slice(0, edge), slice(edge, bins))
    mixer = Mixer([asked], np.ones(bins), sorted({0, edge, bins}), width_s, np.complex64)
    row, bin_of = (np.repeat(one, counts[counts > 0]) for one in np.nonzero(counts))
    order = random.permutation(len(row))
    photons = mixer.photons(4, row[order], bin_of[order], np.ones(len(row)))
    histogram = mixer.counts(counts, np.ones((1, 0)))
    for run in runs:
        matrix = mixer.matrix(asked, run, 0.0)
        wanted = naive(counts, 1, asked, run, width_s)
        for cells in (photons, histogram):
            np.testing.assert_allclose(mixer.spectrum(cells, run, matrix), wanted, atol=1e-6 * counts.sum())


def test_the_first_bins_fade_position_by_position():
    random, width_s, bins = np.random.default_rng(3), 16e-12, 90
    counts, fade = random.poisson(3.0, (5, bins)), random.random((5, 17))
    asked, run = band(10, 30, 7, width_s, bins), slice(4, bins)
    mixer = Mixer([asked], np.ones(bins), [0, 4, bins], width_s, np.complex64)
    faded = counts.astype(float)
    faded[:, :17] *= fade
    found = mixer.spectrum(mixer.counts(counts, fade), run, mixer.matrix(asked, run, 0.0))
    np.testing.assert_allclose(found, naive(faded, 1, asked, run, width_s), atol=1e-6 * counts.sum())
