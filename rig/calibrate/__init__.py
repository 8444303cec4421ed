"""Calibration routines: each measures through the devices, fits what it measured, and shows it."""

import numpy as np
from numpy.typing import NDArray

from rig.errors import CalibrationError

Floats = NDArray[np.float64]


def require(fits: object, message: str) -> None:
    """Refuse data that does not fit.

    Raises
    ------
    CalibrationError
        With the message.
    """
    if not fits:
        raise CalibrationError(message)
