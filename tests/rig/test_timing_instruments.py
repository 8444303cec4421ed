"""Every family of timing instruments, from the configuration to a picture, on the same simulated bench."""

import re

import numpy as np
import pytest

from rig.commands.calibrate import ROUTINES
from rig.devices.kinds import TIMING, time_axis, timing_limits
from rig.errors import ConfigError
from rig.files import ScanFile
from rig.files.picoquant import read_head
from rig.model.config import RigConfig, TimeHarp260Config, load, recorded
from rig.setup.doctor import timing
from support.served_bench import scan_served, served

#: What a configuration says of each, beside its kind; nothing where its usual settings do.
KINDS = {
    "hydraharp": "",
    "multiharp": "",
    "picoharp330": "",
    "picoharp330-cfd": 'trigger = "cfd"',
    "timeharp260": "",
    "timeharp260-n": 'board = "N"',
    "hydraharp500": "",
}
#: Width [ps] and number of the bins that they have then: all of them cover 60 ns.
BINS = {
    "hydraharp": (4, 15_000),
    "multiharp": (5, 12_000),
    "picoharp330": (4, 15_000),
    "picoharp330-cfd": (4, 15_000),
    "timeharp260": (25, 2_400),
    "timeharp260-n": (250, 240),
    "hydraharp500": (4, 15_000),
}
PLAN = ("--grid", "4x3", "--spacing", "20cm", "--exposure", "20ms", "--seed", "3")


def configured(folder, name):
    path = folder / f"{name}.toml"
    kind = name.split("-")[0]
    path.write_text(f'[simulation]\n[calibration]\nuse = false\n[tcspc]\nkind = "{kind}"\n{KINDS[name]}\n')
    return path


def scanned(rig, folder, name, *arguments):
    out = folder / f"{name}.h5"
    done = rig("scan", "--config", configured(folder, name), *PLAN, "--out", out, *arguments)
    assert done.code == 0, done.err
    return out


def counted(path, per_ns=2):
    """(steps, 60 per_ns) photons in as many bins as all instruments can have together: of 0.5 ns."""
    with ScanFile(path) as scan:
        bins, width_s, first_s = scan.bins, scan.bin_width_s, scan.first_bin_s
        counts = scan.counts(range(scan.steps))
    assert first_s == pytest.approx(28e-9)
    assert bins * width_s == pytest.approx(60e-9)
    return counts.reshape(len(counts), 60 * per_ns, -1).sum(axis=2, dtype=np.int64)


@pytest.fixture
def hydraharps(rig, tmp_path):
    return scanned(rig, tmp_path, "hydraharp")


@pytest.mark.parametrize("name", [name for name in KINDS if name != "hydraharp"])
def test_the_same_photons_through_another_instrument(rig, tmp_path, hydraharps, name):
    """The bench draws photons by seed and position: bins that agree must hold the same numbers."""
    out = scanned(rig, tmp_path, name)
    with ScanFile(out) as scan:
        assert (round(scan.bin_width_s * 1e12), scan.bins) == BINS[name]
        assert scan.photons > 10_000
        # what stands in the file is read as what it was
        again = recorded(scan.config.model_dump_json())
        assert again == scan.config
        assert again.tcspc.kind == name.split("-")[0]
        with ScanFile(hydraharps) as ours:
            if BINS[name] == BINS["hydraharp"]:
                assert np.array_equal(scan.counts(range(12)), ours.counts(range(12)))
    assert np.array_equal(counted(out), counted(hydraharps))


@pytest.mark.parametrize("name", ["multiharp", "timeharp260-n"])
def test_what_was_measured_is_imaged(rig, tmp_path, name):
    out = scanned(rig, tmp_path, name)
    done = rig("recon", out, "--depth", "0.5m:1.5m:10cm", "--voxel", "20cm", "--out", tmp_path / "v.h5")
    assert done.code == 0, done.err


@pytest.mark.parametrize(
    ("name", "hardware", "record_type", "base_s"),
    [
        ("multiharp", "MultiHarp 150", 0x00010307, 5e-12),
        ("timeharp260", "TimeHarp 260 PICO", 0x00010306, 25e-12),
    ],
)
def test_a_mirror_that_never_stops(rig, tmp_path, name, hardware, record_type, base_s):
    """Records of another family make the same scan, and the file of them says whose they are."""
    config = configured(tmp_path, name)
    config.write_text(f"[point_clock]\n{config.read_text()}")
    out = tmp_path / "moving.h5"
    asked = ("--grid", "12x3", "--spacing", "10cm", "--exposure", "20ms", "--seed", "3")
    done = rig("scan", "--config", config, *asked, "--mode", "continuous", "--ptu", "--out", out)
    assert done.code == 0, done.err
    with ScanFile(out) as scan:
        assert scan.tagged
        assert scan.status == "complete"
        assert (round(scan.bin_width_s * 1e12), scan.bins) == BINS[name]
        photons = scan.photons
    head = read_head(out.with_suffix(".ptu")).values
    assert head["HW_Type"] == hardware
    assert head["TTResultFormat_TTTRRecType"] == record_type
    assert head["HW_BaseResolution"] == base_s
    done = rig("import", out.with_suffix(".ptu"), tmp_path / "again.h5")
    assert done.code == 0, done.err
    with ScanFile(tmp_path / "again.h5") as scan:
        assert scan.photons == photons


