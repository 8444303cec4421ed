"""``rig calibrate galvo`` from the devices to the stored calibration."""

import json
import re

import numpy as np
import pytest
from matplotlib.quiver import Quiver

from rig.acquire.acquisition import Watch
from rig.acquire.connect import Station, open_station
from rig.bench.operator import BenchCamera
from rig.calibrate.galvo.flight import FlightRoutine
from rig.calibrate.galvo.routine import CameraRoutine
from rig.errors import CalibrationError, DataFileError, UsageError
from rig.files import ScanFile
from rig.model.config import built_in
from rig.model.plan import ScanPlan
from rig.model.state import RigState
from rig.show.volume import X_LABEL
from simulators.optics.cameras import Camera
from simulators.optics.lens import Intrinsics, Pose
from support.drawn import coloured, leftwards, line, panel
from support.misaligned import errors_m, misaligned

#: A quarter of the default cameras' pixels, so that their pictures are quickly drawn.
SMALL = Intrinsics(550.0, 550.0, 319.5, 239.5, 640, 480)
PLACES = ((-0.9, 0.5, 2.4), (0.9, 0.4, 2.6))


def test_with_cameras_the_beam_goes_where_it_is_asked_to(tmp_path):
    """All faults and misalignments; 2 mm, since small pictures and few boards are less good than usual."""
    config = misaligned(seed=1)
    routine = CameraRoutine(columns=4, rows=4, boards=7, darks=4)
    with open_station(config, None) as opened:
        cameras = tuple(
            BenchCamera(opened.operator, Camera(Pose.looking_at(place, (0.0, 0.0, 0.0)), SMALL), number)
            for number, place in enumerate(PLACES, 1)
        )
        station = Station(opened.devices, opened.operator, cameras)
        files = routine.measure(station, RigState(config), tmp_path, Watch())
        assert not opened.devices.laser.emitting()
    found = routine.fit(files, RigState(config))
    spots_m = ScanPlan.grid(config, columns=19, rows=14, spacing_m=0.099).spots_m
    assert np.linalg.norm(errors_m(found, config, spots_m), axis=1).max() < 2e-3
    assert found.method == "cameras"
    assert found.positions == 16
    assert set(found.measured_from) == {"galvo-images.h5"}
    figure = routine.figure(files, found)
    wall, residuals = panel(figure, "y (m)"), panel(figure, "residual along y (mm)")
    spots_m = np.array(found.spots_m)
    off_m = spots_m - found.pointing().spots_m(np.array(found.mirror_rad))[:, :2]
    np.testing.assert_allclose(line(wall, "measured spot"), spots_m)
    np.testing.assert_allclose(residuals.lines[-1].get_xydata(), 1e3 * off_m)
    assert_arrows(wall, spots_m, off_m)


def test_without_cameras_the_command_stores_a_calibration_that_scans_use(rig):
    measured = rig(
        "calibrate", "galvo", "--method", "flight", "--columns", 5, "--rows", 4, "--keep", "raw", "--json"
    )
    assert measured.code == 0, measured.err
    found = json.loads(measured.out)["calibration"]
    assert found["method"] == "flight"
    # nothing is misaligned here: the model's spots are the configured mirror's, within 5 mm
    assert found["spot_error_m"] < 5e-3
    again = rig(
        "calibrate", "galvo", "--method", "flight", "--json",
        "--from", "raw/galvo-flight.h5", "--from", "raw/galvo-marks.json",
    )  # fmt: skip
    assert json.loads(again.out)["calibration"]["mirror_m"] == pytest.approx(found["mirror_m"])
    dry = rig("scan", "--dry-run")
    assert dry.code == 0, dry.err


@pytest.mark.parametrize(("seed", "incidence"), [(0, None), (1, None), (2, "45deg")])
def test_without_cameras_the_beam_goes_where_it_is_asked_to(tmp_path, seed, incidence):
    config = misaligned(seed, incidence=incidence)
    routine = FlightRoutine(columns=6, rows=5)
    with open_station(routine.setup(config), None) as station:
        files = routine.measure(station, RigState(routine.setup(config)), tmp_path, Watch())
    found = routine.fit(files, RigState(config))
    spots_m = ScanPlan.grid(config, columns=19, rows=14, spacing_m=0.099).spots_m
    assert np.linalg.norm(errors_m(found, config, spots_m), axis=1).max() < 5e-3
    figure = routine.figure(files, found)
    wall = panel(figure, "y (m)")
    marks_m = np.array(found.spots_m)
    modelled_m = found.pointing().spots_m(np.array(found.mirror_rad))[:, :2]
    np.testing.assert_allclose(line(wall, "mark"), marks_m)
    assert_arrows(wall, marks_m, modelled_m - marks_m)
    with ScanFile(files[0]) as scan:
        measured_m = found.pointing().spots_m(scan.mirror_rad)[:, :2]
    places_m, left_ps = coloured(wall)
    assert {tuple(place) for place in places_m.round(9)} <= {tuple(spot) for spot in measured_m.round(9)}
    over = panel(figure, "path mirror - wall - detector (m)")
    np.testing.assert_allclose(over.lines[1].get_ydata(), left_ps)


def assert_arrows(wall, from_m, along_m):
    """Arrows begin at the spots and are the differences, as many times larger as the legend says."""
    (arrows,) = (one for one in wall.collections if isinstance(one, Quiver))
    times = float(re.search(r"([\d.e+]+) times", arrows.get_label())[1])
    np.testing.assert_allclose(arrows.get_offsets(), from_m)
    np.testing.assert_allclose(np.column_stack([arrows.U, arrows.V]), times * along_m)
    assert wall.get_xlabel() == X_LABEL
    assert leftwards(wall)


def test_marks_are_asked_for_and_looked_at(tmp_path):
    routine, marks = FlightRoutine(), tmp_path / "marks.json"
    with pytest.raises(UsageError, match="one scan and one file of marks"):
        routine.fit([tmp_path / "scan.h5"], RigState(built_in()))
    scan = tmp_path / "flight"
    scan.mkdir()
    small = FlightRoutine(columns=4, rows=3)
    with open_station(small.setup(built_in()), None) as station:
        files = small.measure(station, RigState(small.setup(built_in())), scan, Watch())
    for text, reason in (("{", "is not a file of marks"), ('{"format": "other"}', "is not a file of marks")):
        marks.write_text(text)
        with pytest.raises(DataFileError, match=reason):
            small.fit([files[0], marks], RigState(built_in()))
    content = json.loads(files[1].read_text())
    marks.write_text(json.dumps({**content, "galvo": "another mirror"}))
    with pytest.raises(DataFileError, match="is of the mirror 'another mirror'"):
        small.fit([files[0], marks], RigState(built_in()))
    marks.write_text(json.dumps({**content, "marks": content["marks"][:3]}))
    with pytest.raises(CalibrationError, match="3 marks are too few"):
        small.fit([files[0], marks], RigState(built_in()))


def test_without_two_cameras_nothing_begins(tmp_path):
    with open_station(built_in(), None) as opened:
        station = Station(opened.devices, opened.operator, opened.cameras[:1])
        with pytest.raises(CalibrationError, match="two cameras are needed, 1 are configured"):
            CameraRoutine().measure(station, RigState(built_in()), tmp_path, Watch())
    assert not list(tmp_path.iterdir())
