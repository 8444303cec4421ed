"""The laser, the wall and the lens: how many photons there are, and how many reach the detector."""

from dataclasses import dataclass
from math import hypot, pi

from simulators.bench import Spot
from simulators.constants import C_M_PER_S, H_J_S


@dataclass(frozen=True)
class Optics:
    """What emits, scatters and gathers light. Defaults marked unconfirmed are plausible, not measured.

    Attributes
    ----------
    power_w
        Mean power of the laser at full setting [W], whatever its repetition rate (the paper's: 1 W).
    wavelength_m
        Laser wavelength [m] (532 nm, the paper).
    pulse_fwhm_s
        Full width at half maximum of the Gaussian pulse [s] (35 ps, the paper).
    wall_albedo
        Fraction that the Lambertian relay wall reflects, used twice (white styrofoam; 0.8 unconfirmed).
    lens_diameter_m
        Lens in front of the detector [m] (unconfirmed).
    spot_area_m2
        Area of the wall that the detector sees through its lens [m^2] (1 cm^2, unconfirmed).
    transmission
        Of lens, filter, alignment and fill of the detector together. Unconfirmed, and tuned: 0.35 would be
        usual for the first two; with the default the scene "letters" has the paper's mean of 205 000
        detections a second.
    stray_per_pulse
        Detections for each full-power pulse of first-bounce light, straight from the laser spot into the
        lens and scattered there, when nothing gates it off (unconfirmed; on a real rig it may saturate).
    """

    power_w: float = 1.0
    wavelength_m: float = 532e-9
    pulse_fwhm_s: float = 35e-12
    wall_albedo: float = 0.8
    lens_diameter_m: float = 25e-3
    spot_area_m2: float = 1e-4
    transmission: float = 0.030
    stray_per_pulse: float = 0.05

    @property
    def photons_per_s(self) -> float:
        """Photons a second at full power: P lambda / (h c); 2.68e18 for 1 W at 532 nm."""
        return self.power_w * self.wavelength_m / (H_J_S * C_M_PER_S)

    def collection_m2(self, head: Spot, spot: Spot) -> float:
        """Return photons on the detector, for one a square metre due at its spot from a perfect wall [m^2].

        ``head`` is the detector's lens and ``spot`` what it looks at [m].
        rho_w (laser spot) times A_spot rho_w cos(theta_head) A_lens / (pi D^2), the part of a Lambertian
        spot's light that a small lens at distance D receives, times the transmission.
        """
        distance_m = hypot(head[0] - spot[0], head[1] - spot[1], head[2] - spot[2])
        cosine = (head[2] - spot[2]) / distance_m
        lens_m2 = pi * self.lens_diameter_m**2 / 4
        gathered = self.wall_albedo * cosine * lens_m2 / (pi * distance_m**2)
        return self.wall_albedo * self.spot_area_m2 * gathered * self.transmission