#: What is configured, and words of the refusal, which costs no movement.
MISFITS = {
    "bins of 4 ps": (
        'kind = "multiharp"\nbin_width = "4ps"\n',
        "bin width to 4 ps.*nearest are 5 ps and 10 ps",
    ),
    "a level beyond": (
        'kind = "multiharp"\nsync_level = "-1.3V"\n',
        "trigger level to -1300 mV.*-1200 to 1200",
    ),
    "a positive CFD level": (
        'kind = "picoharp330"\ntrigger = "cfd"\nsync_level = "50mV"\n',
        "sync CFD level to 50 mV.*from -1500 to 0",
    ),
    "a histogram beyond": ('kind = "timeharp260"\nbins = 40000\n', "number of bins to 40000.*1 to 32768"),
}


@pytest.mark.parametrize("name", MISFITS)
def test_a_dry_run_knows_each_familys_limits(rig, tmp_path, name):
    text, words = MISFITS[name]
    config = tmp_path / "rig.toml"
    config.write_text(f'[simulation]\n[laser]\nrepetition = "1MHz"\n[tcspc]\n{text}')
    done = rig("scan", "--config", config, *PLAN, "--dry-run")
    assert done.code == 4
    assert re.search(words, " ".join(done.err.split())), done.err


@pytest.mark.parametrize(
    ("kind", "repetition", "words"),
    [
        ("hydraharp", "40MHz", r"12\.5 MHz after the divider.*divider to 4"),
        ("timeharp260", "80MHz", "40 MHz after the divider.*divider to 2"),
        ("multiharp", "80MHz", "78 MHz after the divider.*divider to 2"),
        ("picoharp330", "100MHz", "81 MHz after the divider.*divider to 2"),
        ("multiharp", "40MHz", None),
        ("picoharp330", "80MHz", None),
        ("hydraharp500", "100MHz", None),
    ],
)
def test_a_dry_run_knows_how_fast_the_laser_may_be(rig, tmp_path, kind, repetition, words):
    config, (width_ps, _) = tmp_path / "rig.toml", BINS[kind]
    config.write_text(
        f'[simulation]\n[laser]\nrepetition = "{repetition}"\n[detector]\ngated = false\n'
        f'[tcspc]\nkind = "{kind}"\nbins = {10_000 // width_ps}\noffset = "0ns"\n'
    )
    done = rig("scan", "--config", config, *PLAN, "--dry-run")
    assert done.code == (0 if words is None else 4), done.err
    assert words is None or re.search(words, " ".join(done.err.split())), done.err


def test_more_bins_than_records_can_tell(rig, tmp_path):
    """A PicoHarp 330 has histograms of 524288 bins; in records of photons there are 32768."""
    config = tmp_path / "rig.toml"
    config.write_text(
        '[simulation]\n[point_clock]\n[laser]\nrepetition = "5MHz"\n'
        '[tcspc]\nkind = "picoharp330"\nbin_width = "1ps"\nbins = 60000\n'
    )
    assert rig("scan", "--config", config, *PLAN, "--dry-run").code == 0
    done = rig("scan", "--config", config, *PLAN, "--mode", "continuous", "--dry-run")
    assert done.code == 4
    assert "records can number 32768 bins at most" in " ".join(done.err.split())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            'kind = "multiharp"\nsync_zero_cross = "10mV"\n',
            "'tcspc.sync_zero_cross' is a key of kind 'hydraharp' or 'picoharp330'",
        ),
        ('kind = "hydraharp"\nsync_edge = "rising"\n', "'tcspc.sync_edge' is a key of kind 'multiharp' or"),
        (
            'kind = "picoharp330"\nsync_zero_cross = "-10mV"\n',
            "sync_zero_cross has no meaning for an edge trigger",
        ),
        (
            'kind = "picoharp330"\ntrigger = "cfd"\ninput_edge = "rising"\n',
            "input_edge has no meaning for a discriminator",
        ),
        (
            'kind = "timeharp260"\nboard = "N"\ninput_zero_cross = "-10mV"\n',
            "has no meaning for an edge trigger",
        ),
        ('kind = "timeharp260"\nsync_divider = 16\n', "sync_divider"),
    ],
)
def test_each_family_has_its_own_keys(tmp_path, text, words):
    config = tmp_path / "rig.toml"
    config.write_text(f"[simulation]\n[tcspc]\n{text}")
    with pytest.raises(ConfigError, match=words):
        load(config)


