"""The virtual pulse: its width, its band, and that its copies in time stay away."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from recon.capture import C_M_PER_S
from recon.errors import ParameterError
from recon.wave import BAND_SIGMAS, VirtualPulse


def in_time(band, times_s):
    return np.exp(1j * np.outer(times_s, band.frequencies_rad_per_s)) @ band.weights


def test_full_width_is_so_many_wavelengths():
    pulse = VirtualPulse(0.04, 6)
    half_s = 3 * 0.04 / C_M_PER_S
    # 2.36 is 2 sqrt(2 ln 2) = 2.3548 rounded, as in the paper.
    assert np.exp(-(half_s**2) / (2 * pulse.sigma_s**2)) == pytest.approx(0.5, abs=2e-3)


@given(st.floats(0.01, 0.5), st.floats(2, 20), st.floats(1, 100))
def test_band_is_the_pulse_in_time(wavelength_m, cycles, pulse_lengths):
    pulse = VirtualPulse(wavelength_m, cycles)
    period_s = (8 + pulse_lengths) * pulse.sigma_s
    band = pulse.band(period_s)
    frequencies = band.frequencies_rad_per_s
    assert frequencies[0] > 0
    assert np.abs(frequencies - pulse.carrier_rad_per_s).max() <= BAND_SIGMAS / pulse.sigma_s * (1 + 1e-9)
    assert frequencies[len(frequencies) // 2] == pytest.approx(pulse.carrier_rad_per_s)
    times_s = np.linspace(-period_s / 2, period_s / 2, 201)
    wanted = np.exp(1j * pulse.carrier_rad_per_s * times_s - (times_s / pulse.sigma_s) ** 2 / 2)
    # Outside 3 sigma lies 0.27 %, and where the spacing does not divide 3 sigma up to one spacing more is cut
    # on each side, of density g(3)/sqrt(2 pi); the copies are 4 sigma away from half a period: 3.4e-4 twice.
    # Setting the peak to one gives the same error once more.
    cut = 2.7e-3 + 2 * 0.0111 / np.sqrt(2 * np.pi) * band.step_rad_per_s * pulse.sigma_s + 7e-4
    assert np.abs(in_time(band, times_s) - wanted).max() < 2 * cut


@pytest.mark.parametrize(("wavelength_m", "cycles"), [(0.0, 6), (-1.0, 6), (float("nan"), 6), (0.04, 1.0)])
def test_refuses_nonsense(wavelength_m, cycles):
    with pytest.raises(ParameterError, match="virtual pulse"):
        VirtualPulse(wavelength_m, cycles)
