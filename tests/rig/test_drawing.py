"""The picture is the same, whoever draws it, and no process is left that drew it."""

import json
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere it is drawn by one process")

#: Draws one volume in several ways; prints which files are like the first, and whether a process was there.
PROGRAM = """
import json, os, threading, warnings
from contextlib import nullcontext
from multiprocessing import active_children
from pathlib import Path
import numpy as np
import rig.image.drawing as drawing
from rig.files.volume import Volume
warnings.simplefilter("error")
axis = np.linspace(-0.5, 0.5, 9)
intensity = np.random.default_rng(1).random((5, 9, 9), np.float32)
volume = Volume(intensity, axis, axis, np.linspace(1, 2, 5), intensity[0], intensity[1], scan="a.h5")

def drawn(name, way, disturb):
    picture = drawing.Drawing(Path(name))
    with way(picture):
        beside = picture.beside
        disturb(picture)
        picture.begin(volume)
        picture.save(volume)
    try:
        left = os.waitpid(-1, os.WNOHANG)
    except ChildProcessError:
        left = None
    return Path(name).read_bytes(), beside, left

def killed(picture):
    active_children()[0].kill()

here = drawn("here.png", nullcontext, lambda picture: None)
say = {"beside": drawn("beside.png", lambda one: one, lambda picture: None)}
say["killed"] = drawn("killed.png", lambda one: one, killed)
drawing.MOST_BYTES = 100
say["large"] = drawn("large.png", lambda one: one, lambda picture: None)
drawing.MOST_BYTES = 10**9
stop = threading.Event()
thread = threading.Thread(target=stop.wait)
thread.start()
say["thread"] = drawn("thread.png", lambda one: one, lambda picture: None)
stop.set()
thread.join()
drawing.WAIT_S = 0.0  # it is never ready in time
say["late"] = drawn("late.png", lambda one: one, lambda picture: None)
print(json.dumps({name: [found[0] == here[0], *found[1:]] for name, found in say.items()}))
"""


def test_it_is_the_same_picture_whoever_draws_it(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads(done.stdout) == {
        "beside": [True, True, None],
        "killed": [True, True, None],
        "large": [True, True, None],
        "thread": [True, False, None],
        "late": [True, True, None],
    }
    assert len(list(tmp_path.iterdir())) == 6


def test_what_goes_wrong_is_said_once_and_leaves_no_process(tmp_path):
    program = PROGRAM[: PROGRAM.index("def drawn")] + (
        "with drawing.Drawing(Path('nowhere/a.png')) as picture:\n"
        "    picture.begin(volume)\n"
        "    try:\n"
        "        picture.save(volume)\n"
        "    except Exception as error:\n"
        "        print(error)\n"
        "try:\n"
        "    with drawing.Drawing(Path('b.png')) as picture:\n"
        "        raise KeyboardInterrupt\n"
        "except KeyboardInterrupt:\n"
        "    pass\n"
        "try:\n"
        "    os.waitpid(-1, os.WNOHANG)\n"
        "except ChildProcessError:\n"
        "    print('none left')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines() == [
        "cannot write nowhere/a.png: the folder nowhere does not exist; create it first",
        "none left",
    ]
