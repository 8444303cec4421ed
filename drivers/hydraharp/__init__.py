"""PicoQuant HydraHarp 400 through the vendor's library HHLib 3.0.

library = load_library()
with HydraHarp(library, clock=SystemClock(), serial="1000001") as tcspc:
exposure = tcspc.measure(10e-3)
"""

from drivers.hydraharp.device import Exposure, HydraHarp, Rates
from drivers.hydraharp.errors import ErrorCode, HydraHarpError
from drivers.hydraharp.library import HHLib
from drivers.hydraharp.loading import load_library

__all__ = ["ErrorCode", "Exposure", "HHLib", "HydraHarp", "HydraHarpError", "Rates", "load_library"]
