"""The camera's driver, with a capture object in OpenCV's place."""

import numpy as np
import pytest

from drivers.errors import DeviceNotFoundError, LinkError
from drivers.video_camera import STORED, VideoCamera


class Capture:
    """Pictures as a video device gives them: old ones first."""

    def __init__(self, where, pictures=(), opens=True):
        self.where, self.released, self._pictures, self._opens = where, False, list(pictures), opens

    def isOpened(self):  # noqa: N802
        return self._opens

    def grab(self):
        return bool(self._pictures and self._pictures.pop(0) is not None)

    def read(self):
        return (True, self._pictures.pop(0)) if self._pictures else (False, None)

    def release(self):
        self.released = True


def camera_with(pictures, opens=True, address="2"):
    made = []

    def open_capture(where):
        made.append(Capture(where, pictures, opens))
        return made[-1]

    return VideoCamera(address, open_capture=open_capture), made


def test_a_picture_is_taken_now_and_the_camera_let_go():
    pictures = [np.full((4, 6, 3), value, np.uint8) for value in range(STORED + 1)]
    pictures[-1][1, 2] = (10, 255, 30)
    camera, made = camera_with(pictures)
    with camera:
        assert not made  # calibrations without cameras leave them alone
        image = camera.image()
    assert image.shape == (4, 6)
    assert image.dtype == np.uint16
    assert image[0, 0] == STORED
    assert image[1, 2] == camera.full == 255
    assert made[0].where == 2
    assert made[0].released


def test_sixteen_bits_are_kept():
    camera, made = camera_with([np.full((4, 6), 40_000, np.uint16)] * (STORED + 1), address="rtsp://wall")
    with camera:
        assert camera.image().max() == 40_000
    assert camera.full == 65_535
    assert made[0].where == "rtsp://wall"


def test_a_camera_that_is_not_there_or_silent_is_told():
    camera, _ = camera_with([], opens=False)
    with (
        camera,
        pytest.raises(DeviceNotFoundError, match="camera 2: asked to be opened, but nothing answers"),
    ):
        camera.image()
    camera, _ = camera_with([])
    with camera, pytest.raises(LinkError, match="camera 2: asked to take a picture, but no picture came"):
        camera.image()
