"""What Python programs rely on: quick import, own errors, light by consent, files that are safe."""

import dataclasses
import signal
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import recon
import rig
from recon.errors import ParameterError
from rig.errors import ConfigError, InterruptedScanError, RefusedError, UsageError

SMALL = {"grid": "3x2", "spacing": "50cm", "exposure": "1ms"}
REAL = {
    "galvo": {"address": "/dev/nowhere-galvo"},
    "laser": {"address": "/dev/nowhere-laser"},
    "detector": {"address": "/dev/nowhere-detector"},
    "scan": {"columns": 2, "rows": 2, "spacing": "50cm"},
}


@pytest.fixture(autouse=True)
def _own_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def letters(tmp_path_factory):
    path = tmp_path_factory.mktemp("letters") / "letters.h5"
    rig.scan(path, grid="12x9", spacing="16cm", exposure="10ms").close()
    return path


def test_import_is_quick():
    script = (
        "import sys, rig, recon\n"
        "print([m for m in ('numpy', 'h5py', 'matplotlib', 'pydantic', 'typer') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    assert done.stdout.strip() == "[]", done.stderr


@pytest.mark.parametrize("package", [rig, recon])
def test_all_names_are_there(package):
    assert set(package.__all__) <= set(dir(package))
    assert all(getattr(package, name).__doc__ for name in package.__all__)


@pytest.mark.parametrize("package", [rig, recon])
def test_an_unknown_name_is_an_attribute_error(package):
    with pytest.raises(AttributeError, match="has no attribute 'nonsense'"):
        _ = package.nonsense


def test_a_real_laser_needs_consent(tmp_path):
    with pytest.raises(RefusedError, match=r"this lights the laser of .*consent=True"):
        rig.scan("real.h5", config=REAL)
    assert list(tmp_path.iterdir()) == []


def test_what_is_wrong_is_said_as_at_the_command_line(letters):
    with pytest.raises(UsageError, match="'10' has no unit; write a time with its unit"):
        rig.plan(exposure="10")
    with pytest.raises(UsageError, match="'12' is not a grid"):
        rig.plan(grid="12")
    with pytest.raises(ConfigError, match=r"unknown key 'scan.colums'; did you mean 'columns'\?"):
        rig.plan({"scan": {"colums": 3}, "simulation": {}})
    with pytest.raises(UsageError, match=r"spacing would have no effect; give it to rig\.plan"):
        rig.scan("a.h5", rig.plan(), spacing="1cm")
    with pytest.raises(UsageError, match=r"letters\.h5 is a scan, and is not overwritten"):
        rig.scan(letters, **SMALL)
    with pytest.raises(UsageError, match="the laser cannot be given as an object"):
        rig.scan("a.h5", devices={"laser": object()}, **SMALL)
    with rig.open_scan(letters) as scan:
        with pytest.raises(UsageError, match="there is no camera 'pinhole'"):
            scan.image(camera="pinhole")
        with pytest.raises(ParameterError, match="there is no such solver"):
            scan.image(solver="mine")
        with pytest.raises(UsageError, match="nan is not a length"):
            scan.image(wavelength=float("nan"))
        with pytest.raises(TypeError, match="no option wavelenght"):
            scan.image(wavelenght=0.3)
        with pytest.raises(IndexError):
            scan.histogram(len(scan))


def test_ctrl_c_leaves_a_scan_that_is_resumed():
    def interrupt(now: rig.Progress) -> None:
        if now.done == 2:
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(InterruptedScanError, match=r"2 of 6 positions are safe .* rig\.resume\('a\.h5'\)"):
        rig.scan("a.h5", progress=interrupt, **SMALL)
    with rig.resume("a.h5") as scan, rig.scan("b.h5", **SMALL) as uninterrupted:
        assert scan.status == "complete"
        np.testing.assert_array_equal(scan.counts(), uninterrupted.counts())


def test_a_callback_that_fails_leaves_a_scan_that_is_resumed():
    def fail(now: rig.Progress) -> None:
        if now.done == 3:
            raise ZeroDivisionError("in the callback")

    with pytest.raises(ZeroDivisionError, match="in the callback"):
        rig.scan("a.h5", progress=fail, **SMALL)
    with rig.open_scan("a.h5") as scan:
        assert scan.status == "failed"
        assert any("laser dark" in note.sentence for note in scan.file.events)
    with rig.resume("a.h5") as scan:
        assert scan.status == "complete"


class Steady:
    """A timing instrument that counts the same everywhere; it remembers whether it was left."""

    identity, bins, bin_width_s, first_bin_s = "Steady", 50, 1e-9, 0.0

    def __init__(self):
        self.entered, self.left = 0, 0

    def __enter__(self):
        self.entered += 1
        return self

    def __exit__(self, *problem):
        self.left += 1

    def settings(self):
        return {}

    def rates(self):
        return SimpleNamespace(sync_hz=10e6, input_hz=1e5)

    def warnings(self):
        return ()

    def measure(self, exposure_s, meanwhile):
        counts = np.full((1, self.bins), 3, np.uint32)
        return SimpleNamespace(counts=counts, photons=150, live_time_s=exposure_s, warnings=(), whole=True)


def test_a_device_of_ones_own_measures_and_goes_on_with_a_scan():
    mine = Steady()
    part = rig.scan("a.h5", devices={"tcspc": mine}, progress=lambda now: now.done == 4, **SMALL)
    part.close()
    with pytest.raises(RefusedError, match="began with the tcspc 'Steady'"):
        rig.resume("a.h5")
    with rig.resume("a.h5", devices={"tcspc": mine}) as scan:
        assert (scan.counts() == 3).all()
        assert scan.info["photons"] == 6 * 150
    assert (mine.entered, mine.left) == (2, 2)


def test_text_and_numbers_ask_the_same(letters):
    with rig.open_scan(letters) as scan:
        text = scan.image(wavelength="40cm", depth="0.9m:1.6m:10cm", voxel="16cm")
        numbers = scan.image(wavelength=0.4, depth=(0.9, 1.6, 0.1), voxel=0.16)
    np.testing.assert_array_equal(text.intensity, numbers.intensity)
    assert (text.x_m, text.y_m)[0][0] == numbers.x_m[0]
    # nothing of the program that called is in the file: there was no command
    assert text.volume.command == ""


def test_a_scan_shows_itself(letters):
    with rig.open(letters) as scan:
        assert repr(scan) == f"<rig.Scan {letters}: complete, 108 positions, 15000 bins>"
        assert "<td style='text-align:left'>12 x 9 positions 16 cm apart" in scan._repr_html_()
        np.testing.assert_array_equal(scan.counts(slice(4, 20, 5)), scan.counts()[4:20:5])
        np.testing.assert_array_equal(scan.histogram(-1), scan.counts()[-1])
    assert repr(scan) == f"<rig.Scan {letters}, closed>"
    with pytest.raises(UsageError, match=r"was closed; open it again with rig\.open"):
        scan.histogram(0)


def test_an_image_replaces_nothing_unless_asked(letters):
    with rig.open_scan(letters) as scan:
        image = scan.image(wavelength="40cm", depth="0.9m:1.1m:10cm")
    image.save("a.h5").save("a.h5", replace=True)
    with pytest.raises(UsageError, match=r"a\.h5 exists and is not overwritten"):
        image.save("a.h5")
    with pytest.raises(UsageError, match="is a scan, which replace=True does not replace"):
        image.save(letters, replace=True)
    with pytest.raises(UsageError, match=r"its ending must be \.html"):
        image.page("page.png")
    with pytest.raises(UsageError, match=r"its ending '\.doc' is not one of"):
        image.save("a.doc")
    with pytest.raises(UsageError, match=r"the truth has \(2, 3\) pixels"):
        image.measure(np.zeros((2, 3)))


def test_a_name_in_a_notebook_is_text_and_no_markup(letters):
    with rig.open_scan(letters) as scan:
        image = scan.image(wavelength="40cm", depth="0.9m:1.1m:10cm")
    odd = rig.Image(dataclasses.replace(image.volume, scan="<script>x"))
    assert "<script>" not in odd._repr_html_()
    assert "&lt;script&gt;x" in odd._repr_html_()


def test_a_solver_of_the_wrong_shape_is_named(letters):
    def flat(problem):
        yield np.zeros((1, 2, 3), complex)

    with rig.open_scan(letters) as scan, pytest.raises(ParameterError, match=r"solver flat: .*\(1, 2, 3\)"):
        scan.image(solver=flat, wavelength="40cm", depth="1m:1m:10cm")