def test_the_boards_bins_can_be_chosen(tmp_path):
    config = tmp_path / "rig.toml"
    config.write_text('[simulation]\n[tcspc]\nkind = "timeharp260"\nboard = "N"\nbin_width = "1ns"\n')
    tcspc = load(config).tcspc
    assert isinstance(tcspc, TimeHarp260Config)
    assert (tcspc.bin_width_s, tcspc.bins) == (1e-9, 240)


@pytest.mark.parametrize(
    ("name", "level", "photons"),
    [
        ("multiharp", 'input_level = "-290mV"', True),
        ("multiharp", 'input_level = "-310mV"', False),  # the pulses reach -300 mV
        ("multiharp", 'input_level = "50mV"', False),  # a wrong sign
        ("timeharp260", 'input_level = "-290mV"', True),
        ("picoharp330", 'input_level = "-310mV"', False),
    ],
)
def test_a_wrong_level_can_be_rehearsed(rig, tmp_path, name, level, photons):
    config, out = configured(tmp_path, name), tmp_path / "a.h5"
    config.write_text(f"{config.read_text()}{level}\n")
    done = rig("scan", "--config", config, *PLAN, "--out", out)
    if photons:
        assert done.code == 0, done.err
        with ScanFile(out) as scan:
            assert scan.photons > 10_000
    else:
        assert "input trigger" in done.err
        assert not out.exists() or ScanFile(out).photons == 0


def test_a_wrong_sync_level_says_which(rig, tmp_path):
    config = configured(tmp_path, "multiharp")
    config.write_text(f'{config.read_text()}sync_level = "50mV"\n')
    done = rig("scan", "--config", config, *PLAN, "--out", tmp_path / "a.h5")
    assert done.code == 4
    assert "tcspc.sync_level (50 mV" in " ".join(done.err.split())


def test_the_other_edge_shifts_all_times_by_the_pulses(rig, tmp_path):
    """Both at the rising edge: as before. The input alone: later by the 10 ns that the pulses are long."""
    falling = scanned(rig, tmp_path, "multiharp")
    config = configured(tmp_path, "multiharp")

    def with_edges(text):
        out = tmp_path / "edges.h5"
        out.unlink(missing_ok=True)
        config.write_text(f'[simulation]\n[calibration]\nuse = false\n[tcspc]\nkind = "multiharp"\n{text}')
        done = rig("scan", "--config", config, *PLAN, "--out", out)
        assert done.code == 0, done.err
        return counted(out)

    before = counted(falling)
    both = with_edges('sync_edge = "rising"\ninput_edge = "rising"\n')
    assert np.array_equal(both, before)
    late = with_edges('input_edge = "rising"\n')
    assert np.array_equal(late[:, 20:], before[:, :-20])


def test_another_instrument_on_a_served_bench(rig, tmp_path):
    """The configuration that is served with says what instrument is simulated where the scan runs."""
    with served(tmp_path, "--config", configured(tmp_path, "timeharp260-n")) as bench:
        told = load(bench.config).tcspc
        assert isinstance(told, TimeHarp260Config)
        assert (told.board, told.address) == ("N", bench.told["timing"])
        scan_served(rig, bench, tmp_path / "served.h5", *PLAN[:-2])
    with ScanFile(tmp_path / "served.h5") as scan:
        assert scan.devices["tcspc"]["identity"].startswith("PicoQuant TimeHarp 260 N, part SIM")
        assert scan.photons > 10_000


@pytest.mark.parametrize(
    ("kind", "name", "variable"),
    [("multiharp", "MultiHarp", "MHLIB_PATH"), ("timeharp260", "TimeHarp 260 P", "TH260LIB_PATH")],
)
def test_the_doctor_looks_for_the_library_of_its_kind(monkeypatch, kind, name, variable):
    monkeypatch.setenv(variable, "/nowhere/lib.so")
    monkeypatch.setenv("HHLIB_PATH", "/elsewhere/hhlib.so")
    ports = {name: {"address": f"sim://{name}"} for name in ("galvo", "laser", "detector")}
    config = RigConfig.model_validate({**ports, "tcspc": {"kind": kind}})
    (finding,) = [one for one in timing.check(config) if one.what == f"{name} library"]
    assert finding.verdict == "missing"
    assert "/nowhere/lib.so" in finding.found
    assert variable in finding.remedy


@pytest.mark.parametrize("name", KINDS)
def test_calibrations_choose_bins_that_the_instrument_has(tmp_path, name):
    """They cover the whole time between two pulses, of 100 ns and more, and no finer than need be."""
    config = load(configured(tmp_path, name))
    assert {"lag", "dark", "gate", "time-zero"} <= ROUTINES.keys()
    for build in ROUTINES.values():
        routine = build()
        chosen = routine.setup(config)
        TIMING.of(chosen.tcspc).check(chosen)
        bins, width_s = time_axis(chosen)
        timing_limits(chosen).check_histogram(bins, width_s)
        if routine.tagged:
            TIMING.of(chosen.tcspc).tagging.check(chosen)
