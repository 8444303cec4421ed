"""Seventeen defects that people met when they used this program, each as one test.

Where a test elsewhere holds a defect already, at length or with devices that are killed, it is named here, so
that it does not go away unnoticed. The others stand here in their smallest form, as a person would meet them.
"""

import json
import re
from datetime import UTC, datetime
from pathlib import Path

import pytest

from rig.errors import in_shell
from rig.model.calibrations.headlines import headline
from rig.model.calibrations.kinds import BinWidths
from rig.model.config import load

TESTS = Path(__file__).parents[1]
SMALL = ("--grid", "6x4", "--spacing", "10cm", "--exposure", "1ms")


def held_by(file, name):
    """Assert that a test is there that holds a defect."""
    text = (TESTS / file).read_text(encoding="utf-8")
    assert re.search(rf"^def {name}\(", text, re.MULTILINE), f"{file} has no {name}"


def test_d01_a_closed_terminal_leaves_no_light():
    held_by("rig/test_faults_f01_to_f19.py", "test_f02_a_closed_terminal_puts_the_light_out")
    held_by("rig/test_faults_f01_to_f19.py", "test_f03_a_killed_program_leaves_no_light")


def test_d02_that_light_is_on_and_that_it_is_off_is_said(rig):
    done = rig("scan", *SMALL, "--out", "a.h5", "--json")
    assert done.code == 0, done.err
    assert re.search(r"LASER ON since .*\n(.*\n)*laser dark, read back", done.err)
    assert json.loads(done.out)["laser"]["emitting"] is False


def test_d03_the_wavelength_that_is_chosen_suits_coarse_scans():
    held_by(
        "recon/test_advice.py",
        "test_a_coarse_grid_asks_for_a_longer_wave_the_longer_the_fewer_positions",
    )


def test_d04_a_scan_is_looked_at_while_it_runs():
    held_by("rig/test_two_programs.py", "test_a_scan_that_runs_is_read_up_to_its_last_line")
    held_by("rig/test_info_and_list.py", "test_a_scan_that_grows_is_told_as_far_as_it_is")


def test_d05_a_failure_says_what_is_safe_and_how_to_go_on():
    held_by("rig/test_faults_f01_to_f19.py", "test_f09_a_full_disk_keeps_what_was_saved")
    held_by(
        "rig/test_nasty_situations.py",
        "test_one_answer_of_the_mirror_that_is_lost_ends_no_scan_and_is_told",
    )


def test_d06_no_photons_and_nothing_but_noise_are_said():
    held_by("rig/test_nasty_situations.py", "test_a_level_above_the_detector_s_pulses_is_told")
    held_by("rig/test_pictures.py", "test_noise_alone_is_said_across_the_picture")


def test_d07_a_film_ends_with_its_light():
    held_by("rig/test_recon_cameras.py", "test_a_video_of_light_begins_and_ends_where_the_light_does")


def test_d08_an_image_destroys_none_before_it():
    held_by("rig/test_nothing_overwritten.py", "test_each_try_of_an_image_is_kept")


@pytest.mark.parametrize(
    ("text", "arguments", "said"),
    [
        ('[tcspc]\nbin_width = "5ps"\n', (), "5 ps"),
        ('[laser]\nrepetition = "10mHz"\n', (), "repetition"),
        ('[detector]\ngate_width = "400ns"\n', (), "detector.gate_width"),
        ("", ("--out", "d.toml"), "exists"),
        ("", ("--scene", "leters"), "'leters'"),
    ],
)
def test_d09_a_dry_run_finds_what_would_end_the_scan(rig, text, arguments, said):
    Path("d.toml").write_text(text + "[simulation]\n", encoding="utf-8")
    done = rig("scan", "--config", "d.toml", *SMALL, *arguments, "--dry-run")
    assert done.code in (2, 4), done
    assert said in done.err


def test_d10_numbers_of_a_resumed_scan_belong_together():
    held_by("rig/test_nothing_overwritten.py", "test_the_summary_of_a_resumed_scan_is_of_the_whole")


