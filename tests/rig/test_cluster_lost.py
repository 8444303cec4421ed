"""A cluster that nobody computes on any more: it is said, in place of waiting for ever."""

import os
import signal
import subprocess
import sys
import time

import pytest

pytest.importorskip("distributed", reason="dask is not installed")

from dask import config as dask_config
from distributed import Client

from rig.cluster import awaited as waiting
from rig.cluster import joined as joining
from rig.cluster.awaited import GONE, as_done, awaited
from rig.cluster.joined import joined
from rig.errors import RefusedError

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="a process is stopped by a POSIX signal")


@pytest.fixture
def soon(monkeypatch):
    """A cluster may be without anybody for a second."""
    monkeypatch.setattr(waiting, "LOOK_S", 0.2)
    monkeypatch.setattr(waiting, "LONGEST_S", 1.0)


@pytest.fixture
def dask(tmp_path):
    """A function that starts a process of dask's, which ends with the test."""
    started = []

    def start(*words):
        place = ["--no-dashboard", "--scheduler-file", str(tmp_path / "scheduler.json")]
        process = subprocess.Popen(
            [sys.executable, "-m", "dask", *words, *place],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.wait()


@pytest.fixture
def scheduler(dask, tmp_path):
    process = dask("scheduler", "--host", "127.0.0.1", "--port", "0")
    deadline_s = time.monotonic() + 60
    while not (tmp_path / "scheduler.json").exists():
        assert process.poll() is None
        assert time.monotonic() < deadline_s
        time.sleep(0.05)
    return process


def test_without_workers_or_a_scheduler_nothing_is_awaited(soon, scheduler, tmp_path):
    """No worker ever comes here; then the scheduler stands still, goes on, and is killed."""
    with Client(scheduler_file=str(tmp_path / "scheduler.json"), timeout=5, set_as_default=False) as client:
        future = client.submit(os.getpid)
        with pytest.raises(RefusedError, match="has had no worker for 1 s; start some: dask worker"):
            awaited(future)
        scheduler.send_signal(signal.SIGSTOP)
        with pytest.raises(RefusedError, match="has a scheduler that did not answer for 1 s"):
            next(as_done([future], client))
        scheduler.send_signal(signal.SIGCONT)
        with pytest.raises(RefusedError, match="has had no worker"):
            awaited(future)
        scheduler.kill()
        with pytest.raises(RefusedError, match=GONE):
            awaited(future)


def test_what_is_sent_to_a_cluster_that_is_gone_is_no_defect(scheduler, dask, tmp_path, monkeypatch):
    """Dask closes the connection for good when nobody answers for a while."""
    monkeypatch.setattr(joining, "PATIENCE_S", 1)
    address = str(tmp_path / "scheduler.json")
    dask("worker", "--no-nanny")
    with Client(scheduler_file=address, set_as_default=False) as first:
        first.wait_for_workers(1, timeout=60)

    def lose_the_scheduler():
        with joined(address) as client:
            future = client.submit(time.sleep, 600)
            scheduler.kill()
            deadline_s = time.monotonic() + 60
            while client.status != "closed":
                assert time.monotonic() < deadline_s
                time.sleep(0.05)
            future.cancel()

    with pytest.raises(RefusedError, match=GONE):
        lose_the_scheduler()


def test_where_no_workers_can_be_started_it_is_said():
    with (
        dask_config.set({"temporary-directory": "/dev/null/nowhere"}),
        pytest.raises(RefusedError, match="no workers can be started here"),
        joined("local:1"),
    ):
        pass
