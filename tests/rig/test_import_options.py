"""Every option of an import, for every layout: it is honoured, refused by name, or told of; never ignored."""

import h5py
import numpy as np
import pytest

from rig.errors import DataFileError, UsageError
from rig.files import ScanFile
from rig.importers import LAYOUTS, import_scan
from rig.importers.options import SPELLING, Given
from support.layout_examples import EXAMPLES, _mat, _neutral
from support.scan_files import load
from support.thorough import THOROUGH

#: Two values of each option that no example holds.
VALUES = {
    "bin_width_s": (33e-12, 35e-12),
    "wall_size_m": (0.7, 0.9),
    "depth_pitch_m": (0.01, 0.02),
    "time_origin": ("wall", "laser"),
    "fade_from_s": (5e-12, 9e-12),
    "delays": ("first.mat", "second.mat"),
    "bounces": ((1,), (2, 3)),
    "grid": ((3, 3), (2, 2)),
    "spacing_m": (0.01, 0.02),
    "order": ("x,-y", "y,x"),
    "snake": (True, False),
    "detector": ("confocal", (0.1, 0.0)),
    "places": ("first.h5", "second.h5"),
    "point_marker": (1, 3),
    "line_marker": (2, 4),
    "time_zero_s": (1e-12, 2e-12),
    "input": (0, 5),
}


def content_of(path):
    """Return all that a scan file says of its photons, by name, as bytes."""
    found = {}
    with h5py.File(path) as file:
        for name in ("transients", "geometry"):
            found |= {f"{name}@{key}": np.asarray(value).tobytes() for key, value in file[name].attrs.items()}
            found |= {f"{name}/{key}": value[()].tobytes() for key, value in file[name].items()}
    return found


def test_each_option_has_values_here():
    assert set(VALUES) == set(SPELLING) == set(Given.__annotations__)
    assert set(EXAMPLES) == {layout.NAME for layout in LAYOUTS}


#: Each option of each layout; in the short tests every other one, of neighbouring layouts in turn.
PAIRS = [
    pytest.param(layout, option, id=f"{layout}-{option}")
    for row, layout in enumerate(EXAMPLES)
    for column, option in enumerate(VALUES)
    if THOROUGH or (row + column) % 2
]


@pytest.mark.parametrize(("layout", "option"), PAIRS)
def test_no_option_is_ignored(tmp_path, layout, option):
    write, needed = EXAMPLES[layout]
    source = write(tmp_path)
    for name, delay in (("first.mat", 100.0), ("second.mat", 200.0)):
        _mat(tmp_path, name, tofgrid=np.full((3, 3), delay))
    contents = []
    for number, value in enumerate(VALUES[option]):
        target = tmp_path / f"{number}.h5"
        value = tmp_path / value if option == "delays" else value
        try:
            report = import_scan(source, target, **(needed | {option: value}))
        except UsageError as error:
            assert SPELLING[option] in str(error)  # noqa: PT017
            assert not target.exists()
            contents.append("refused")
        else:
            told = any(SPELLING[option] in line for line in report.assumed)
            contents.append("told" if told else content_of(target))
    # honoured: two values make two files
    assert contents[0] != contents[1] or contents[0] in {"refused", "told"}


def test_what_agrees_with_the_file_is_taken_and_told(tmp_path):
    report = import_scan(
        _neutral(tmp_path), tmp_path / "b.h5", bin_width_s=32e-12, time_origin="wall", wall_size_m=0.4
    )
    assert sum("agrees with the file" in line for line in report.assumed) == 3
    with pytest.raises(UsageError, match=r"--bin-width 33 ps contradicts .*a.h5.*its bins are 32 ps wide"):
        import_scan(tmp_path / "a.h5", tmp_path / "c.h5", bin_width_s=33e-12)


def test_a_fade_must_leave_something_and_says_what_it_replaces(tmp_path):
    source = _neutral(tmp_path)
    with pytest.raises(UsageError, match=r"--fade-from 300 ps would fade out all of .*ends at 256 ps"):
        import_scan(source, tmp_path / "b.h5", fade_from_s=300e-12)
    with h5py.File(source, "r+") as file:
        file.attrs["gate_start_s"] = 40e-12
    report = import_scan(source, tmp_path / "b.h5", fade_from_s=80e-12)
    assert any("80 ps" in line and "not what comes before 40 ps" in line for line in report.assumed)


def test_a_time_origin_must_be_one_of_the_two(rig, tmp_path):
    _neutral(tmp_path)
    done = rig("import", "a.h5", "b.h5", "--time-origin", "moon")
    assert (done.code, "must be wall or laser, not 'moon'" in done.err) == (2, True)


# --- the time origin that a neutral file says