@pytest.mark.parametrize(
    "arguments",
    [
        ("scan", "--dry-run", "--exposure", "1e400s"),
        ("scan", "--dry-run", "--grid", "100000x100000"),
        ("recon", "a.h5", "--voxel", "0.01mm"),
        ("recon", "a.h5", "--depth", "0.5m:300m:1mm"),
    ],
)
def test_d11_what_cannot_be_is_refused_in_words_with_its_document(rig, arguments):
    if arguments[0] == "recon":
        assert rig("scan", *SMALL, "--out", "a.h5").code == 0
    done = rig(*arguments, "--json")
    assert done.code in (2, 4), done
    assert "Traceback" not in done.err
    assert "defect" not in done.err
    assert json.loads(done.out)["exit_code"] == done.code


def test_d12_documented_commands_run_as_written(rig):
    """Also: `rig calibrate all` leaves the mirror out where OpenCV is missing."""
    held_by(
        "calibration/test_calibrate_without_opencv.py",
        "test_a_missing_opencv_is_a_matter_of_what_is_installed",
    )
    done = rig("scan", "--scene", "model.obj", *SMALL)
    assert done.code == 2
    assert "model.obj: there is no such file" in done.err


def test_d13_pictures_can_be_read_and_traced():
    held_by("rig/test_pictures.py", "test_labels_of_a_tiny_volume_do_not_collide")
    held_by("rig/test_pictures.py", "test_no_quarter_of_the_sheet_is_empty")
    held_by("rig/test_pictures.py", "test_a_caption_traces_a_picture_to_its_scan")
    held_by("rig/test_pictures.py", "test_depths_can_be_told_apart_in_a_grey_print")


def test_d14_the_mark_that_notepad_writes_is_read(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_bytes(b"\xef\xbb\xbf[scan]\r\ncolumns = 7\r\n[simulation]\r\n")
    assert load(path).scan.columns == 7


def test_d15_hints_can_be_pasted(tmp_path):
    assert in_shell("rig", "recon", "my dir/o ut.h5") != "rig recon my dir/o ut.h5"
    held_by("rig/test_nothing_overwritten.py", "test_hints_can_be_pasted_into_a_shell")


def bin_widths(nonlinearity, at_most, kept):
    return BinWidths(
        created=datetime(2026, 1, 1, tzinfo=UTC), valid_days=365, rig_name="lab", devices={},
        measured_from={}, bin_width_s=4e-12, first_bin_s=0.0, measured=[1.0], counts_per_bin=728.0,
        nonlinearity=nonlinearity, nonlinearity_at_most=at_most, kept=kept,
    )  # fmt: skip


def test_d16_a_calibration_that_saw_nothing_says_so():
    nothing = headline(bin_widths(0.0048, 0.0074, 0.02))
    assert nothing == (
        "728 counts a bin show no difference of widths; it is 0.74% rms at most, "
        "and of a counted deviation 2% is believed"
    )
    assert headline(bin_widths(0.0048, 0.0052, 0.5)).startswith("widths differ by 0.48% rms (0.52% at most)")


@pytest.mark.parametrize("arguments", [("scan", "--bogus"), ("scan", "--seed", "abc"), ("recon", "none.h5")])
def test_d17_failures_have_their_document(rig, arguments):
    done = rig(*arguments, "--json")
    assert done.code in (2, 5)
    said = json.loads(done.out)
    assert said["exit_code"] == done.code
    assert said["schema_version"] == 1


def test_d17_small_things(rig):
    held_by("rig/test_config_inherited.py", "test_calibrations_lie_where_the_file_that_says_it_lies")
    held_by("rig/test_doctor.py", "test_calibrations_are_looked_through")
    held_by(
        "rig/test_nothing_overwritten.py",
        "test_a_picture_without_a_known_ending_is_refused_before_anything_is_computed",
    )
    assert rig("doctor").out.startswith("Simulated rig: ")
