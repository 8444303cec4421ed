"""``rig calibrate`` where OpenCV is not installed, or the rig has no cameras."""

import sys

import pytest

from rig.calibrate.galvo.routine import CameraRoutine
from rig.errors import UsageError
from rig.model.config import built_in, load


def test_a_missing_opencv_is_a_matter_of_what_is_installed(rig, monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    assert "pip install opencv-python-headless" in CameraRoutine().lacking(built_in())
    done = rig("calibrate", "galvo")
    assert done.code == UsageError.exit_code
    assert "pip install opencv-python-headless" in done.err
    assert "--method flight" in done.err


@pytest.mark.parametrize(("addresses", "lacking"), [("", "2"), ('"/dev/video0", "/dev/video1"', "")])
def test_a_real_rig_needs_two_cameras(tmp_path, addresses, lacking):
    path = tmp_path / "lab.toml"
    ports = "".join(f'[{name}]\naddress = "sim://{name}"\n' for name in ("galvo", "laser", "detector"))
    path.write_text(f"{ports}[cameras]\naddresses = [{addresses}]\n")
    words = CameraRoutine().lacking(load(path))
    assert bool(words) == bool(lacking)
    if lacking:
        assert "two cameras are needed, 0 are configured" in words
