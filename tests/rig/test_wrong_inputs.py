"""Wrong inputs at the command line, of all verbs: a message that names thing and remedy, and one document."""

import json
import os
import shlex
import signal
import subprocess
import sys

import numpy as np
import pytest

from rig.__main__ import main
from rig.files import ScanDescription, ScanWriter
from rig.files.volume import Volume, write_volume

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pipes, devices and signals of POSIX")

#: Longest that a refusal may take, imports and a busy computer included.
BOUND_S = 60.0
LONG = "n" * 300
#: Names that no table can hold as they are.
NAMES = {"LONG": LONG, "BYTES": os.fsdecode(b"x\xff"), "NEWLINE": "a\nb", "EMPTY": ""}

DRY = "scan --dry-run --grid 4x3 --spacing 10cm"
SCAN = "scan --grid 4x3 --spacing 10cm --out new.h5"
RECON = "recon small.h5 --voxel 10cm --depth 0.5m:1m:10cm"
IMPORT = "import foreign.mat new.h5"

#: (command line, exit code, what the message names, what it says to do)
CASES = [
    # quantities and their units
    (f"{DRY} --exposure 1e400s", 2, "1e400s", "10ms"),
    (f"{DRY} --exposure 0s", 2, "exposure", "above 0"),
    (f"{DRY} --exposure=-1ms", 2, "-0.001", "above 0"),
    (f"{DRY} --exposure 10", 2, "'10' has no unit", "10ms"),
    (f"{DRY} --exposure 10cm", 2, "'10cm' is not a time", "10ms"),
    (f"{DRY} --exposure 'nan s'", 2, "'nan s'", "10ms"),
    (f"{DRY} --exposure 'inf s'", 2, "'inf s'", "10ms"),
    (f"{DRY} --exposure 10xs", 2, "unknown unit 'xs'", "10ms"),
    (f"{DRY} --exposure 10dB", 2, "'10dB'", "10ms"),
    (f"{DRY} --exposure EMPTY", 2, "--exposure: its value is empty", "leave it out"),
    (f"{DRY} --exposure 1e-300s", 4, "1e-297 ms", "1 ms"),
    ("scan --dry-run --spacing 0cm", 2, "spacing", "above 0"),
    ("scan --dry-run --spacing=-1cm", 2, "-0.01", "above 0"),
    ("scan --dry-run --spacing 5cm", 4, "180 x 130 at 5 cm", "smaller grid or spacing"),
    ("scan --dry-run --grid 100000x100000", 2, "10,000,000,000 positions", "5,000,000"),
    ("scan --dry-run --grid 180", 2, "'180' is not a grid", "--grid 180x130"),
    ("scan --dry-run --grid 1x1", 2, "'1x1'", "at least 2"),
    ("scan --dry-run --grid=-3x4", 2, "'-3x4'", "--grid 180x130"),
    ("scan --dry-run --grid 1.5x2", 2, "'1.5x2'", "--grid 180x130"),
    # numbers and words of scan
    (f"{DRY} --frames 1000000000000", 2, "'1000000000000'", "--frames 10"),
    (f"{DRY} --frames 999999999", 2, "11,999,999,988 positions", "5,000,000"),
    (f"{DRY} --frames 0", 2, "'0'", "from 1 on"),
    (f"{DRY} --frames until-stopped", 2, "until-stopped", "--mode continuous"),
    (f"{DRY} --until foo", 2, "'foo'", "likeness 0.99"),
    (f"{DRY} --until 'likeness 3'", 2, "'likeness 3'", "below 1"),
    (f"{DRY} --until 'contrast nan'", 2, "'contrast nan'", "contrast 30"),
    (f"{DRY} --until 'time -1s'", 2, "'time -1s'", "time 60s"),
    (f"{DRY} --seed -1", 2, "--seed: '-1'", "0 or more"),
    (f"{DRY} --seed 1.5", 2, "--seed: '1.5'", "whole number"),
    (f"{DRY} --seed abc", 2, "--seed: 'abc'", "rig scan --help"),
    (f"{DRY} --seed", 2, "--seed", "--help"),
    (f"{DRY} --order spiral", 2, "'spiral'", "progressive"),
    (f"{DRY} --mode fast", 2, "'fast'", "continuous"),
    (f"{DRY} --scene leters", 2, "'leters'", "letters"),
    (f"{DRY} --scene nowhere.obj", 2, "nowhere.obj", "no such file"),
    (f"{DRY} --scene folder", 2, "'folder'", "OBJ, PLY or STL"),
    (f"{DRY} --scene text.h5", 2, "'text.h5'", "OBJ, PLY or STL"),
    (f"{DRY} --preset office", 2, "'office'", "did you mean"),
    # options that contradict each other
    (f"{DRY} --ptu", 2, "--ptu", "--mode continuous"),
    (f"{DRY} --fresh-to 1m", 2, "--fresh-to", "--live and --frames"),
    (f"{DRY} --video new.gif", 2, "--video", "--live and --frames"),
    (f"{DRY} --live --frames 2 --video new.xyz", 2, "new.xyz", ".gif or .mp4"),
    (f"{DRY} --live --frames 2 --fresh-to 0m", 2, "--fresh-to 0m", "use e.g. 1m"),
    (f"{DRY} --quiet --verbose", 2, "--quiet and --verbose", "one of them"),
    (f"{DRY} --dry-run=3", 2, "--dry-run", "does not take a value"),
    # where a scan goes to
    (f"{DRY} --out folder", 2, "folder is a folder", "name of a file"),
    (f"{DRY} --out small.h5", 2, "small.h5 exists", "another name"),
    (f"{DRY} --out nowhere/new.h5", 2, "nowhere", "create it first"),
    (f"{DRY} --out /proc/new.h5", 2, "/proc/new.h5", "another folder"),
    (f"{DRY} --out /dev/full", 2, "/dev/full exists", "another name"),
    (f"{DRY} --out /dev/null", 2, "/dev/null exists", "another name"),
    (f"{DRY} --out LONG.h5", 2, LONG, "shorter"),
    (f"{DRY} --out loop.h5", 2, "loop.h5 exists", "another name"),
    (f"{DRY} --out pipe.h5", 2, "pipe.h5 exists", "another name"),
    (f"{DRY} --out small.h5/new.h5", 2, "small.h5/new.h5", "another name"),
    (f"{DRY} --out EMPTY", 2, "--out: its value is empty", "leave it out"),
    # configurations
    (f"{DRY} --config nowhere.toml", 2, "nowhere.toml", "path of a TOML file"),
    (f"{DRY} --config folder", 2, "folder", "path of a TOML file"),
    (f"{DRY} --config pipe.h5", 2, "pipe.h5", "to a file"),
    (f"{DRY} --config loop.h5", 2, "loop.h5", "path of a TOML file"),
    (f"{DRY} --config LONG", 2, LONG, "path of a TOML file"),
    (f"{DRY} --config BYTES", 2, "x\\udcff", "path of a TOML file"),
    (f"{DRY} --config latin.toml", 2, "latin.toml", "save it as UTF-8"),
    (f"{DRY} --config small.h5", 2, "small.h5", "UTF-8"),
    (f"{DRY} --config nan.toml", 2, "nan.toml: scan.exposure", "10ms"),
    (f"{DRY} --config number.toml", 2, "number.toml: scan.exposure", "10ms"),
    (f"{DRY} --config types.toml", 2, "scan.columns: 1.5", "whole number"),
    (f"{DRY} --config types.toml", 2, "simulation.seed: 'abc'", "whole number"),
    (f"{DRY} --config unknown.toml", 2, "'scan.exposre'", "'exposure'"),
    (f"{DRY} --config cut.toml", 2, "cut.toml", "line 1"),
    (f"{DRY} --config real.toml", 2, "real.toml", "galvo.address"),
    (f"{DRY} --config /dev/zero", 2, "/dev/zero", "1 MB"),
    (f"{DRY} --config EMPTY", 2, "--config: its value is empty", "leave it out"),
    # images
    (f"{RECON} --wavelength 4", 2, "'4' has no unit", "4cm"),
    (f"{RECON} --wavelength 1e-30m", 2, "1e-30 m", "Try 4 cm"),
    (f"{RECON} --wavelength 0m", 2, "wavelength 0 m", "Try 4 cm"),
    (f"{RECON} --wavelength=-4cm", 2, "-0.04 m", "Try 4 cm"),
    (f"{RECON} --cycles nan", 2, "nan cycles", "usual number is 2"),
    (f"{RECON} --cycles 1e308", 2, "1e+308 cycles", "usual number is 2"),
    (f"{RECON} --cycles x", 2, "--cycles: 'x'", "a number"),
    (f"{RECON} --snr 0.8", 2, "--snr", "--solver lct"),
    (f"{RECON} --snr nan --solver lct", 2, "ratio of nan", "above 0"),
    (f"{RECON} --solver guess", 2, "'guess'", "'rsd'"),
    (f"{RECON} --camera foto", 2, "'foto'", "'photo'"),
    (f"{RECON} --memory 1B", 2, "memory", "34 MB"),
    (f"{RECON} --memory 1e300GB", 2, "1e300GB", "2GB"),
    (f"{RECON} --fade-from 1s", 2, "--fade-from 1 s", "earlier"),
    (f"{RECON} --frames 2ns:20ns:0.2ns", 2, "--frames", "--camera transient"),
    (f"{RECON} --over max", 2, "--over", "--camera transient"),
    (f"{RECON} --all-depths", 2, "--all-depths", "--camera transient"),
    (f"{RECON} --each-frame", 2, "one whole frame", "scan with --frames"),
    (f"{RECON} --fresh-to 1m", 2, "--fresh-to", "--each-frame"),
    (f"{RECON} --camera transient --frames 0ns:1s:1fs", 2, "1e-15 s", "2ns:20ns:0.2ns"),
    (f"{RECON} --camera transient --video new.xyz", 2, "new.xyz", ".gif or .mp4"),
    (f"{RECON} --camera transient --video nowhere/new.gif", 2, "nowhere", "create it first"),
    (f"{RECON} --calibrations nowhere", 2, "nowhere", "calibration"),
    (f"{RECON} --even-bins", 2, "widths of its bins", "rig calibrate dnl"),
    (f"{RECON} --width 0m", 2, "0 m x 0.3 m", "positive"),
    ("recon small.h5 --voxel 0.01mm", 2, "40000 x 30000 voxels", "would fit"),
    ("recon small.h5 --voxel 0m", 2, "of 0 m voxels", "positive"),
    ("recon small.h5 --depth 0.5m:300m:1mm", 2, "to 300 m", "2.39m"),
    ("recon small.h5 --depth 1m:2m", 2, "'1m:2m'", "--depth 0.5m:3m:2cm"),
    ("recon small.h5 --depth 2m:1m:1cm", 2, "'2m:1m:1cm'", "above 0"),
    ("recon small.h5 --depth 20m:21m:1cm", 2, "133.43 to 140.12 ns", "Choose other depths"),
    (f"{RECON} --out nowhere/v.h5", 2, "nowhere", "create it first"),
    (f"{RECON} --out folder", 2, "folder is a folder", "name of a file"),
    (f"{RECON} --out small.h5 --force", 2, "small.h5 is a scan", "another name"),
    (f"{RECON} --out /proc/v.h5", 2, "/proc", "another folder"),
    (f"{RECON} --out /dev/full --force", 2, "/dev/full", "another name"),
    (f"{RECON} --out pipe.h5 --force", 2, "pipe.h5", "another name"),
    (f"{RECON} --out LONG.h5", 2, LONG, "shorter"),
    (f"{RECON} --image x", 2, "its ending ''", "use .png"),
    (f"{RECON} --image taken.png", 2, "taken.png exists", "--force"),
    (f"{RECON} --image nowhere/x.png", 2, "nowhere", "create it first"),
    (f"{RECON} --image /proc/x.png", 2, "/proc", "another folder"),
    (f"{RECON} --page x", 2, "the page x", ".html"),
    (f"{RECON} --out same.png --image same.png", 2, "same.png is the name of two", "its own"),
    # files that are not what a verb reads
    ("recon nowhere.h5", 5, "nowhere.h5 does not exist", "check the name"),
    ("recon folder", 5, "folder is a folder", "check the name"),
    ("recon pipe.h5", 5, "pipe.h5 is a pipe", "check the name"),
    ("recon loop.h5", 5, "loop.h5 cannot be read", "check the name"),
    ("recon empty.h5", 5, "empty.h5 is empty", "copy it again"),
    ("recon volume.h5", 5, "volume.h5 is a volume", "give the scan"),
    ("recon small.h5 small.h5", 2, "(small.h5)", "rig recon --help"),
    ("resume .", 5, ". is a folder", "check the name"),
    ("resume small.h5", 2, "small.h5 is complete", "nothing to resume"),
    ("resume text.h5", 5, "text.h5 is not an HDF5 file", "copy it again"),
    ("resume small.h5 --config nowhere.toml", 2, "nowhere.toml", "path of a TOML file"),
    ("measure small.h5", 5, "small.h5 is a scan", "rig recon"),
    ("measure volume.h5 --threshold 7", 2, "--threshold: '7'", "1 or less"),
    ("measure volume.h5 --falloff nan", 2, "--falloff: 'nan'", "10 or less"),
    ("measure volume.h5 --truth scene:leters", 2, "'leters'", "letters"),
    ("measure volume.h5 --truth nowhere.ply", 5, "nowhere.ply", "scene:NAME"),
    ("measure volume.h5 --scan folder", 5, "folder is a folder", "check the name"),
    ("stats /", 5, "/ is a folder", "check the name"),
    ("stats", 2, "SCAN.h5... is missing", "rig stats --help"),
    ("stats EMPTY", 2, "its value is empty", "give one"),
    ("stats NEWLINE.h5", 5, "a\nb.h5", "check the name"),
    ("stats small.h5 --from 1e300s", 2, "--from 1e300s", "an earlier time"),
    ("stats small.h5 --from 1", 2, "'1' has no unit", "1ms"),
    ("info folder", 5, "folder is a folder", "rig list folder"),
    ("info /dev/null", 5, "/dev/null is a pipe or a device", "check the name"),
    ("info text.h5", 5, "text.h5", "give one of these"),
    ("list nowhere", 5, "nowhere", "folder with scans"),
    ("list small.h5", 5, "small.h5", "folder with scans"),
    ("list --sheet x", 2, "its ending ''", "use .png"),
    ("list --sheet nowhere/x.png", 2, "nowhere", "create it first"),
    ("report nowhere.h5", 5, "nowhere.h5", "check the name"),
    ("report small.h5 small.h5", 5, "small.h5 is a scan", "rig recon"),
    ("report small.h5 --out folder", 2, "folder is a folder", "name of a file"),
    ("report small.h5 --out nowhere/x.html", 2, "nowhere", "create it first"),
    ("plot small.h5 volume.h5", 2, "volume.h5 is a volume", "each volume alone"),
    ("plot small.h5 --image x", 2, "its ending ''", "use .png"),
    ("plot BYTES", 5, "x\\udcff does not exist", "check the name"),
    ("compare volume.h5", 2, "volume.h5 is a volume", "give the scan"),
    ("compare small.h5 small.h5 --out x.png", 2, "x.png is one sheet", "give a folder"),
    ("compare small.h5 --out /proc/x", 2, "/proc/x", "name another"),
    ("compare empty.h5", 5, "it is empty", "give one of these"),
    # other layouts
    ("import small.h5 new.h5", 5, "small.h5", "rig recon reads it"),
    ("import folder new.h5", 5, "folder is a folder", "check the name"),
    ("import foreign.mat small.h5", 2, "small.h5 exists", "another name"),
    ("import foreign.mat nowhere/new.h5", 2, "nowhere", "create it first"),
    (f"{IMPORT} --bin-width 4", 2, "'4' has no unit", "4ms"),
    (f"{IMPORT} --bounces a", 2, "'a'", "--bounces 2,3"),
    (f"{IMPORT} --detector 1,2,3", 2, "'1,2,3'", "confocal"),
    (f"{IMPORT} --point-marker x", 2, "--point-marker: 'x'", "whole number"),
    ("export small.h5 new.npz", 2, "'.npz'", ".hdf5"),
    ("export volume.h5 new", 2, "new: a volume", ".vti"),
    ("export volume.h5 taken.png", 2, "taken.png exists", "--force"),
    ("export volume.h5 /proc/x.npz", 2, "/proc", "another folder"),
    ("export volume.h5 new.npz --rectified", 2, "--rectified", "Leave it out"),
    ("batch nowhere.toml", 2, "nowhere.toml", ""),
    ("batch small.h5", 2, "small.h5", ""),
    ("recon small.h5 --cluster nowhere:x", 2, "nowhere:x", "local"),
    ("watch nowhere.h5", 5, "nowhere.h5", "check the name"),
    ("watch volume.h5", 5, "volume.h5", ""),
    ("watch small.h5 --web x:y", 2, "x:y", "rig watch --help"),
    # the rig
    ("align --config nowhere.toml", 2, "nowhere.toml", "path of a TOML file"),
    ("config show --config latin.toml", 2, "latin.toml", "UTF-8"),
    ("config bogus", 2, "'bogus'", "rig config --help"),
    ("init --out small.h5", 2, "small.h5 exists", "another name"),
    ("init --bogus", 2, "--bogus", "rig init --help"),
    ("doctor --config types.toml", 2, "scan.columns: 1.5", "whole number"),
    ("doctor --confg x", 2, "--confg", "--config"),
    ("doctor extra", 2, "(extra)", "rig doctor --help"),
    ("calibrate bogus", 2, "'bogus'", "rig calibrate --help"),
    ("calibrate galvo --columns 1", 2, "--columns: '1'", "2 or more"),
    ("calibrate galvo --columns 1000000", 2, "--columns: '1000000'", "200 or less"),
    ("calibrate galvo --method magic", 2, "'magic'", "'flight'"),
    ("calibrate galvo --from nowhere.h5", 5, "nowhere.h5", "check the name"),
    ("calibrate dark --exposure 0s", 2, "--exposure 0s", "10ms"),
    ("calibrate dark --hold-offs 90ns,,1", 2, "--hold-offs", "10ms"),
    ("calibrate dark --repetition 0Hz", 2, "--repetition 0Hz", "10MHz"),
    ("calibrate dark --from small.h5", 5, "small.h5", "files of this program"),
    ("calibrate gate --step 0ps", 2, "--step 0ps", "10ms"),
    ("calibrate gate --nearest 0cm", 2, "--nearest 0cm", "4cm"),
    ("calibrate dnl --exposure=-1s", 2, "--exposure -1s", "10ms"),
    ("calibrate time-zero --target=-1m", 2, "--target -1m", "10cm,-5cm,1m"),
    ("calibrate lag --point 0ms", 2, "--point 0ms", "10ms"),
    ("calibrate irf --keep small.h5", 2, "--keep small.h5", "name another"),
    ("calibrate all --config folder", 2, "folder", "path of a TOML file"),
    ("calibrate show --config latin.toml", 2, "latin.toml", "UTF-8"),
    ("devices bogus", 2, "'bogus'", "rig devices --help"),
    ("devices probe --out small.h5", 2, "small.h5 is not a folder", "another --out"),
    ("devices probe --config nowhere.toml", 2, "nowhere.toml", "path of a TOML file"),
    ("laser off --config nowhere.toml", 2, "nowhere.toml", "path of a TOML file"),
    ("laser status extra", 2, "(extra)", "rig laser status --help"),
    ("laser acknowledge", 2, "no option --json", "rig laser acknowledge --help"),
    ("sim render leters new.h5", 2, "'leters'", "letters"),
    ("sim render point small.h5", 2, "small.h5 exists", "another name"),
    ("sim render point nowhere/new.h5", 2, "nowhere", "create it first"),
    ("sim render point new.h5 --bin-width 1e-300s", 2, "--bin-width 1e-300s", "4ps"),
    ("sim render point new.h5 --bins 99999999999", 2, "--bins: '99999999999'", "or less"),
    ("sim render point new.h5 --roughness nan", 2, "--roughness: 'nan'", "1 or less"),
    ("sim render point new.h5 --bounces 7", 2, "--bounces: '7'", "5 or less"),
    ("sim serve --write-config small.h5", 2, "small.h5 exists", "another --write-config"),
    ("sim serve --log nowhere/x.log", 2, "nowhere/x.log", "another --log"),
    # the program itself
    ("bogus", 2, "'bogus'", "rig --help"),
    ("scann", 2, "'scann'", "'scan'"),
    ("--bogus", 2, "--bogus", "rig --help"),
    ("version --log small.h5", 2, "--log small.h5", "another name"),
    ("version --log folder", 2, "--log folder is a folder", "name of a file"),
    ("version --log pipe.h5", 2, "--log pipe.h5", "another name"),
    ("version --log nowhere/x", 2, "--log nowhere/x", "folder that exists"),
    ("version --log /dev/full", 2, "--log /dev/full", "give a file"),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Make a folder with all that a wrong name may mean."""
    folder = tmp_path_factory.mktemp("wrong")
    x, y = np.meshgrid(np.arange(4) * 0.1, np.arange(3) * 0.1)
    laser_m = np.stack([x.ravel(), y.ravel(), np.zeros(12)], axis=1)
    with ScanWriter.create(
        folder / "small.h5", ScanDescription(laser_m, np.zeros((1, 3)), 1000, 16e-12, 0.0)
    ) as writer:
        for step in range(12):
            writer.append(np.full(1000, step, np.uint32))
    axis = np.linspace(-0.1, 0.1, 5)
    write_volume(
        folder / "volume.h5", Volume(np.ones((3, 5, 5), np.float32), axis, axis, np.array([0.5, 0.6, 0.7]))
    )
    (folder / "folder").mkdir()
    (folder / "empty.h5").touch()
    (folder / "text.h5").write_text("no measurement\n")
    (folder / "taken.png").write_bytes(b"a picture")
    os.mkfifo(folder / "pipe.h5")
    (folder / "loop.h5").symlink_to("loop.h5")
    (folder / "foreign.mat").write_bytes(b"MATLAB")
    (folder / "latin.toml").write_bytes(b"[notes]\nsample = '\xe4'\n")
    (folder / "nan.toml").write_text("[scan]\nexposure = nan\n")
    (folder / "number.toml").write_text("[scan]\nexposure = 10\n")
    (folder / "types.toml").write_text("[simulation]\nseed = 'abc'\n[scan]\ncolumns = 1.5\n")
    (folder / "unknown.toml").write_text("[scan]\nexposre = '1ms'\n")
    (folder / "cut.toml").write_text("[scan\n")
    (folder / "real.toml").write_bytes(b"\xef\xbb\xbf[scan]\r\nexposure = '10ms'\r\n")  # as Notepad writes it
    return folder


def words(line):
    """Return the words of a command line of the table."""
    found = shlex.split(line)
    for name, text in NAMES.items():
        found = [word.replace(name, text) for word in found]
    return found


def state(folder):
    """Return what is in a folder."""
    return {str(path): path.lstat().st_mtime_ns for path in folder.rglob("*")}


def too_late(number, frame):
    """End what has not ended: nothing in the program may take this for a failure of its own."""
    raise KeyboardInterrupt


@pytest.fixture
def refused(folder, capsys, monkeypatch):
    """Run a command line in that folder, where nothing may change; return exit code, stdout and stderr."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv("COLUMNS", "200")

    def run(arguments):
        monkeypatch.setattr(sys, "argv", ["rig", *arguments])
        before, on_ctrl_c = state(folder), signal.getsignal(signal.SIGINT)
        on_alarm = signal.signal(signal.SIGALRM, too_late)
        signal.setitimer(signal.ITIMER_REAL, BOUND_S)
        try:
            with pytest.raises(SystemExit) as ended:
                main()
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, on_alarm)
            signal.signal(signal.SIGINT, on_ctrl_c)
        assert state(folder) == before
        streams = capsys.readouterr()
        return ended.value.code, streams.out, streams.err

    return run


