"""The virtual illumination: a pulse of a few wavelengths, and the frequencies that sample it.

Symbols: lambda ``wavelength_m``, omega_0 ``carrier_rad_per_s``, sigma_t ``sigma_s``, g ``weights``.
"""

from dataclasses import dataclass
from math import ceil, floor, inf, pi
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from recon.capture import C_M_PER_S
from recon.errors import ParameterError

#: Band on either side of the carrier, in standard deviations of g; what lies beyond holds 0.27 % of the
#: pulse's peak amplitude.
BAND_SIGMAS = 3.0
#: Half-length of a pulse, in standard deviations; its envelope has fallen to 3.4e-4 there.
PULSE_SIGMAS = 4.0
#: Usual length of a pulse, full width at half maximum in wavelengths; see `recon.defaults`.
CYCLES = 2.0
#: Shortest pulse: its band of `BAND_SIGMAS` begins at 0.06 of the carrier's frequency.
MIN_CYCLES = 1.2
#: Longest pulse; what is longer is a continuous wave.
MAX_CYCLES = 10_000.0
#: Wavelengths that a computed wave can have: no detector's timing resolves less than a tenth of a millimetre,
#: and no wall is a kilometre wide.
MIN_WAVELENGTH_M, MAX_WAVELENGTH_M = 1e-5, 1e3


@dataclass(frozen=True)
class Band:
    """Evenly spaced frequencies and their weights.

    Attributes
    ----------
    first_rad_per_s, step_rad_per_s
        Lowest angular frequency and spacing.
    weights
        (F,) float64 weight of each frequency.
    run_of
        The band that this is a run of; None for a band of its own.
    """

    first_rad_per_s: float
    step_rad_per_s: float
    weights: NDArray[np.float64]
    run_of: "Band | None" = None

    def __len__(self) -> int:
        return len(self.weights)

    def __getitem__(self, part: slice) -> "Band":
        """Return a run of neighbouring frequencies."""
        start, _, stride = part.indices(len(self.weights))
        if stride != 1:
            raise ValueError("a band is cut only into runs of neighbouring frequencies")
        first = self.first_rad_per_s + start * self.step_rad_per_s
        return Band(first, self.step_rad_per_s, self.weights[part], self.whole)

    @property
    def whole(self) -> "Band":
        """The whole band that this is, or is a run of: lattices are planned for it.

        So runs of a band are computed on the same lattices, and their fields add up to the same numbers.
        """
        return self.run_of or self

    @property
    def begins(self) -> int:
        """The number of the first frequency in the whole band."""
        beyond = self.first_rad_per_s - self.whole.first_rad_per_s
        return round(beyond / self.step_rad_per_s) if beyond else 0

    @property
    def frequencies_rad_per_s(self) -> NDArray[np.float64]:
        """(F,) angular frequencies, ascending."""
        return self.first_rad_per_s + self.step_rad_per_s * np.arange(len(self.weights), dtype=np.float64)

    @property
    def last_rad_per_s(self) -> float:
        """Highest angular frequency."""
        return self.first_rad_per_s + self.step_rad_per_s * (len(self.weights) - 1)

    @property
    def finest_rad_per_s(self) -> float:
        """Highest frequency of the whole band."""
        return self.whole.last_rad_per_s


