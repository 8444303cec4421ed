"""OpenCV, which only cameras need."""

from typing import Any

from rig.errors import CalibrationError


def opencv() -> Any:
    """Return the module.

    Raises
    ------
    CalibrationError
        If it is not installed.
    """
    try:
        import cv2
    except ImportError:
        raise CalibrationError(
            "calibrating cameras needs OpenCV, which is not installed: pip install 'nlos-rig[cameras]', or "
            "calibrate without cameras: rig calibrate galvo --method flight"
        ) from None
    return cv2
