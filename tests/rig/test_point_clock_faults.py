"""What a continuous scan makes of a DAQ board that loses markers, ticks late, or is gone."""

from contextlib import contextmanager

import numpy as np
import pytest

from drivers.errors import DeviceError, LinkError, RefusedError
from rig.acquire.acquisition import Watch, record
from rig.acquire.connect import devices_on
from rig.acquire.engine import Noticed, Outcome, StepDone
from rig.bench.simulated import simulated_instruments
from rig.files import ScanFile
from rig.model.config import built_in_with
from rig.model.plan import ScanPlan
from rig.model.state import RigState
from support.simulated_wires import wires_to

CONFIG = built_in_with({"galvo": {"kind": "analogue"}, "simulation": {"scene": "empty", "seed": 2}})
COLUMNS, ROWS = 20, 6
PLAN = ScanPlan.grid(
    CONFIG, columns=COLUMNS, rows=ROWS, spacing_m=0.02, skip_m=0.0, exposure_s=2e-3, motion="continuous"
)


@contextmanager
def rig(unplugged_after: int | None = None, benches: list | None = None):
    """Open the devices of a rig; give them with its bench and its board."""
    bench, instruments = simulated_instruments(CONFIG)
    bench.warm_up()
    instruments.daq.calls_until_unplugged = unplugged_after
    if benches is not None:
        benches.append(bench)
    with instruments, devices_on(CONFIG, wires_to(CONFIG, bench, instruments), tagged=True) as devices:
        yield devices, bench, instruments.daq


def scanned(folder, devices, consumer=lambda event: None) -> ScanFile:
    """Scan, and return the file, open."""
    path = folder / "scan.h5"
    ended = record(PLAN, RigState(CONFIG), devices, path, Watch(consumers=(consumer,))).ended
    assert ended.outcome is Outcome.COMPLETE
    scan = ScanFile(path)
    assert scan.done.all()
    return scan


def of_markers(scan: ScanFile) -> list[str]:
    return [one for one in scan.warnings if "marker" in one]


def test_a_lost_marker_is_told_and_its_line_measured_again(tmp_path):
    with rig() as (devices, _, board):
        board.lost_marks = {40}

        def mended(event) -> None:
            if isinstance(event, Noticed):
                board.lost_marks = set()

        with scanned(tmp_path, devices, mended) as scan:
            (told,) = of_markers(scan)
    assert "1 of 21 markers did not come" in told


def test_a_ringing_cable_is_no_second_point(tmp_path):
    """The second pulse falls into the hold-off of the marker inputs."""
    with rig() as (devices, _, board):
        board.double_marks, board.double_after_s = set(range(0, 200, 7)), 5e-6
        with scanned(tmp_path, devices) as scan:
            assert not of_markers(scan)


def test_a_second_pulse_after_the_hold_off_is_told(tmp_path):
    with rig() as (devices, _, board):
        board.double_marks, board.double_after_s = {10}, 1e-3

        def mended(event) -> None:
            if isinstance(event, Noticed):
                board.double_marks = set()

        with scanned(tmp_path, devices, mended) as scan:
            assert of_markers(scan)


def test_a_slow_clock_is_followed(tmp_path):
    """50 ppm: live times tell it, since markers are counted in sync pulses."""
    with rig() as (devices, _, board):
        board.clock_error = 5e-5
        with scanned(tmp_path, devices) as scan:
            # a sync period of 100 ns is as much as the 50 ppm of 2 ms; the mean of 120 positions in 6 lines
            # is known to a period over each line of 20
            assert float(np.mean(scan.live_time_s)) == pytest.approx(2e-3 * (1 + 5e-5), rel=5e-5 / 20)


def test_a_board_that_is_unplugged_ends_the_scan_in_the_dark(tmp_path):
    benches = []

    def scan_unplugged() -> None:
        with rig() as (devices, bench, board):
            benches.append(bench)

            def pull(event) -> None:
                if isinstance(event, StepDone) and event.step.index == 2 * COLUMNS:
                    board.unplug()

            scanned(tmp_path, devices, pull)

    with pytest.raises(LinkError, match="DAQ board Dev1"):
        scan_unplugged()
    (bench,) = benches
    assert not bench.light.emitting
    assert not bench.light.sensitive
    with ScanFile(tmp_path / "scan.h5") as scan:
        assert scan.status == "failed"
        assert not scan.done.all()


@pytest.mark.parametrize("calls", range(21))
def test_a_plug_that_is_pulled_at_any_call_ends_in_the_dark(tmp_path, calls):
    """Of 20 calls; the last four are made when all is measured."""
    benches, told = [], "nothing failed"
    try:
        with rig(calls, benches) as (devices, _, _):
            scanned(tmp_path, devices).close()
    except DeviceError as error:
        told = str(error)
    assert "DAQ board Dev1" in told or calls > 15
    (bench,) = benches
    assert not bench.light.emitting
    assert not bench.light.sensitive
    if (path := tmp_path / "scan.h5").exists():
        with ScanFile(path) as scan:
            assert scan.status in ("failed", "complete")


def test_a_board_that_cannot_play_lines_is_told_and_nothing_is_measured(tmp_path):
    with rig() as (devices, _, board):
        board.buffered_lines = False
        with pytest.raises(RefusedError, match="-201062"):
            scanned(tmp_path, devices)
    with ScanFile(tmp_path / "scan.h5") as scan:
        assert not scan.done.any()