@dataclass(frozen=True)
class VirtualPulse:
    """A Gaussian pulse on a carrier, exp(i omega_0 t) exp(-t^2 / (2 sigma_t^2)).

    Its spectrum is g(omega) = exp(-(omega - omega_0)^2 sigma_t^2 / 2), with sigma_t = cycles lambda / (2.36
    c): the envelope's full width at half maximum is `cycles` wavelengths (paper, supplement C; it prints
    sigma = 6 lambda / 2.36, a length).

    Attributes
    ----------
    wavelength_m
        Carrier wavelength lambda.
    cycles
        Full width at half maximum in wavelengths.

    Raises
    ------
    ParameterError
        If the wavelength is outside `MIN_WAVELENGTH_M` to `MAX_WAVELENGTH_M`, the pulse so short (below
        `MIN_CYCLES`) that its band would come near zero frequency, or longer than `MAX_CYCLES`.

    Examples
    --------
    >>> import recon
    >>> pulse = recon.VirtualPulse(wavelength_m=0.04)
    >>> f"{pulse.sigma_s * 1e12:.0f} ps, {len(pulse.band(period_s=10e-9))} frequencies within 10 ns"
    '113 ps, 85 frequencies within 10 ns'
    """

    wavelength_m: float
    cycles: float = CYCLES

    def __post_init__(self) -> None:
        _check_wavelength("virtual pulse", self.wavelength_m)
        if not MIN_CYCLES <= self.cycles <= MAX_CYCLES:
            raise ParameterError(
                "virtual pulse",
                f"{self.cycles:g} cycles",
                f"a pulse has {MIN_CYCLES:g} to {MAX_CYCLES:g}",
                f"The usual number is {CYCLES:g}.",
            )

    @property
    def carrier_rad_per_s(self) -> float:
        """Carrier angular frequency omega_0 = 2 pi c / lambda."""
        return 2 * pi * C_M_PER_S / self.wavelength_m

    @property
    def sigma_s(self) -> float:
        """Standard deviation sigma_t of the envelope."""
        return self.cycles * self.wavelength_m / (2.36 * C_M_PER_S)

    @property
    def half_length_s(self) -> float:
        """Time from the pulse's centre after which nothing of it is left (`PULSE_SIGMAS`)."""
        return PULSE_SIGMAS * self.sigma_s

    def band(self, period_s: float) -> Band:
        """Sample the pulse's spectrum so that its copies in time are `period_s` or more apart.

        The weights are g(omega) over its sum, so that the pulse has a peak of one in time, whatever the
        spacing.

        Parameters
        ----------
        period_s
            Time after which the sampled pulse may repeat.

        Returns
        -------
        Band
            Frequencies within `BAND_SIGMAS` of the carrier, the carrier among them.
        """
        step = 2 * pi / period_s
        reach = floor(BAND_SIGMAS / (self.sigma_s * step))
        if reach < ceil(BAND_SIGMAS):  # a period shorter than the pulse: sample the pulse itself
            reach = ceil(BAND_SIGMAS)
            step = 1 / self.sigma_s
        offsets = step * np.arange(-reach, reach + 1)
        weights = np.exp(-((offsets * self.sigma_s) ** 2) / 2)
        return Band(self.carrier_rad_per_s - reach * step, step, weights / weights.sum())


@dataclass(frozen=True)
class ContinuousWave:
    """One frequency: a pulse without end.

    Attributes
    ----------
    wavelength_m
        Wavelength lambda.
    half_length_s
        Infinite: all of a record acts on every voxel, at any moment.

    Raises
    ------
    ParameterError
        If the wavelength is outside `MIN_WAVELENGTH_M` to `MAX_WAVELENGTH_M`.
    """

    wavelength_m: float
    half_length_s: ClassVar[float] = inf

    def __post_init__(self) -> None:
        _check_wavelength("continuous wave", self.wavelength_m)

    def band(self, period_s: float) -> Band:
        """Return the one frequency, with weight one, whatever the period."""
        return Band(2 * pi * C_M_PER_S / self.wavelength_m, 0.0, np.ones(1))


#: The virtual illumination: it has a `band` and a `half_length_s`.
Light = VirtualPulse | ContinuousWave


def _check_wavelength(thing: str, wavelength_m: float) -> None:
    if not MIN_WAVELENGTH_M <= wavelength_m <= MAX_WAVELENGTH_M:
        raise ParameterError(
            thing,
            f"wavelength {wavelength_m:g} m",
            f"it is not between {MIN_WAVELENGTH_M:g} and {MAX_WAVELENGTH_M:g} m",
            "Try 4 cm.",
        )
