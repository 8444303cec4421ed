"""An installed package brings a kind of device; the example is the one of the documentation."""

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from rig.files import ScanFile

PAGE = Path(__file__).parents[2] / "docs/plug-ins.md"
CONFIG = '[laser]\nkind = "acme"\naddress = "/dev/acme"\n[simulation]\n[scan]\nskip = "0cm"\n'


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE.read_text(), re.DOTALL)


def install(source: str, target: Path) -> Path:
    """Leave what pip leaves of a package: its module, and a folder that names its entry points."""
    project = tomllib.loads(blocks("toml")[0])["project"]
    about = target / f"rig_acme-{project['version']}.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text(f"Name: {project['name']}\nVersion: {project['version']}\n")
    points = project["entry-points"]["rig.devices"].items()
    (about / "entry_points.txt").write_text(
        "\n".join(["[rig.devices]", *(f"{name} = {place}" for name, place in points)])
    )
    (target / "rig_acme.py").write_text(source)
    return target


@pytest.fixture(scope="module")
def target(tmp_path_factory) -> Path:
    """Where the package of the documentation is installed."""
    return install(blocks("python")[0], tmp_path_factory.mktemp("installed"))


@pytest.fixture
def rig_with(tmp_path):
    def run(installed: Path, config: str, *arguments):
        (tmp_path / "rig.toml").write_text(config)
        paths = [str(installed), str(PAGE.parents[1])]
        return subprocess.run(
            [sys.executable, "-m", "rig", *arguments, "--config", "rig.toml"],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths), "COLUMNS": "200"},
            capture_output=True,
            text=True,
        )

    return run


def test_the_laser_of_a_package_lights_a_scan(target, rig_with, tmp_path):
    done = rig_with(target, CONFIG, "scan", "--grid", "4x3", "--out", "a.h5", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["photons"] > 1000
    with ScanFile(tmp_path / "a.h5") as scan:
        assert scan.devices["laser"]["identity"] == "Acme"
    again = rig_with(target, CONFIG, "scan", "--grid", "4x3", "--out", "b.h5", "--dry-run")
    assert again.returncode == 0, again.stderr


@pytest.mark.parametrize(
    ("config", "told"),
    [
        (CONFIG + "[laser.more]\n", "laser.more: is not a key"),
        (
            CONFIG.replace("address", "adress"),
            r"laser\.adress: is not a key of kind 'acme', which has .*address",
        ),
        (CONFIG.replace("acme", "maser"), "no kind maser; choose among 'katana', .*'acme'"),
        (CONFIG.replace('address = "/dev/acme"\n', 'repetition = "10"\n'), "laser.repetition"),
        (
            '[galvo]\naddress = "/dev/g"\n[laser]\nkind = "acme"\n',
            "laser.address is missing",
        ),
    ],
)
def test_a_wrong_section_is_refused_in_words(target, rig_with, config, told):
    done = rig_with(target, config, "scan", "--dry-run")
    assert done.returncode == 2
    assert re.search(told, done.stderr), done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("source", "told"),
    [
        ("raise OSError('no licence')", "rig-acme cannot be loaded: OSError: no licence"),
        ("ACME = 3", "cannot be loaded: AttributeError"),
        (
            "from rig.devices.kinds import Kind\nfrom rig.model.config import GalvoConfig\n"
            "ACME = Kind(GalvoConfig, None)",
            "its section is not a LaserConfig",
        ),
        (blocks("python")[0].replace(", simulated=simulated", ""), "has no simulator"),
    ],
    ids=["fails", "is no kind", "is of another role", "has no simulator"],
)
def test_a_wrong_package_is_named(tmp_path, rig_with, source, told):
    install(source, tmp_path / "installed")
    done = rig_with(tmp_path / "installed", CONFIG, "scan", "--grid", "4x3", "--out", "a.h5")
    assert done.returncode == 2
    assert re.search(told, done.stderr), done.stderr
    assert "Traceback" not in done.stderr
