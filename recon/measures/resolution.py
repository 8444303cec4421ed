"""What a virtual aperture can resolve, by the formulas of diffraction.

Symbols: lambda ``wavelength_m``, L ``depth_m``, d ``aperture_m``, theta ``half_angle_rad``. Each bound is a
distance to the first dark ring or line (Rayleigh's criterion), not a width at half maximum.
"""

from dataclasses import dataclass
from math import atan, sin, sqrt

#: Full width at half maximum over the distance to the first dark line of sinc^2, the image of a slit, or of a
#: rectangle in one direction.
FWHM_OF_SLIT = 0.886
#: Distance to the first dark line of a slit over that of a disc as wide.
SLIT_OF_DISC = 1 / 1.22


@dataclass(frozen=True)
class Resolution:
    """Rayleigh distances [m] of an aperture of one width, for one depth.

    Attributes
    ----------
    both_m
        0.61 lambda L / d, where laser and detector both scan (paper, section on resolution).
    one_m
        1.22 lambda L / d, where one of them scans.
    near_m
        1.22 lambda / (2 sin theta), where one scans and the wall is not far: sin theta is then less than
        d / (2 L), and the point wider than `one_m`.
    half_angle_rad
        Half the angle that the aperture subtends at the point, theta = atan(d / (2 L)).
    """

    both_m: float
    one_m: float
    near_m: float
    half_angle_rad: float

    @property
    def slit_zero_m(self) -> float:
        """Distance to the first dark line in one direction of an evenly lit rectangle.

        It is lambda/(2 sin theta), since sinc(x) is zero at 1 where Airy's disc is at 1.22.
        """
        return self.near_m * SLIT_OF_DISC

    @property
    def slit_fwhm_m(self) -> float:
        """Full width at half maximum in one direction of an evenly lit rectangle, 0.886 lambda/(2 sin theta).

        For a point before the aperture's middle, and one scanning side.
        """
        return self.slit_zero_m * FWHM_OF_SLIT


def predicted(wavelength_m: float, depth_m: float, aperture_m: float) -> Resolution:
    """Return what diffraction allows.

    Parameters
    ----------
    wavelength_m
        Of the virtual wave.
    depth_m
        Distance of the point from the wall.
    aperture_m
        Width of the scanned wall in the direction that is asked about.

    Examples
    --------
    A wave of 4 cm, a point 1 m away, a wall of 1.8 m:

    >>> from recon import measures
    >>> round(measures.predicted(0.04, 1.0, 1.8).near_m * 100, 1)
    3.6
    """
    half_angle_rad = atan(aperture_m / (2 * depth_m))
    one_m = 1.22 * wavelength_m * depth_m / aperture_m
    return Resolution(one_m / 2, one_m, 1.22 * wavelength_m / (2 * sin(half_angle_rad)), half_angle_rad)


def pulse_depth_m(wavelength_m: float, cycles: float) -> float:
    """Return the full width at half maximum over depth that the virtual pulse alone gives a point.

    The envelope's full width is `cycles` wavelengths of path (paper, supplement C); its square, the
    intensity, is narrower by the root of 2, and a path is twice a depth. Near the wall the aperture focuses
    over depth too, and points come out shorter.
    """
    return cycles * wavelength_m / (2 * sqrt(2))
