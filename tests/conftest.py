"""The command line as a person meets it: arguments in, exit code and both streams out."""

import os
import signal
import subprocess
import sys
import tempfile
from dataclasses import dataclass

import hypothesis
import pytest

# before numpy is there: workers use all cores, so that threads of one that wait for each other only take time
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
# what tests start shares compiled modules: without, each of a few hundred programs compiles 300 files
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

from rig.__main__ import main

# generated input is the same in every run, and a busy machine is no failure
hypothesis.settings.register_profile("rig", derandomize=True, deadline=None)
hypothesis.settings.load_profile("rig")


@pytest.fixture(autouse=True, scope="session")
def own_state(tmp_path_factory):
    """Keep what is remembered of rigs apart from what this computer remembers of real ones."""
    os.environ.pop("RIG_CONFIG", None)
    os.environ["RIG_STATE"] = str(tmp_path_factory.mktemp("state"))


@dataclass(frozen=True)
class Finished:
    """How a command ended."""

    code: int
    out: str
    err: str


@pytest.fixture
def rig(capsys, monkeypatch, tmp_path):
    """Run ``rig ARGUMENTS`` in an empty folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")

    def run(*arguments) -> Finished:
        monkeypatch.setattr(sys, "argv", ["rig", *map(str, arguments)])
        code, on_ctrl_c = 0, signal.getsignal(signal.SIGINT)
        try:
            main()
        except SystemExit as ended:
            code = ended.code or 0
        finally:
            signal.signal(signal.SIGINT, on_ctrl_c)
        streams = capsys.readouterr()
        return Finished(code, streams.out, streams.err)

    return run


#: The process that compiles, in the session, and where it does.
COMPILING = pytest.StashKey[tuple[subprocess.Popen, tempfile.TemporaryDirectory]]()


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile while workers collect tests, which takes them half a minute."""
    options = session.config.option
    if getattr(options, "tx", None) and not options.collectonly:  # in the process that has workers
        command = [sys.executable, "-m", "support.compiled"]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
        nowhere, folder = subprocess.DEVNULL, tempfile.TemporaryDirectory()
        process = subprocess.Popen(command, cwd=folder.name, env=environment, stdout=nowhere, stderr=nowhere)
        session.stash[COMPILING] = process, folder


def pytest_sessionfinish(session: pytest.Session) -> None:
    """End what compiles, if it is not over."""
    if compiling := session.stash.get(COMPILING, None):
        process, folder = compiling
        process.kill()
        process.wait()
        folder.cleanup()


#: Files that take a minute or more begin first, so that at the end no worker is left with one of them alone.
LONG = (
    "test_hidden_scene",
    "test_compare_command",
    "test_scan_file_interrupted",
    "test_two_programs",
    "test_light_goes_out",
    "test_guard_process",
    "test_sim_serve",
    "test_code",
    "test_release",
    "test_depth_read_in_time",
    "test_faults_f01_to_f19",
    "test_scan_told",
    "test_lasers",
    "test_by_hand_served",
    "test_scan_command",
    "test_interrupt",
    "test_files",
    "test_scan_file_damage",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the long files; the others stay in order."""
    turns = {name: turn for turn, name in enumerate(LONG)}
    items.sort(key=lambda item: turns.get(item.path.stem, len(turns)))


def pytest_xdist_auto_num_workers() -> int:
    """Two workers a core: a worker waits half of its time, for clocks, disks and other processes."""
    return 2 * (os.cpu_count() or 1)
