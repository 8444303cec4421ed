"""What a measurement gives."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Exposure:
    """What one timed measurement gave.

    Attributes
    ----------
    counts
        (bins,) uint32, photons a bin; valid until the next measurement.
    live_time_s
        How long the instrument measured: the exposure, or less where a full bin stopped it.
    warnings
        Plain sentences about this measurement; empty when all is well.
    """

    counts: NDArray[np.uint32]
    live_time_s: float
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Rates:
    """Rates at the sync input (the divider accounted for) and at the photon input, in counts a second."""

    sync_hz: float
    input_hz: float
