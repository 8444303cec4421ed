"""One gated single-photon detector, an effect a module, put together in `Detector`: no scene, no wire."""

from simulators.detector.dead_time import Afterpulsing
from simulators.detector.detector import Detector
from simulators.detector.gate import Ringing
from simulators.detector.response import FWHM_PER_SIGMA

__all__ = ["FWHM_PER_SIGMA", "Afterpulsing", "Detector", "Ringing"]