def with_origin(folder, text, **attributes):
    source = _neutral(folder)
    with h5py.File(source, "r+") as file:
        file.attrs.update(attributes)
        del file.attrs["time_origin"]
        if text is not None:
            file.attrs["time_origin"] = text
    return source


@pytest.mark.parametrize("text", ["laser", "LASER", "t = 0 when the pulse leaves the laser head"])
def test_time_from_the_laser_is_never_taken_as_rectified(tmp_path, text):
    source = with_origin(tmp_path, text)
    with pytest.raises(DataFileError, match=r"time origin is laser.*delay_s.*laser_head_m"):
        import_scan(source, tmp_path / "b.h5")
    with pytest.raises(DataFileError, match="time origin is laser"):
        import_scan(source, tmp_path / "b.h5", time_origin="wall")
    assert not (tmp_path / "b.h5").exists()


def test_time_from_the_laser_is_rectified_by_the_heads(tmp_path):
    heads_m = {"laser_head_m": [0.1, 0.0, 1.0], "detector_head_m": [-0.2, 0.1, 1.5]}
    source = with_origin(tmp_path, "laser", electronics_delay_s=3e-9, **heads_m)
    assert import_scan(source, tmp_path / "b.h5").time_origin == "laser"
    capture, _ = load(tmp_path / "b.h5")
    path_m = np.linalg.norm(capture.laser_m - heads_m["laser_head_m"], axis=1) + np.linalg.norm(
        capture.detector_m - heads_m["detector_head_m"], axis=1
    )
    np.testing.assert_allclose(capture.first_bin_s, -3e-9 - path_m / 299_792_458.0, atol=1e-18)
    with pytest.raises(UsageError, match=r"--time-origin wall contradicts .*: its time includes the paths"):
        import_scan(source, tmp_path / "c.h5", time_origin="wall")


def test_time_from_the_laser_is_rectified_by_measured_delays(tmp_path):
    source = with_origin(tmp_path, "laser")
    with h5py.File(source, "r+") as file:
        file["delay_s"] = np.arange(9) * 1e-9
    import_scan(source, tmp_path / "b.h5")
    with ScanFile(tmp_path / "b.h5") as scan:
        np.testing.assert_allclose(scan.delay_s[:, 0], np.arange(9) * 1e-9)
        np.testing.assert_allclose(scan.capture().first_bin_s, -np.arange(9) * 1e-9, atol=1e-20)


def test_a_time_origin_that_says_neither_is_asked_for(tmp_path):
    source = with_origin(tmp_path, "trigger of the scope")
    with pytest.raises(UsageError, match=r"'trigger of the scope'.*--time-origin"):
        import_scan(source, tmp_path / "b.h5")
    report = import_scan(source, tmp_path / "b.h5", time_origin="wall")
    assert any("'trigger of the scope', was used as wall" in line for line in report.assumed)


def test_a_file_without_its_time_origin_is_said_to_be_rectified(tmp_path):
    report = import_scan(with_origin(tmp_path, None), tmp_path / "b.h5")
    assert any("does not contain what its t = 0 is" in line for line in report.assumed)


def test_times_of_flight_from_two_places_are_refused(tmp_path):
    tof = np.full((3, 3), 100.0)
    _mat(tmp_path, "tof.mat", tofgrid=tof)
    source = _mat(tmp_path, meas=np.ones((3, 3, 4)), tofgrid=2 * tof)
    given = {"bin_width_s": 32e-12, "wall_size_m": 1.0}
    with pytest.raises(UsageError, match="holds tofgrid itself; leave --tof"):
        import_scan(source, tmp_path / "b.h5", **given, delays=tmp_path / "tof.mat")


def test_a_neutral_file_that_is_not_as_confocal_as_it_says_is_told_of(tmp_path):
    source = with_origin(tmp_path, "wall", confocal=True)
    report = import_scan(source, tmp_path / "b.h5")
    assert any("confocal is True, but its places show the opposite" in line for line in report.assumed)


def test_a_fade_is_held_against_rectified_time(tmp_path):
    source = with_origin(tmp_path, "laser")
    with h5py.File(source, "r+") as file:
        file["delay_s"] = np.full(9, 100e-12)  # of 256 ps, 156 are left
    with pytest.raises(UsageError, match="its record ends at 156 ps"):
        import_scan(source, tmp_path / "b.h5", fade_from_s=200e-12)
    import_scan(source, tmp_path / "b.h5", fade_from_s=150e-12)


def test_a_record_that_the_layout_fades_out_whole_is_told_of(tmp_path):
    write, needed = EXAMPLES["O'Toole 2018, LCT"]
    report = import_scan(write(tmp_path), tmp_path / "b.h5", **needed)
    assert any("all of the record is faded out" in line for line in report.assumed)
