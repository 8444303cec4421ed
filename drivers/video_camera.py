"""A camera that OpenCV opens by number, device file or URL.

Source: OpenCV's documentation of VideoCapture; not yet run with a camera.
"""

from collections.abc import Callable
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceNotFoundError, LinkError

#: Pictures that a video device may have in store from before it was asked; unconfirmed, four is OpenCV's own.
STORED = 4


class VideoCamera:
    """A camera; a context manager that lets go of it. It is opened when the first picture is taken.

    Parameters
    ----------
    address
        What OpenCV shall open: a number (``"0"``), a device file or a URL.
    open_capture
        Makes the capture object, by default ``cv2.VideoCapture``.

    Attributes
    ----------
    name
        What it is called in messages and files.
    full
        Count at which a pixel is full: OpenCV gives 8 bits unless the pictures are of 16.
    """

    def __init__(self, address: str, *, open_capture: Callable[[int | str], Any] | None = None) -> None:
        self.name = f"camera {address}"
        self.full = 255
        self._address = address
        self._open_capture = open_capture or _video_capture
        self._capture: Any = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._capture is not None:
            self._capture.release()
            self._capture = None

    def image(self) -> NDArray[np.uint16]:
        """Return a picture taken now, (height, width), grey; older ones in store are thrown away.

        Raises
        ------
        DeviceNotFoundError
            OpenCV is missing, or cannot open the camera.
        LinkError
            No picture comes.
        """
        if self._capture is None:
            self._capture = self._opened()
        for _ in range(STORED):
            self._capture.grab()
        came, picture = self._capture.read()
        if not came or picture is None:
            raise LinkError(
                self.name, "take a picture", "no picture came", "Check its cable, and close other programs."
            )
        if picture.dtype == np.uint16:
            self.full = 65_535
        if picture.ndim == 3:  # the brightest colour: a laser has one, and where it is full, that is seen
            picture = picture.max(axis=2)
        return np.asarray(picture, dtype=np.uint16)

    def _opened(self) -> Any:
        where = int(self._address) if self._address.isdecimal() else self._address
        capture = self._open_capture(where)
        if not capture.isOpened():
            capture.release()
            raise DeviceNotFoundError(
                self.name,
                "be opened",
                "nothing answers there",
                "Check its cable, its address, and your permissions.",
            )
        return capture


def _video_capture(where: int | str) -> Any:
    try:
        import cv2
    except ImportError:
        raise DeviceNotFoundError(
            f"camera {where}",
            "be opened",
            "OpenCV is missing",
            "Install it: pip install opencv-python-headless.",
        ) from None
    return cv2.VideoCapture(where)
