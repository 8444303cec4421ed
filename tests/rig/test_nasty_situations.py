"""What happens to devices in a laboratory, in a scan or before it: dark, or said to be EMITTING.

The table in docs/attacks.md names the test of each situation; these are the ones that had none.
"""

import pytest

from attacks.scene import attacked_rig, kept, scan, tiny_config, tiny_plan
from rig.acquire.events import Noticed, Ready, StepDone
from simulators.wire import galvo as board

CONFIG = tiny_config()
PLAN = tiny_plan(CONFIG, exposure_s=10e-3)
#: One exposure during which the mirror is looked at.
LONG = tiny_plan(CONFIG, columns=2, rows=2, exposure_s=2.0)
MIDDLE = 5
HARP = {"kind": "hydraharp", "bins": 1500, "bin_width": "32ps"}


class Watcher:
    """Does something after a step, and remembers what was told."""

    def __init__(self, do=lambda: None, after=MIDDLE):
        self.do, self.after = do, after
        self.noticed, self.warnings, self.ready = [], (), False

    def __call__(self, event):
        match event:
            case StepDone(step=step) if step.index == self.after:
                self.do()
            case Noticed(sentence=sentence):
                self.noticed.append(sentence)
            case Ready(warnings=warnings):
                self.warnings, self.ready = warnings, True


def scanned(tmp_path, rig, watcher, config=CONFIG, plan=PLAN):
    return scan(rig, config, plan, tmp_path / "a.h5", [watcher])


def test_a_hub_that_takes_laser_and_detector_away_leaves_both_named(tmp_path):
    """What fails last must not hide that the laser is still on."""
    with attacked_rig(CONFIG) as rig:

        def pull():
            rig.unplug("laser")
            rig.unplug("spad")

        end = scanned(tmp_path, rig, Watcher(pull))
    assert end.code in (3, 4)
    assert end.emitting  # nobody can reach it
    assert "EMITTING" in end.said
    assert "BIASED" in end.said


def test_a_hydraharp_that_goes_is_said_to_be_gone(tmp_path):
    with attacked_rig(CONFIG) as rig:

        def pull():
            rig.harp.connection.connected = False

        end = scanned(tmp_path, rig, Watcher(pull))
    assert (end.code, end.emitting, end.sensitive) == (3, False, False)
    assert "-10 (DEVICE_NOT_OPEN)" in end.said
    assert "The instrument is no longer connected: check the USB cable and port" in end.said
    assert "calling program" not in end.said
    assert kept(tmp_path / "a.h5").done.sum() == MIDDLE + 1


@pytest.mark.parametrize("bit", [board.OUTPUT_LIMIT, board.AVERAGE_OUTPUT_LIMIT])
@pytest.mark.parametrize("over", [False, True])
def test_a_mirror_at_its_current_limit_ends_the_scan(tmp_path, bit, over):
    """Also when it is over before anybody looks: where the mirror was meanwhile nobody knows."""
    with attacked_rig(CONFIG) as rig:

        def overload():
            rig.galvo.break_down(bit)
            if over:
                rig.galvo.repair()

        end = scanned(tmp_path, rig, Watcher(overload))
    assert (end.code, end.emitting, end.sensitive) == (3, False, False)
    assert "output limit" in end.said
    assert "use smaller or slower steps" in end.said


@pytest.mark.parametrize("damage", ["drop_answers", "garble_answers"])
def test_one_answer_of_the_mirror_that_is_lost_ends_no_scan_and_is_told(tmp_path, damage):
    with attacked_rig(CONFIG) as rig:
        watcher = Watcher(lambda: setattr(rig.galvo, damage, 1))
        end = scanned(tmp_path, rig, watcher)
    assert (end.code, end.emitting, end.sensitive) == (0, False, False)
    assert any("the mirror was steered a second time" in one for one in watcher.noticed)
    assert kept(tmp_path / "a.h5").done.all()


@pytest.mark.parametrize("damage", ["drop_answers", "garble_answers"])
def test_one_answer_that_is_lost_during_a_long_exposure_ends_no_scan_and_is_told(tmp_path, damage):
    with attacked_rig(CONFIG) as rig:
        answer, clock, asked_s, damaged = rig.galvo.answer, rig.bench.clock, [0.0], []
        watcher = Watcher()

        def spoiled_once(line):
            # while it settles the mirror is asked each millisecond; in an exposure, tenths of a second later
            late = clock.now_s() - asked_s[-1] > 0.1
            asked_s.append(clock.now_s())
            if late and line == b"STATUS" and watcher.ready and not damaged:
                damaged.append(line)
                setattr(rig.galvo, damage, 1)
            return answer(line)

        rig.galvo.answer = spoiled_once
        end = scanned(tmp_path, rig, watcher, plan=LONG)
        assert damaged
    assert (end.code, end.emitting, end.sensitive) == (0, False, False), end.said
    assert [one for one in watcher.noticed if "the mirror was asked a second time" in one]


@pytest.mark.parametrize(
    ("level", "code", "words"),
    [
        ("350mV", 4, "sees no sync pulses although the laser reports that it emits"),
        ("5mV", 0, "if the level is too low, noise is counted"),
    ],
)
def test_a_wrong_level_of_the_sync_is_told_with_the_level(tmp_path, level, code, words):
    config = tiny_config({"tcspc": HARP | {"sync_level": level}})
    with attacked_rig(config) as rig:
        watcher = Watcher()
        end = scanned(tmp_path, rig, watcher, config)
    assert (end.code, end.emitting, end.sensitive) == (code, False, False)
    told = " ".join([end.said, *watcher.warnings])
    assert words in told
    assert f"{level[:-2]} mV" in told


def test_a_level_above_the_detector_s_pulses_is_told(tmp_path):
    config = tiny_config({"tcspc": HARP | {"input_level": "1V"}})
    with attacked_rig(config) as rig:
        watcher = Watcher()
        end = scanned(tmp_path, rig, watcher, config)
    assert (end.emitting, end.sensitive) == (False, False)
    assert any("No photons arrive: check the detector, its cable" in one for one in watcher.warnings)
    assert kept(tmp_path / "a.h5").counts.sum() == 0
