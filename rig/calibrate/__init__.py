"""Calibration routines: each measures through the devices, fits what it measured, and shows it."""

from rig.errors import CalibrationError


def require(fits: object, message: str) -> None:
    """Refuse data that does not fit.

    Raises
    ------
    CalibrationError
        With the message.
    """
    if not fits:
        raise CalibrationError(message)
