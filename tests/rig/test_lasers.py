"""Each kind of laser through a whole scan: alone, served and guarded, and where another one is configured."""

import os
import signal
import subprocess
import time
from pathlib import Path

import h5py
import pytest

from rig.files.scan import ScanFile
from rig.model.config import built_in
from support.served_bench import rig_command, served

CONFIGS = Path(__file__).parents[2] / "configs"
SMALL = ("--grid", "6x4", "--spacing", "25cm", "--exposure", "10ms")

#: What each laser says of itself during a scan.
TOLD = {
    "katana_08hp": {
        "identity": "Onefive Katana 08HP (775 nm)",
        "power_w": 0.8,
        "repetition_hz": 18e6,
        "trigger": "internal",
        "lip": 0.0,
        "emission_known_by": "measured light (lpa?)",
    },
    "superk": {
        "identity": "NKT SuperK EXTREME or FIANIUM SIM0001",
        "level_percent": 40.0,
        "repetition_hz": 10e6,
        "mode": "constant power",
        "interlock": "closed",
        "watchdog_s": 5,
    },
}

needs_posix = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals and signals are POSIX")


@pytest.fixture(autouse=True)
def state_of_its_own(tmp_path, monkeypatch):
    monkeypatch.setenv("RIG_STATE", str(tmp_path / "state"))


@pytest.fixture(params=TOLD)
def name(request):
    return request.param


def test_a_scan_is_made_with_it(rig, tmp_path, name):
    done = rig("scan", "--config", CONFIGS / f"{name}.toml", *SMALL, "--out", "a.h5")
    assert done.code == 0, done.err
    assert photons_of(tmp_path / "a.h5") > 1000
    with h5py.File(tmp_path / "a.h5") as file:
        told = dict(file["devices/laser"].attrs)
    assert {key: told[key] for key in TOLD[name]} == TOLD[name]


def test_its_power_is_what_the_photons_are_made_with(rig, tmp_path, name):
    key, half = {
        "katana_08hp": ("power =", 'power = "0.4W"'),
        "superk": ("level_percent", "level_percent = 20"),
    }[name]
    text = (CONFIGS / f"{name}.toml").read_text()
    text = "\n".join(half if line.startswith(key) else line for line in text.splitlines())
    (tmp_path / "half.toml").write_text(
        text + "\n[simulation.faults]\ndark_counts = '0Hz'\nambient_light = '0Hz'\n"
    )
    photons = {}
    for config in (CONFIGS / f"{name}.toml", tmp_path / "half.toml"):
        assert rig("scan", "--config", config, *SMALL, "--out", f"{config.stem}.h5").code == 0
        photons[config.stem] = photons_of(tmp_path / f"{config.stem}.h5")
    # hold-off and 500 Hz of room light change it by less than a tenth, chance by less than 5 %
    assert photons["half"] == pytest.approx(photons[name] / 2, rel=0.15)


@needs_posix
def test_served_and_guarded_it_is_lit_once_and_left_dark_also_when_the_program_is_killed(tmp_path, name):
    with served(tmp_path, "--config", CONFIGS / f"{name}.toml") as bench:
        whole = rig_command("scan", "--config", bench.config, *SMALL, "--out", "a.h5", "--yes")
        done = subprocess.run(whole, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
        assert done.returncode == 0, done.stderr
        assert bench.values("laser emission") == ["1", "0"]
        long = rig_command("scan", "--config", bench.config, *SMALL[:4], "--exposure", "60s", "--yes")
        with subprocess.Popen([*long, "--out", "b.h5"], cwd=tmp_path, stderr=subprocess.DEVNULL) as scan:
            wait_for(lambda: bench.values("laser emission")[-1] == "1")
            time.sleep(7.0 if name == "superk" else 0.5)  # longer than the laser's own watchdog bears
            assert bench.values("laser emission")[-1] == "1"
            scan.send_signal(signal.SIGKILL)
            wait_for(lambda: bench.values("laser emission")[-1] == "0")


@needs_posix
def test_a_configuration_for_another_katana_is_refused_in_the_dark(tmp_path):
    with served(tmp_path, "--config", CONFIGS / "katana_08hp.toml") as bench:
        text = bench.config.read_text()
        start, end = text.index("[laser]"), text.index("[", text.index("[laser]") + 1)
        address = next(line for line in text[start:end].splitlines() if line.startswith("address"))
        laser = f"[laser]\n{address}\npower_setpoint = 5\n\n"
        (tmp_path / "wrong.toml").write_text(text[:start] + laser + text[end:])
        scan = rig_command("scan", "--config", "wrong.toml", *SMALL, "--out", "a.h5", "--yes")
        done = subprocess.run(scan, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
        assert done.returncode == 3
        assert 'kind = "katana-08hp"' in done.stderr
        assert "Traceback" not in done.stderr
        assert not bench.values("laser emission")
    assert not (tmp_path / "a.h5").exists()


def test_the_built_in_laser_is_the_one_it_was():
    assert built_in().laser.kind == "katana"
    assert built_in().laser.fraction_of_full == 1.0


def photons_of(path):
    with ScanFile(path) as scan:
        assert scan.status == "complete"
        return int(scan.counts(range(scan.steps)).sum())


def wait_for(happened, limit_s=60.0):
    deadline_s = time.monotonic() + limit_s
    while not happened():
        assert time.monotonic() < deadline_s
        time.sleep(0.02)
