"""What an image will take: counted rightly, said before it begins, and refused where it cannot be."""

import json
import re
from dataclasses import replace

import pytest

from recon import parts
from recon.effort import Effort, Speed, effort
from recon.imaging import plan
from recon.sampling import CONFOCAL
from rig.errors import RefusedError
from rig.files import ScanFile
from rig.image import forecast
from rig.image.forecast import forecasted
from rig.image.request import Request
from rig.image.work import chosen
from support.point_scans import write_point_scan

REQUEST = Request(wavelength_m=0.08, depth_m=(0.5, 0.9, 0.02))


@pytest.fixture(scope="module")
def scan(tmp_path_factory):
    return write_point_scan(tmp_path_factory.mktemp("forecast") / "point.h5")


def counted(scan, request) -> Effort:
    with ScanFile(scan) as file:
        work, _ = chosen(file, request)
        found = effort(plan(work.capture, work.pulse, work.grid, CONFOCAL, work.window), "rsd")
    assert found is not None
    return found


def test_a_dry_run_says_what_it_takes_and_makes_nothing(rig, scan, tmp_path):
    done = rig("recon", scan, "--wavelength", "8cm", "--depth", "0.5m:0.9m:2cm", "--dry-run", "--json")
    told = json.loads(done.out)
    assert told["voxels"] == [24, 20, 21]
    assert told["positions"] == 480
    assert 0 < told["least_bytes"] <= told["memory_bytes"]
    assert told["images_at_most"] == 1
    assert not list(tmp_path.glob("point*"))
    on_two = rig("recon", scan, "--depth", "0.5m:0.9m:2cm", "--dry-run", "--cluster", "local:2")
    assert re.search(r"on workers .* on 2: \d+ parts of .* MB at most, .* are sent", on_two.out)
    assert "each of up to 7 images" in on_two.out
    none = rig("recon", scan, "--solver", "lct", "--dry-run")
    assert "not estimated" in none.out


def test_work_grows_as_what_is_asked_for(scan):
    once = counted(scan, REQUEST)
    twice = counted(scan, replace(REQUEST, depth_m=(0.5, 0.9, 0.01)))
    assert twice.voxels == pytest.approx(2 * once.voxels, rel=0.05)  # 41 planes in place of 21
    assert twice.waves_s == pytest.approx(2 * once.waves_s, rel=0.1)
    finer = counted(scan, replace(REQUEST, voxel_m=0.015))
    assert finer.voxels == 4 * once.voxels
    assert finer.memory_bytes > once.memory_bytes
    usual, slow = Speed(), Speed(2.0, 2.0, 2.0)
    assert once.processor_s(slow) > once.processor_s(usual) > once.clock_s(usual, 4)


def test_what_the_dry_run_says_of_parts_is_what_is_cut(scan):
    told = forecasted(scan, REQUEST, workers=3).on_workers
    with ScanFile(scan) as file:
        work, _ = chosen(file, REQUEST)
        problem = replace(plan(work.capture, work.pulse, work.grid, CONFOCAL, work.window), slopes=True)
        cut = parts.cut(problem, "rsd", workers=3, memory_bytes=10**10)
    assert told is not None
    assert (told.parts, told.traffic_bytes) == (len(cut.parts), cut.traffic_bytes)


def test_more_voxels_than_the_computer_holds_are_refused_with_the_least_that_would(rig, scan):
    done = rig("recon", scan, "--voxel", "0.001mm")
    assert done.code == 2
    assert "Voxels of" in done.err
    assert "would fit" in done.err


def test_what_takes_very_long_is_said_and_needs_a_yes(rig, scan, tmp_path, monkeypatch):
    monkeypatch.setattr(forecast, "LONGEST_S", 1.0)  # starting alone takes longer
    asked = ("recon", scan, "--wavelength", "8cm", "--depth", "0.6m:0.8m:10cm", "--out", "v.h5")
    done = rig(*asked)
    assert done.code == 4
    assert "imaging takes about" in done.err
    assert "--yes" in done.err
    assert not list(tmp_path.iterdir())
    assert rig(*asked, "--dry-run").code == 4
    assert rig(*asked, "--dry-run", "--yes").code == 0
    assert rig(*asked, "--yes").code == 0
    assert (tmp_path / "v.h5").is_file()


def test_what_does_not_fit_beside_its_spectra_is_refused():
    huge = Effort(10, 10, 10, 10, True, 1.0, 1.0, 1.0, 10**15, 10**15, 10**8)
    found = forecast.Forecast((1, 1, 1), huge, 1.0, 1.0, 2, 1)
    with pytest.raises(RefusedError, match=r"--memory .*GB computes it in several steps"):
        forecast.require_possible(found, bounded=False, however_long=True)
    forecast.require_possible(found, bounded=True, however_long=True)
    hopeless = replace(found, effort=replace(huge, least_bytes=10**15))
    with pytest.raises(RefusedError, match=r"TB|GB") as refusal:
        forecast.require_possible(hopeless, bounded=False, however_long=True)
    assert "--memory" not in str(refusal.value)


def test_the_speed_is_measured_once_and_kept(tmp_path, monkeypatch):
    monkeypatch.setenv("RIG_STATE", str(tmp_path))
    forecast.this_speed.cache_clear()
    first = forecast.this_speed()
    assert min(first.waves, first.tables, first.record) > 0
    forecast.this_speed.cache_clear()
    assert forecast.this_speed() == first
    (tmp_path / "speed.json").write_text("half a docu")
    forecast.this_speed.cache_clear()
    forecast.this_speed()
    assert set(json.loads((tmp_path / "speed.json").read_text())) == {"machine", "speed"}
    forecast.this_speed.cache_clear()


def test_the_speed_is_measured_where_it_cannot_be_kept(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("RIG_STATE", str(tmp_path / "file" / "state"))
    forecast.this_speed.cache_clear()
    assert forecast.this_speed().waves > 0
    forecast.this_speed.cache_clear()
