"""Images on the workers of a cluster: the numbers of one process, whatever happens to a worker."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

pytest.importorskip("distributed", reason="dask is not installed")

from recon import parts
from rig.cluster.batch import run
from rig.cluster.imaging import Crew
from rig.cluster.jobs import read_jobs
from rig.cluster.joined import joined, local_workers
from rig.errors import UsageError
from rig.image.drawing import Drawing
from rig.image.reconstruct import reconstruct
from rig.image.request import Request
from support.point_scans import write_point_scan

REQUEST = Request(wavelength_m=0.08, depth_m=(0.5, 0.9, 0.02))
#: Sums in another order: 1e-7 for each of a few dozen frequencies and FFT stages.
ROUNDING = 1e-5


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("cluster")


@pytest.fixture(scope="module")
def scan(folder):
    return write_point_scan(folder / "point.h5")


@pytest.fixture(scope="module")
def alone(scan, folder):
    """The volume, as this process makes it."""
    return reconstruct(scan, REQUEST, folder / "alone.h5", Drawing(folder / "alone.png")).volume


@pytest.fixture(scope="module")
def client(alone):  # which looks the scan through before threads run
    with joined("local:2") as client:
        yield client


@pytest.fixture(autouse=True)
def many_parts(monkeypatch):
    monkeypatch.setattr(parts, "LEAST_WORK_S", 0.0)


def assert_same(volume, alone):
    assert np.abs(volume.intensity - alone.intensity).max() < ROUNDING * alone.intensity.max()
    np.testing.assert_allclose(volume.depth_m, alone.depth_m, atol=1e-4)
    # noise is summed up in another order
    np.testing.assert_allclose(volume.confidence, alone.confidence, atol=1e-3)


def test_same_numbers_as_on_one_machine(client, scan, alone, tmp_path):
    told = []
    crew = Crew(client)
    volume = reconstruct(
        scan, REQUEST, tmp_path / "v.h5", Drawing(tmp_path / "v.png"), told.append, elsewhere=crew
    ).volume
    assert_same(volume, alone)
    with h5py.File(tmp_path / "v.h5") as file:
        assert np.array_equal(file["volume/intensity"], volume.intensity)
    assert len(told) > 4
    assert told == sorted(told)
    assert told[-1] == pytest.approx(1)


@pytest.mark.parametrize("files", [True, False], ids=["workers read the file", "spectra are sent"])
def test_a_worker_that_is_killed_changes_nothing(client, scan, alone, tmp_path, files):
    pids = set(client.run(os.getpid).values())
    killed = []

    def kill(fraction):
        if not killed:
            killed.append(min(pids))
            os.kill(killed[0], signal.SIGKILL)

    crew = Crew(client, files=files)
    volume = reconstruct(
        scan, REQUEST, tmp_path / "k.h5", Drawing(tmp_path / "k.png"), kill, elsewhere=crew
    ).volume
    assert killed
    assert_same(volume, alone)
    client.wait_for_workers(2)
    assert killed[0] not in client.run(os.getpid).values()


def test_every_laser_with_every_pixel_and_a_worker_that_is_killed(client, rig, tmp_path):
    """The fields of runs of lasers add up, wherever they were computed."""
    small = [
        "--lasers",
        "4x4",
        "--pixels",
        "16x16",
        "--spacing",
        "5cm",
        "--bin-width",
        "32ps",
        "--bins",
        "400",
    ]
    assert rig("sim", "render", "point", "all.h5", *small).code == 0
    # planes of so many voxels, at so few frequencies, are imaged by FFT; tables are right to 1e-4 only
    request = Request(wavelength_m=0.4, depth_m=(0.8, 1.2, 0.2))
    here = reconstruct(tmp_path / "all.h5", request, tmp_path / "h.h5", Drawing(tmp_path / "h.png")).volume
    killed = []

    def kill(fraction):
        if not killed:
            killed.append(min(client.run(os.getpid).values()))
            os.kill(killed[0], signal.SIGKILL)

    there = reconstruct(
        tmp_path / "all.h5",
        request,
        tmp_path / "t.h5",
        Drawing(tmp_path / "t.png"),
        kill,
        elsewhere=Crew(client),
    ).volume
    assert killed
    assert np.abs(there.intensity - here.intensity).max() < ROUNDING * here.intensity.max()


def test_what_is_stopped_leaves_no_file(client, scan, folder):
    def stop(fraction):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        reconstruct(scan, REQUEST, folder / "s.h5", Drawing(folder / "s.png"), stop, elsewhere=Crew(client))
    assert not list(folder.glob("*s.*"))


def test_workers_of_little_memory_are_refused_before_the_work(client, scan, folder):
    from recon.errors import MemoryBoundError

    with pytest.raises(MemoryBoundError, match="Give each worker"):
        reconstruct(scan, REQUEST, folder / "m.h5", Drawing(folder / "m.png"), elsewhere=Crew(client, 10**7))


def test_a_batch_on_workers_and_a_worker_that_is_killed(client, scan, tmp_path):
    text = f"""
