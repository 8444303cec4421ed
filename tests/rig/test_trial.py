"""Trials of unknown files, in a copy of this program or of its helper: what breaks ends with one message."""

import os
import shutil
import signal
import subprocess
import sys
import threading
import time
import uuid
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import pytest

from attacks.files import volume_file
from rig.errors import DataFileError
from rig.files import trial_helper
from rig.files.trial import tried
from rig.files.trial_child import WAIT_S, Outcome, Trial, _read_all, spawned
from support import tried as doing

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are looked for in /proc")

PROJECT = Path(__file__).parents[2]
#: A program without the usual guard, beside a thread, which opens files; it would print its line twice if a
#: process that helps it ran it again.
PROGRAM = """
import threading
OPENER
threading.Thread(target=threading.Event().wait, daemon=True).start()
print("begun", open("good.h5").depth_m.shape, open("same.h5").depth_m.shape)
"""
QUICK, WHOLE = "from rig.files import read_volume as open", "from rig import open"


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "a.h5"
    path.write_bytes(b"four")
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    shutil.copy(volume_file(folder), folder / "same.h5")
    return folder


@pytest.fixture
def beside():
    """A thread that waits, beside which no copy of this process is safe."""
    stop = threading.Event()
    thread = threading.Thread(target=stop.wait)
    thread.start()
    yield
    stop.set()
    thread.join()


def of_mark(mark):
    """Return the processes that were started by a program with this mark in its environment."""
    found = []
    for one in Path("/proc").iterdir():
        with suppress(OSError):
            if one.name.isdigit() and mark.encode() in (one / "environ").read_bytes():
                found.append(int(one.name))
    return found


def wait_for(happened, limit_s=30.0):
    deadline_s = time.monotonic() + limit_s
    while not happened() and time.monotonic() < deadline_s:
        time.sleep(0.02)
    return happened()


def marked(**more):
    mark = f"RIG_TEST_MARK={uuid.uuid4()}"
    name, value = mark.split("=")
    paths = os.pathsep.join([str(PROJECT), str(PROJECT / "tests")])
    return mark, os.environ | {name: value, "PYTHONPATH": paths} | more


@pytest.mark.parametrize("threads", [False, True], ids=["alone", "beside a thread"])
def test_what_breaks_is_refused_and_the_next_file_is_read(path, threads, request):
    if threads:
        request.getfixturevalue("beside")
    for function, said in ((doing.die, "crashed"), (doing.swallow, "memory"), (doing.nest, "crashed")):
        with pytest.raises(DataFileError, match=said):
            tried(path, function)
    assert tried(path, doing.size) == 4


def test_a_file_that_stays_holds_up_no_other_and_ends_in_time(path, beside, tmp_path):
    with ThreadPoolExecutor(4) as threads:
        began_s = time.monotonic()
        staying = threads.submit(tried, path, doing.stay)
        others = [tmp_path / f"{number}.h5" for number in range(12)]
        for number, other in enumerate(others):
            other.write_bytes(b"x" * number)
        assert list(threads.map(lambda other: tried(other, doing.size), others)) == list(range(12))
        assert time.monotonic() - began_s < WAIT_S
        with pytest.raises(DataFileError, match="did not end"):
            staying.result()
    assert not Path(f"/proc/{path.read_text()}").exists()


def test_a_computer_that_stood_still_is_not_taken_for_a_file_without_end():
    """Hours pass between two looks, of which the child had nothing; its answer is waited for."""
    reading, writing = os.pipe()
    hours = iter([0.0, *(3600.0 * number for number in range(1, 100))])

    def clock():
        now_s = next(hours)
        if now_s == 3600.0 * 3:
            os.write(writing, b"an answer")
            os.close(writing)
        return now_s

    assert _read_all(reading, WAIT_S, None, clock) == b"an answer"
    os.close(reading)


def test_an_answer_that_does_not_come_is_not_waited_for():
    reading, writing = os.pipe()
    looks = iter(range(10**6))
    assert _read_all(reading, 0.5, None, lambda: 0.1 * next(looks)) is None
    assert next(looks) < 10
    os.close(reading)
    os.close(writing)


def test_a_file_reaches_nobody_but_the_process_that_asks_about_it(path, beside):
    assert tried(path, doing.connections) == 0


def test_a_folder_that_changes_is_followed(path, beside, monkeypatch, tmp_path):
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "a.h5").write_bytes(b"x" * 7)
    for folder, size in ((tmp_path, 4), (tmp_path / "other", 7)):
        monkeypatch.chdir(folder)
        assert tried(Path("a.h5"), doing.size) == size


def test_a_helper_that_somebody_ended_is_started_again(path, beside):
    assert tried(path, doing.size) == 4
    os.kill(trial_helper._helper._process.pid, signal.SIGKILL)
    assert tried(path, doing.size) == 4


@pytest.mark.parametrize("way", ["script", "-c", "input"])
def test_no_program_is_run_twice_and_none_is_left(folder, way):
    program = PROGRAM.replace("OPENER", WHOLE if way == "script" else QUICK)
    (folder / "program.py").write_text(program)
    mark, environment = marked()
    arguments = {"script": ["program.py"], "-c": ["-c", program], "input": ["-i", "-q"]}[way]
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=environment,
        input=program if way == "input" else None,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == "begun (7, 9) (7, 9)\n"
    assert wait_for(lambda: not of_mark(mark), 5.0)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT], ids=["killed", "Ctrl-C"])
def test_a_program_that_ends_meanwhile_leaves_no_process(path, how):
    mark, environment = marked()
    program = (
        "import threading, support.tried, pathlib; from rig.files.trial import tried\n"
        "threading.Thread(target=threading.Event().wait, daemon=True).start()\n"
        f"tried(pathlib.Path({str(path)!r}), support.tried.stay)\n"
    )
    asking = subprocess.Popen(
        [sys.executable, "-c", program], env=environment, stderr=subprocess.DEVNULL, start_new_session=True
    )
    assert wait_for(lambda: path.read_text().isdigit())
    os.killpg(asking.pid, how)  # as a terminal does it
    asking.wait(10)
    assert wait_for(lambda: not of_mark(mark), 4.0), "well before the trial's own limit"


def test_a_new_process_answers_where_none_can_be_copied(path):
    outcome = spawned(Trial(doing.size, [str(path)], 4))
    assert outcome == Outcome(b'{"result": 4}', 0)
