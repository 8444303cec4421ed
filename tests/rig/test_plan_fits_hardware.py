"""A plan that the hardware cannot do is refused before anything moves, by --dry-run in the same words."""

import re

import h5py
import numpy as np
import pytest

#: What is configured beside a small grid, the exit code, and words of the refusal.
MISFITS = {
    "80 MHz without a divider": (
        '[laser]\nrepetition = "80MHz"\n',
        r"80 MHz of sync pulses with a sync divider of 1.*12\.5 MHz after the divider.*divider to 8",
    ),
    "170 MHz": (
        '[laser]\nrepetition = "170MHz"\n[tcspc]\nsync_divider = 16\n',
        r"170 MHz of sync pulses.*150 MHz before it.*Choose a slower laser rate",
    ),
    "a gate after the period": (
        '[detector]\ngate_delay = "120ns"\n',
        r"gate opens 120 ns and closes 160 ns after a sync pulse.*next pulse comes after 100 ns.*gate_delay",
    ),
    "a gate that the next pulse closes": (
        '[detector]\ngate_width = "80ns"\n',
        r"gate opens 31\.5 ns and closes 111\.5 ns.*after 100 ns.*gate_width",
    ),
    "a gate before the histogram": (
        '[detector]\ngate_delay = "0ns"\ngate_width = "20ns"\n',
        r"gate is open from 0 s to 20 ns.*covers 28 ns to 88 ns: no photon would be counted",
    ),
    "a record that is longer than the period": (
        "[tcspc]\nbins = 65536\n",
        r"65536 bins of 4 ps is 262\.14 ns long, but sync pulses come every 100 ns.*tcspc\.bins to 25000",
    ),
    "an offset after the period": (
        '[tcspc]\noffset = "100ns"\n[detector]\ngated = false\n',
        r"histogram starts 100 ns after a sync pulse, but the next pulse comes after 100 ns",
    ),
    "an offset that is not whole": (
        '[tcspc]\noffset = "28.5ns"\n',
        r"histogram offset to 28\.5 ns, but it accepts whole ns.*nearest possible value is 28 ns",
    ),
    "bins of 3 ps": ('[tcspc]\nbin_width = "3ps"\n', r"bin width to 3 ps.*The nearest are 2 ps and 4 ps"),
    "bins of 5 ps": ('[tcspc]\nbin_width = "5ps"\n', r"bin width to 5 ps.*The nearest are 4 ps and 8 ps"),
    "a level that no HydraHarp has": (
        '[tcspc]\nsync_level = "1.2V"\n',
        r"sync CFD level to 1200 mV, but it accepts whole mV from 0 to 1000",
    ),
    "a laser of 10 mHz": (
        '[laser]\nrepetition = "10mHz"\n',
        r"repetition rate 0\.01 Hz is not within 1 to inf Hz",
    ),
    "a laser slower than the exposure": (
        '[laser]\nrepetition = "20Hz"\n[detector]\ngated = false\n',
        r"exposure of 10 ms is shorter than the 50 ms between two laser pulses",
    ),
    "a hold-off longer than the exposure": (
        '[detector]\nhold_off = "20ms"\n',
        r"holds off for 20 ms after a detection, but an exposure is 10 ms",
    ),
    "an exposure of half milliseconds": (
        '[scan]\nexposure = "1.5ms"\n',
        r"1\.5 ms.*nearest possible value is 2 ms",
    ),
}


@pytest.mark.parametrize("name", MISFITS)
def test_it_is_refused_before_anything_moves(rig, tmp_path, name):
    text, words = MISFITS[name]
    config, out = tmp_path / "rig.toml", tmp_path / "scan.h5"
    config.write_text(text + "[simulation]\n")
    asked = ("scan", "--config", config, "--grid", "4x3", "--spacing", "20cm", "--out", out)
    dry, real = rig(*asked, "--dry-run"), rig(*asked, "--yes")
    assert dry.code == real.code == 4
    assert dry.out == real.out == ""
    assert dry.err == real.err
    assert_words(words, dry.err)
    assert not out.exists()


def assert_words(pattern, text):
    # the terminal breaks lines at its width
    assert re.search(pattern, " ".join(text.split())), text


def test_an_existing_output_is_refused_by_both(rig, tmp_path):
    out = tmp_path / "scan.h5"
    out.write_bytes(b"of somebody else")
    asked = ("scan", "--grid", "4x3", "--spacing", "20cm", "--out", out)
    dry, real = rig(*asked, "--dry-run"), rig(*asked)
    assert dry.code == real.code == 2
    assert dry.err == real.err
    assert_words("exists and is not overwritten", dry.err)
    assert out.read_bytes() == b"of somebody else"


#: The third ends after the period: its last bins stay empty.
@pytest.mark.parametrize(
    "text",
    [
        '[laser]\nrepetition = "80MHz"\n[tcspc]\nsync_divider = 8\nbins = 3125\noffset = "0ns"\n'
        '[detector]\ngate_delay = "2ns"\ngate_width = "10ns"\n',
        "[tcspc]\nbins = 25000\noffset = '0ns'\n",
        "[tcspc]\nbins = 18750\noffset = '60ns'\n[detector]\ngated = false\n",
        '[laser]\nrepetition = "12.5MHz"\n',
    ],
)
def test_what_fits_is_planned(rig, tmp_path, text):
    config = tmp_path / "rig.toml"
    config.write_text(text + "[simulation]\n")
    done = rig("scan", "--config", config, "--grid", "4x3", "--spacing", "20cm", "--dry-run")
    assert done.code == 0, done.err


def test_a_scan_at_80_mhz_loses_no_photon_to_the_divider(rig, tmp_path):
    """The same photons whatever the divider, and the person is told that no instrument has confirmed it."""
    counts = []
    for divider in (8, 16):
        config, out = tmp_path / "rig.toml", tmp_path / f"{divider}.h5"
        config.write_text(
            '[laser]\nrepetition = "80MHz"\npower_setpoint = 10\n[detector]\ngated = false\n'
            f'[tcspc]\nsync_divider = {divider}\nbins = 3125\noffset = "0ns"\n[simulation]\n'
        )
        done = rig("scan", "--config", config, "--grid", "3x2", "--spacing", "20cm", "--out", out)
        assert done.code == 0, done.err
        assert_words(f"The sync divider is {divider}\\. That photons are timed", done.err)
        with h5py.File(out) as file:
            counts.append(file["transients/counts"][...])
    assert counts[0].sum() > 1000
    assert np.array_equal(*counts)