[[job]]
scans = ["{scan}"]
wavelength = ["8cm", "9cm", "10cm"]
depth = "0.5m:0.9m:10cm"
"""
    (tmp_path / "jobs.toml").write_text(text)
    jobs = read_jobs(tmp_path / "jobs.toml")
    outcomes = []
    for outcome in run(jobs, tmp_path / "out", client, ("rig", "batch", "jobs.toml")):
        if not outcomes:
            os.kill(min(client.run(os.getpid).values()), signal.SIGKILL)
        outcomes.append(outcome)
    assert sorted((one.name, one.status) for one in outcomes) == sorted((job.name, "done") for job in jobs)
    assert [one.status for one in run(jobs, tmp_path / "out", client)] == ["kept"] * 3
    with h5py.File(jobs[0].files(tmp_path / "out")[0]) as file:
        assert file.attrs["command"] == "rig batch jobs.toml"
    assert len(list((tmp_path / "out").iterdir())) == 2 * 3 + 1  # volumes, pictures and the record


@pytest.mark.skipif(not Path("/proc").exists(), reason="looks for processes in /proc")
def test_ctrl_c_leaves_no_process_and_no_file(scan, folder):
    command = [sys.executable, "-m", "rig", "recon", scan, "--cluster", "local:1", "--voxel", "5mm"]
    command += ["--depth", "0.5m:0.9m:1mm", "--out", folder / "c.h5", "--image", folder / "c.png"]
    running = subprocess.Popen(
        list(map(str, command)), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, process_group=0
    )
    deadline_s = time.monotonic() + 60
    while not (workers := [pid for pid in children(running.pid) if "spawn_main" in words(pid)]):
        assert time.monotonic() < deadline_s
        assert running.poll() is None, running.communicate()
        time.sleep(0.1)
    time.sleep(1.0)
    os.killpg(running.pid, signal.SIGINT)  # as a terminal does: all of them get it
    out, err = running.communicate(timeout=60)
    assert running.returncode == 130, err
    assert "Traceback" not in err
    assert "stopped by Ctrl-C" in err
    assert out == ""
    assert not list(folder.glob("*c.*"))
    assert not any("spawn_main" in words(pid) for pid in workers)


def children(parent):
    """Return the processes that a process started."""
    found = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            number, after = status.parent.name, status.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(after[1]) == parent:
            found += [int(number)]
    return found


def words(pid):
    try:
        return Path(f"/proc/{pid}/cmdline").read_text()
    except OSError:
        return ""


@pytest.mark.parametrize("address", ["local:0", "local:9999", "somewhere", "http://host", "local:x"])
def test_what_names_no_cluster_is_refused(rig, address):
    done = rig("recon", "scan.h5", "--cluster", address)
    assert done.code == 2
    assert "--cluster" in done.err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--solver", "lct"), "solver lct computes only whole images"),
        (("--camera", "transient"), "a film is computed on one computer"),
        (("--each-frame",), "a film is computed on one computer"),
    ],
)
def test_what_is_not_cut_is_refused(rig, options, said):
    done = rig("recon", "scan.h5", "--cluster", "local:2", *options)
    assert done.code == 2
    assert said in done.err


def test_certificates_that_an_address_does_not_need_are_not_read(client):
    import dask

    missing = {f"distributed.comm.tls.{name}": "missing.pem" for name in ("ca-file", "client.cert")}
    with dask.config.set(missing):
        with joined(client.scheduler.address) as another:
            assert another.nthreads()  # of one worker at least: another test may have killed one
        with pytest.raises(UsageError, match="certificates cannot be used"), joined("tls://127.0.0.1:9"):
            pass


def test_an_address_without_a_scheduler_is_said(tmp_path):
    assert local_workers("tcp://127.0.0.1:9") is None
    with pytest.raises(UsageError, match="cannot be read"), joined("missing.json"):
        pass
    with (
        pytest.raises(UsageError, match=r"certificates.*distributed\.comm\.tls"),
        joined("tls://127.0.0.1:9"),
    ):
        pass
    for number, text in enumerate(
        ["", "[" * 100_000, "[1]", "{}", '{"address": 7}', '{"address": "file:///etc/passwd"}']
    ):
        path = tmp_path / f"{number}.json"
        path.write_text(text)
        with pytest.raises(UsageError, match="has no scheduler's address"), joined(str(path)):
            pass
