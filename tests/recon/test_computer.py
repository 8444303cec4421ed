"""Cores and memory are those that this process may use: of its affinity, and of its control groups."""

import os
import subprocess
import sys
from math import inf

import pytest

from recon.computer import cores, group_bytes, group_cores, memory_bytes, usual_threads


@pytest.fixture
def groups(tmp_path):
    """Return a function that makes control groups: the process's list, and files with what they say."""

    def made(listed, **files):
        (tmp_path / "cgroup").write_text(listed)
        for name, said in files.items():
            path = tmp_path / "mounted" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(said)
        return tmp_path / "cgroup", tmp_path / "mounted"

    return made


def test_it_is_a_part_of_the_computer():
    assert 1 <= cores() <= os.cpu_count()
    assert 1e8 < memory_bytes() < 1e14


def test_cores_that_are_not_allowed_do_not_count():
    if not hasattr(os, "sched_setaffinity"):
        pytest.skip("this system binds no process to cores")
    script = (
        "import os; os.sched_setaffinity(0, [min(os.sched_getaffinity(0))]);"
        "from recon.computer import cores, usual_threads;"
        "print(cores(), usual_threads())"
    )
    environment = {key: value for key, value in os.environ.items() if key != "OMP_NUM_THREADS"}
    environment["PYTHONPATH"] = os.pathsep.join(sys.path)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, env=environment
    )
    assert done.stdout.split() == ["1", "1"]


def test_the_narrowest_group_of_version_2_counts(groups):
    where = groups(
        "0::/slurm/job/step\n",
        **{
            "slurm/memory.max": "max\n",
            "slurm/job/memory.max": "8589934592\n",
            "slurm/job/step/memory.max": "17179869184\n",
            "slurm/cpu.max": "250000 100000\n",
            "slurm/job/step/cpu.max": "max 100000\n",
        },
    )
    assert group_bytes(*where) == 2**33
    assert group_cores(*where) == 2.5


def test_version_1_has_a_tree_for_each_controller(groups):
    where = groups(
        "9:name=systemd:/\n4:memory:/job\n3:cpuset:/\n1:cpu,cpuacct:/job\n0::/\n",
        **{
            "memory/memory.limit_in_bytes": "9223372036854771712\n",
            "memory/job/memory.limit_in_bytes": "4294967296\n",
            "cpu/job/cpu.cfs_quota_us": "150000\n",
            "cpu/job/cpu.cfs_period_us": "100000\n",
            "cpu/cpu.cfs_quota_us": "-1\n",
            "cpu/cpu.cfs_period_us": "100000\n",
        },
    )
    assert group_bytes(*where) == 2**32
    assert group_cores(*where) == 1.5


@pytest.mark.parametrize("listed", ["", "0::/\n", "no group\n", "0::/../outside\n", "\n:::\n"])
def test_where_nothing_is_said_nothing_is_bounded(groups, listed):
    where = groups(listed, **{"memory.max": "max\n", "cpu.max": "nonsense\n"})
    assert (group_bytes(*where), group_cores(*where)) == (inf, inf)
    missing = where[1] / "missing"
    assert (group_bytes(missing, missing), group_cores(missing, missing)) == (inf, inf)


@pytest.mark.parametrize(
    ("asked", "threads"),
    [("3", 3), ("3,2", 3), (" 3 , 2", 3), ("0", None), ("-1", None), ("all", None), ("", None), (",2", None)],
)
def test_threads_are_those_that_are_asked_for(asked, threads, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", asked)
    assert usual_threads() == (threads or cores())
