"""Nothing but the light of the scene: a detector and optics without errors of their own."""

from simulators.detector import Detector
from simulators.optics.light import Optics

EXACT = Detector(dark_hz=0, ambient_hz=0, jitter_fwhm_s=0, electronics_fwhm_s=0, tail_fraction=0)
NO_STRAY = Optics(stray_per_pulse=0, pulse_fwhm_s=0)
