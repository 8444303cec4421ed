"""A scan file in place of the timing instrument: a rehearsal from the command line."""

from pathlib import Path

import numpy as np
import pytest

from rig.files import ScanFile

SMALL = ("--grid", "10x6", "--spacing", "10cm", "--exposure", "10ms")
PLAYED = '[tcspc]\nkind = "playback"\nfile = "real.h5"\n[simulation]\n'


@pytest.fixture
def recorded(rig):
    """A scan, and the configuration of a rig that plays it."""
    assert rig("scan", *SMALL, "--out", "real.h5").code == 0
    Path("rehearsal.toml").write_text(PLAYED)
    return rig


def everything(path):
    with ScanFile(path) as scan:
        return (
            scan.counts(range(scan.steps)),
            scan.live_time_s,
            scan.devices["tcspc"]["identity"],
            scan.warnings,
        )


def test_a_rehearsal_gives_the_recorded_photons_and_says_so(recorded):
    done = recorded("scan", "--config", "rehearsal.toml", *SMALL, "--out", "played.h5")
    assert done.code == 0, done.err
    assert "played back" in done.err
    real, played = everything("real.h5"), everything("played.h5")
    np.testing.assert_array_equal(played[0], real[0])
    np.testing.assert_array_equal(played[1], real[1])
    assert played[2].startswith("playback of real.h5")
    assert any("played back" in sentence for sentence in played[3])
    with ScanFile("real.h5") as ours, ScanFile("played.h5") as theirs:
        assert theirs.simulated
        assert (ours.bins, ours.bin_width_s, ours.first_bin_s) == (
            theirs.bins, theirs.bin_width_s, theirs.first_bin_s,
        )  # fmt: skip


def test_another_exposure_is_told(recorded):
    other = ("--grid", "10x6", "--spacing", "10cm", "--exposure", "20ms")
    assert recorded("scan", "--config", "rehearsal.toml", *other, "--out", "played.h5").code == 0
    assert any("was exposed for 0.01 s, not 0.02 s" in sentence for sentence in everything("played.h5")[3])


def test_a_longer_plan_than_was_recorded_ends_in_words(recorded):
    done = recorded("scan", "--config", "rehearsal.toml", "--grid", "10x7", *SMALL[2:], "--out", "played.h5")
    assert done.code == 4
    assert "has no more measured steps to play" in done.err
    with ScanFile("played.h5") as scan:
        assert scan.status == "failed"
        assert scan.done.sum() == 60


def test_what_cannot_be_played_is_refused_before_light(recorded):
    Path("rehearsal.toml").write_text(PLAYED.replace("real.h5", "none.h5"))
    done = recorded("scan", "--config", "rehearsal.toml", *SMALL, "--out", "played.h5")
    assert done.code == 5
    assert "none.h5 does not exist" in done.err
    two = '[[channels]]\nname = "a"\n[[channels]]\nname = "b"\ninput = 1\n'
    Path("rehearsal.toml").write_text(PLAYED + two)
    done = recorded("scan", "--config", "rehearsal.toml", *SMALL, "--out", "played.h5")
    assert done.code == 4
    assert "holds 1 channels of photons, but the rig has 2 of photons" in done.err
    assert not Path("played.h5").exists()


def test_a_resumed_rehearsal_goes_on_where_it_stopped(recorded):
    import h5py

    assert recorded("scan", "--config", "rehearsal.toml", *SMALL, "--out", "played.h5").code == 0
    with h5py.File("played.h5", "r+") as file:
        file["transients/done"][20:] = False
        file["stop"].attrs["status"] = "interrupted"
    assert recorded("resume", "played.h5").code == 2  # what is played is not taken from a file
    done = recorded("resume", "played.h5", "--config", "rehearsal.toml")
    assert done.code == 0, done.err
    np.testing.assert_array_equal(everything("played.h5")[0], everything("real.h5")[0])
