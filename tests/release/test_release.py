"""What is released: a wheel and a source distribution that are whole, and what names and dates them."""

import os
import re
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from datetime import date
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PACKAGES = ("rig", "recon", "drivers", "simulators")
#: A version of the changelog, and its day.
VERSION = re.compile(r"^## (\d+\.\d+\.\d+) \((\d{4}-\d{2}-\d{2})\)$", re.MULTILINE)
#: The name of a distribution that a requirement begins with.
NAME = re.compile(r"^[A-Za-z0-9_.-]+")


#: Without the source tree, which a test run may have on its path.
ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}


def run(*words, cwd=None) -> str:
    """Run a program; return what it says on stdout."""
    done = subprocess.run(
        [*map(str, words)], capture_output=True, text=True, timeout=250, env=ENVIRONMENT, cwd=cwd
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def tracked() -> set[str]:
    """Return the files of the packages, without what Python or numba wrote beside them."""
    return {
        path.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """Build the source distribution, and from that alone the wheel, as an index or a packager does."""
    folder = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "build", "--outdir", folder, ROOT)
    assert len(list(folder.glob("nlos_rig-*.tar.gz"))) == 1
    [built] = folder.glob("nlos_rig-*-py3-none-any.whl")
    return built


def test_wheel_has_every_file_of_the_packages_and_nothing_else(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
        assert any(name.endswith("licenses/LICENSE") for name in archive.namelist())
    assert names == tracked()


def test_program_runs_from_the_wheel_alone(wheel, tmp_path):
    """As pipx installs it: an environment of its own, in which the dependencies are, and the wheel."""
    home = tmp_path / "home"
    run(sys.executable, "-m", "venv", "--without-pip", home)
    scripts = home / ("Scripts" if os.name == "nt" else "bin")
    python = scripts / Path(sys.executable).name
    run(sys.executable, "-m", "pip", "--python", python, "install", "--no-deps", "--quiet", wheel)
    # the dependencies are those of this environment; its own copy of the program is not, since what a .pth
    # file adds is not looked through for further ones
    own = Path(run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip())
    (own / "dependencies.pth").write_text(sysconfig.get_path("purelib"), encoding="utf-8")
    where = run(python, "-P", "-c", "import rig; print(rig.__file__)", cwd=tmp_path)
    assert Path(where.strip()).is_relative_to(home)
    rig = scripts / "rig"
    assert wheel.name.split("-")[1] in run(rig, "--version", cwd=tmp_path)
    assert "office-10ms" in run(rig, "scan", "--preset", "list", cwd=tmp_path)  # a table beside the code
    assert "positions" in run(rig, "scan", "--dry-run", cwd=tmp_path)


def versions() -> list[tuple[str, date]]:
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    return [(number, date.fromisoformat(day)) for number, day in VERSION.findall(text)]


def test_versions_of_the_changelog_are_dated_and_in_order():
    numbered = [tuple(map(int, number.split("."))) for number, _ in versions()]
    assert len(numbered) >= 2
    assert numbered == sorted(numbered, reverse=True)
    assert [day for _, day in versions()] == sorted((day for _, day in versions()), reverse=True)


def test_citation_and_fallback_are_of_the_newest_version():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    newest, day = versions()[0]
    assert (cited["version"], cited["date-released"]) == (newest, day)
    assert PROJECT["tool"]["setuptools_scm"]["fallback_version"] == newest
    # what the format asks for, version 1.2.0
    assert {"cff-version", "message", "title", "authors"} <= cited.keys()
    assert cited["license"] == PROJECT["project"]["license"]


def test_every_dependency_has_its_licence_in_the_docs():
    optional = PROJECT["project"]["optional-dependencies"]
    wanted = [*PROJECT["project"]["dependencies"]]
    wanted += [one for extra, names in optional.items() if extra != "dev" for one in names]
    page = (ROOT / "docs/licences.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ([a-z0-9-]+) \| [^|-]", page, re.MULTILINE)
    listed = sorted(name for name in rows if name != "package")
    assert listed == sorted(NAME.match(one)[0] for one in wanted)
