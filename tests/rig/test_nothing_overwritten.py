"""No result replaces another one unless that was asked for; a scan is never replaced."""

import json
import os
import shlex
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

from rig.__main__ import Interrupts
from rig.errors import in_shell
from rig.files import ScanDescription, ScanFile, ScanWriter, Volume, read_volume, write_volume

SMALL = ("--grid", "12x8", "--spacing", "10cm", "--exposure", "10ms")
COARSE = ("--depth", "0.8m:1.2m:10cm")


@pytest.fixture(scope="module")
def scanned(tmp_path_factory):
    """Return the bytes of a small scan."""
    path = tmp_path_factory.mktemp("scan") / "a.h5"
    command = [sys.executable, "-m", "rig", "scan", *SMALL, "--out", str(path)]
    subprocess.run(command, check=True, capture_output=True)
    return path.read_bytes()


@pytest.fixture
def scan(scanned, tmp_path):
    (tmp_path / "a.h5").write_bytes(scanned)
    return tmp_path / "a.h5"


def test_each_try_of_an_image_is_kept(rig, scan, tmp_path):
    for wavelength in ("40cm", "50cm", "60cm"):
        done = rig("recon", "a.h5", "--wavelength", wavelength, *COARSE)
        assert done.code == 0, done.err
    made = sorted(path.name for path in tmp_path.iterdir())
    assert made == [
        "a-2-volume.h5", "a-2.png", "a-3-volume.h5", "a-3.png", "a-volume.h5", "a.h5", "a.png"
    ]  # fmt: skip
    for name, wavelength_m in (("a-volume.h5", 0.4), ("a-2-volume.h5", 0.5), ("a-3-volume.h5", 0.6)):
        assert read_volume(name).parameters["wavelength_m"] == wavelength_m
    done = rig("recon", "a.h5", "--wavelength", "70cm", *COARSE, "--force")
    assert done.code == 0, done.err
    assert read_volume("a-volume.h5").parameters["wavelength_m"] == 0.7
    assert len(list(tmp_path.iterdir())) == len(made)


@pytest.mark.parametrize(
    ("command", "name"),
    [
        (("recon", "a.h5", *COARSE, "--image"), "kept.png"),
        (("recon", "a.h5", *COARSE, "--out"), "kept.h5"),
        (("recon", "a.h5", *COARSE, "--camera", "transient", "--video"), "kept.gif"),
        (("plot", "a.h5", "--image"), "kept.png"),
        (("compare", "a.h5", "--out"), "kept.png"),
        (("list", "--sheet"), "kept.png"),
        (("report", "a.h5", "--out"), "kept.html"),
        (("export", "a.h5"), "kept.mat"),
        (("import", "a.h5"), "kept.h5"),
        (("scan", *SMALL, "--out"), "kept.h5"),
        (("sim", "render", "letters"), "kept.h5"),
    ],
)
def test_a_name_that_was_given_is_not_overwritten(rig, scan, tmp_path, command, name):
    (tmp_path / name).write_bytes(b"precious")
    before = sorted(tmp_path.iterdir())
    done = rig(*command, name)
    assert done.code == 2
    assert f"{name} exists and is not overwritten" in done.err
    assert (tmp_path / name).read_bytes() == b"precious"
    assert sorted(tmp_path.iterdir()) == before


def test_names_chosen_by_the_program_are_free_ones(rig, scan, tmp_path):
    for expected in ("a-plot.png", "a-2-plot.png"):
        done = rig("plot", "a.h5", "--json")
        assert done.code == 0, done.err
        assert json.loads(done.out)["picture"] == expected
    (tmp_path / "a-3-plot.png").symlink_to("nowhere")  # a name that leads nowhere is taken, too
    assert rig("plot", "a.h5").code == 0
    assert (tmp_path / "a-4-plot.png").is_file()


def test_force_replaces_results_and_no_scan(rig, scan, tmp_path, scanned):
    (tmp_path / "kept.png").write_bytes(b"old")
    assert rig("plot", "a.h5", "--image", "kept.png", "--force").code == 0
    assert (tmp_path / "kept.png").read_bytes().startswith(b"\x89PNG")
    (tmp_path / "b.h5").write_bytes(scanned)
    done = rig("recon", "a.h5", *COARSE, "--out", "b.h5", "--force")
    assert done.code == 2
    assert "b.h5 is a scan" in done.err
    assert (tmp_path / "b.h5").read_bytes() == scanned
    write_volume("old.h5", Volume(np.ones((1, 2, 2), "f4"), np.arange(2.0), np.arange(2.0), np.ones(1)))
    assert rig("recon", "a.h5", *COARSE, "--out", "old.h5", "--force").code == 0
    assert read_volume("old.h5").scan == "a.h5"
    (tmp_path / "notes.h5").write_text("mine")
    (tmp_path / "link.h5").symlink_to("nowhere")
    for name in ("notes.h5", "link.h5"):  # before anything is computed
        done = rig("recon", "a.h5", *COARSE, "--out", name, "--force")
        assert (done.code, "is no volume" in done.err) == (2, True)
    assert (tmp_path / "notes.h5").read_text() == "mine"
    assert not list(tmp_path.glob("*-2*"))