@pytest.mark.parametrize(("line", "code", "thing", "remedy"), CASES, ids=[f"{n}" for n in range(len(CASES))])
def test_wrong_input_is_refused_in_words_and_as_a_document(refused, line, code, thing, remedy):
    came, out, err = refused([*words(line), "--json"])
    assert "Traceback" not in err
    assert came == code, err
    message = err[err.rindex("rig: ") + 5 :]
    assert thing in message, message
    assert remedy in message, message
    assert "Input should" not in err
    assert "Errno" not in err
    document = json.loads(out)  # exactly one, or this fails
    assert document["schema_version"] == 1
    assert document["exit_code"] == code
    assert thing.replace("x\\udcff", os.fsdecode(b"x\xff")) in document["error"]


def test_all_verbs_are_in_the_table():
    from typer.main import get_command

    from attacks.options import verbs
    from rig.commands import app

    lines = [line for line, *_ in CASES]
    named = {name for name, _ in verbs(get_command(app))}
    assert {verb for verb in named if not any(line.startswith(verb) for line in lines)} == set()
    assert len(CASES) >= 150


@pytest.mark.parametrize(
    "line",
    [
        f"{DRY} --config pipe.h5",
        "stats BYTES",
        "version --log pipe.h5",
    ],
)
def test_a_process_of_its_own_refuses_alike(folder, line):
    done = subprocess.run(
        [sys.executable, "-m", "rig", *words(line), "--json"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        timeout=BOUND_S,
        check=False,
    )
    assert done.returncode in {2, 5}
    assert b"Traceback" not in done.stderr
    assert done.stderr.count(b"rig: ") == 1
    assert json.loads(done.stdout)["exit_code"] == done.returncode


@pytest.mark.parametrize("line", ["", "sim", "calibrate", "laser", "devices"])
def test_a_verb_that_is_missing_is_asked_for_after_the_help(refused, line):
    code, out, err = refused(words(line))
    assert code == 2
    assert "Usage: rig" in out
    assert "it needs a verb" in err
