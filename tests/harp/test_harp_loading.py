"""Finding and loading a shared library; a stand-in is compiled where there is a C compiler."""

import shutil
import subprocess
import sys

import pytest

from drivers.errors import DeviceNotFoundError
from drivers.harp.errors import HarpError
from drivers.harp.families import (
    HYDRAHARP_400,
    HYDRAHARP_500,
    MULTIHARP,
    PICOHARP_330,
    TIMEHARP_260_P,
)
from drivers.harp.loading import candidates, load_library
from support.harp_wire import HEADER

BODIES = {
    "HH_GetLibraryVersion": 'for (int i = 0; i < 4; i++) vers[i] = "3.0"[i]; return 0;',
    "HH_SetHistoLen": "*actuallen = 1024 << lencode; return 0;",
    "HH_SetStopOverflow": "return stopcount == 4294967295u ? 0 : -17;",
    "HH_StopMeas": "return 42;",
}


def compile_library(folder, declarations):
    if sys.platform != "linux" or not shutil.which("gcc"):
        pytest.skip("no gcc to compile a stand-in library with")
    source, library = folder / "hhlib.c", folder / "hhlib.so"
    lines = [f"{d} {{ {BODIES.get(d.split('(')[0][4:], 'return 0;')} }}" for d in declarations]
    source.write_text("\n".join(lines))
    subprocess.run(["gcc", "-shared", "-fPIC", "-o", library, source], check=True)
    return library


def test_compiled_library_is_called_with_the_right_types(tmp_path, monkeypatch):
    path = compile_library(tmp_path, HEADER.strip().splitlines())
    monkeypatch.setenv("HHLIB_PATH", str(path))
    library = load_library(HYDRAHARP_400)
    assert library.name == str(path)
    assert library.get_library_version() == "3.0"
    assert library.set_histo_len(0, 5) == 32768
    library.set_stop_overflow(0, True, 4294967295)
    with pytest.raises(HarpError, match="returned 42"):
        library.stop_meas(0)


def test_library_that_lacks_a_function(tmp_path, monkeypatch):
    path = compile_library(tmp_path, HEADER.strip().splitlines()[:-2])  # without ReadFiFo
    monkeypatch.setenv("HHLIB_PATH", str(path))
    with pytest.raises(DeviceNotFoundError, match=r"hhlib\.so \(the library has no such function\)"):
        load_library(HYDRAHARP_400)


def test_the_chosen_path_is_the_only_one(monkeypatch):
    monkeypatch.setenv("HHLIB_PATH", "/no/such/hhlib.so")
    assert candidates(HYDRAHARP_400) == ["/no/such/hhlib.so"]
    with pytest.raises(DeviceNotFoundError, match=r"/no/such/hhlib\.so"):
        load_library(HYDRAHARP_400)


def test_snapi_is_found_without_being_imported(tmp_path, monkeypatch):
    package = tmp_path / "snAPI"
    package.mkdir()
    (package / "__init__.py").write_text("raise RuntimeError('imported')")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delenv("HHLIB_PATH", raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    assert candidates(HYDRAHARP_400) == [
        str(package / "libhhlib.so"),
        "/usr/local/lib64/hh400/hhlib.so",
        "libhh400.so",
    ]


def test_windows_has_one_name(monkeypatch):
    monkeypatch.delenv("HHLIB_PATH", raising=False)
    monkeypatch.setattr(sys, "platform", "win32")
    assert candidates(HYDRAHARP_400) == ["hhlib64.dll"]


def test_everything_tried_is_listed(tmp_path, monkeypatch):
    (tmp_path / "snAPI").mkdir()
    (tmp_path / "snAPI" / "__init__.py").touch()
    (tmp_path / "snAPI" / "libhhlib.so").write_text("no library")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delenv("HHLIB_PATH", raising=False)
    try:
        library = load_library(HYDRAHARP_400)
    except DeviceNotFoundError as error:
        said = str(error)
    else:
        pytest.skip(f"the vendor's library is installed: {library.name}")
    places = [said.index(f"{name} (") for name in candidates(HYDRAHARP_400)]
    assert places == sorted(places)
    assert "HHLIB_PATH" in said


@pytest.mark.parametrize(
    ("family", "variable", "file", "windows"),
    [
        (MULTIHARP, "MHLIB_PATH", "libmhlib.so", "mhlib64.dll"),
        (PICOHARP_330, "PH330LIB_PATH", "libph330.so", "PH330Lib.dll"),
        (TIMEHARP_260_P, "TH260LIB_PATH", "libth260lib.so", "th260lib64.dll"),
        (HYDRAHARP_500, "HH500LIB_PATH", "libhh500lib.so", "HH500Lib.dll"),
    ],
)
def test_each_family_has_its_own_library(tmp_path, monkeypatch, family, variable, file, windows):
    (tmp_path / "snAPI").mkdir()
    (tmp_path / "snAPI" / "__init__.py").touch()
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("HHLIB_PATH", "/somewhere/hhlib.so")
    monkeypatch.delenv(variable, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    assert candidates(family)[0] == str(tmp_path / "snAPI" / file)
    monkeypatch.setattr(sys, "platform", "win32")
    assert candidates(family) == [windows]
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv(variable, "/no/such/file.so")
    with pytest.raises(DeviceNotFoundError, match=f"{family.name}: asked to load.*{variable}"):
        load_library(family)