@pytest.mark.parametrize(
    "command",
    [
        "scan --out .",
        "recon a.h5 --out .",
        "recon a.h5 --image . --force",
        "export a.h5 .",
        "import a.h5 .",
        "report a.h5 --out .",
        "init --defaults --out .",
        "sim render letters .",
        "sim serve --write-config .",
        "doctor --log .",
    ],
)
def test_a_folder_is_no_name_of_a_result(rig, scan, tmp_path, command):
    done = rig(*command.split())
    assert done.code == 2
    assert ". is a folder; give the name of a file in it, e.g. NAME" in done.err
    assert sorted(tmp_path.iterdir()) == [scan]


def test_an_exported_scan_is_replaced_and_one_of_another_program_is_not(rig, scan, tmp_path):
    export = ("export", "a.h5", "a.hdf5", "--force")
    assert rig("export", "a.h5", "a.hdf5").code == 0
    assert rig("export", "a.h5", "a.hdf5").code == 2
    assert rig(*export).code == 0
    with h5py.File("a.hdf5", "r+") as file:
        file["scene_info"][()] = "original_format: y-tal"
    kept = (tmp_path / "a.hdf5").read_bytes()
    done = rig(*export)
    assert done.code == 2
    assert "a.hdf5 is a scan" in done.err
    assert (tmp_path / "a.hdf5").read_bytes() == kept


def test_a_picture_without_a_known_ending_is_refused_before_anything_is_computed(rig, scan, tmp_path):
    done = rig("recon", "a.h5", *COARSE, "--image", "picture")
    assert done.code == 2
    assert ".png" in done.err
    assert sorted(tmp_path.iterdir()) == [scan]


def opened(process):
    """Return the files that a process has open."""
    found = []
    for link in Path(f"/proc/{process}/fd").iterdir():
        with suppress(OSError):  # closed meanwhile
            found.append(os.readlink(link))
    return found


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="what a process has open is seen in /proc")
def test_ctrl_c_says_what_is_left(scan, tmp_path):
    command = [sys.executable, "-m", "rig", "recon", "a.h5", "--voxel", "4mm", "--depth", "0.5m:3m:2mm"]
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    while process.poll() is None and str(scan) not in opened(process.pid):
        time.sleep(0.02)  # until it reads the scan
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=60)
    assert process.returncode == 130, told
    assert "no file was written or changed" in told
    assert sorted(tmp_path.iterdir()) == [scan]


def test_hints_can_be_pasted_into_a_shell(rig, tmp_path):
    folder = tmp_path / "my dir"
    folder.mkdir()
    done = rig("scan", *SMALL, "--out", "my dir/o ut.h5")
    assert done.code == 0, done.err
    hint = done.err.splitlines()[-1]
    assert shlex.split(hint) == ["Next:", "rig", "recon", "my dir/o ut.h5"]
    with ScanFile(folder / "o ut.h5") as found:
        assert shlex.split(found.command)[-1] == "my dir/o ut.h5"
    assert in_shell("rig", "recon", "plain.h5") == "rig recon plain.h5"
    assert in_shell("rig", "recon", Path("-a.h5"), "-q") == f"rig recon {os.path.join('.', '-a.h5')} -q"


def test_the_summary_of_a_resumed_scan_is_of_the_whole(rig):
    assert rig("scan", *SMALL, "--out", "whole.h5").code == 0
    with ScanFile("whole.h5") as whole:
        photons, plan, state, counts = whole.photons, whole.plan, whole.state, whole.counts(range(24))
        description = ScanDescription(
            whole.laser_m, whole.detector_m, whole.bins, whole.bin_width_s, whole.first_bin_s,
            whole.delays, whole.channels, plan, state, simulated=True, devices=whole.devices,
        )  # fmt: skip
    with ScanWriter.create("a.h5", description) as writer:
        for histogram in counts:
            writer.append(histogram, 0.01)
    done = rig("resume", "a.h5", "--json")
    assert done.code == 0, done.err
    found = json.loads(done.out)
    assert (found["positions"], found["photons"]) == (len(plan), photons)
    assert found["photons_now"] == photons - counts.sum()
    assert found["live_time_s"] == pytest.approx(0.01 * len(plan), rel=0.05)  # its clock counts milliseconds


@pytest.mark.parametrize("again_s", [0.01, 0.0], ids=["later", "at once"])
def test_ctrl_c_is_not_lost_where_python_drops_it(monkeypatch, again_s):
    """What a destructor or a weak reference's callback raises is dropped, and what the hook itself raises."""
    monkeypatch.setattr("rig.__main__.AGAIN_S", again_s)

    class Dropping:
        def __del__(self):
            signal.raise_signal(signal.SIGINT)

    interrupts, before = Interrupts(), signal.getsignal(signal.SIGINT)
    monkeypatch.setattr(sys, "unraisablehook", interrupts.lost)
    signal.signal(signal.SIGINT, interrupts)
    try:
        Dropping()
        with pytest.raises(KeyboardInterrupt):
            time.sleep(10)
        for thread in threading.enumerate():
            if thread.name == "Ctrl-C":  # it may send once more
                thread.join()
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_dropped_ctrl_c_is_heard_once_by_a_scan_that_began_meanwhile():
    interrupts, before, heard = Interrupts(), signal.getsignal(signal.SIGINT), []
    signal.signal(signal.SIGINT, lambda *_: heard.append(1))
    try:
        interrupts.lost(SimpleNamespace(exc_type=KeyboardInterrupt))
        for thread in threading.enumerate():
            if thread.name == "Ctrl-C":
                thread.join()
    finally:
        signal.signal(signal.SIGINT, before)
    assert heard == [1]
