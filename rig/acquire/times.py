"""Whether the times of a plan fit each other: laser period, histogram, gate, hold-off and exposure."""

from rig.errors import RefusedError
from rig.model.config import HarpConfig
from rig.model.plan import Pass, ScanPlan
from rig.model.quantities import show
from rig.model.state import RigState

#: Sums of times are not exact to such a part.
ROUNDING = 1e-9


def check_times(plan: ScanPlan, state: RigState) -> None:
    """Refuse a plan with which photons would be lost, or none could be counted.

    Raises
    ------
    RefusedError
        What does not fit what, and what to change.
    """
    _check_histogram(state)
    for one in plan.passes:
        _check_exposure(one, state)
        if gate := state.gate:
            _check_gate(one.gate_s or (gate.delay_s, gate.width_s), state)


def _check_histogram(state: RigState) -> None:
    """Refuse a histogram beyond the period: photons are timed against the last sync pulse before them.

    A last bin that the period does not fill is a part of it.
    """
    harp, period_s = state.config.tcspc, state.sync_period_s
    if not isinstance(harp, HarpConfig):
        return
    if harp.offset_s >= period_s:
        raise RefusedError(
            f"the histogram starts {_show(harp.offset_s)} after a sync pulse, "
            f"but the next pulse comes after {_show(period_s)} (laser.repetition "
            f"{show(1 / period_s, 'Hz')}): lower tcspc.offset"
        )
    record_s = harp.bins * harp.bin_width_s
    if record_s > (period_s + harp.bin_width_s) * (1 + ROUNDING):
        most = int(period_s / harp.bin_width_s * (1 + ROUNDING))
        raise RefusedError(
            f"the histogram of {harp.bins} bins of {_show(harp.bin_width_s)} is {_show(record_s)} long, "
            f"but sync pulses come every {_show(period_s)} (laser.repetition {show(1 / period_s, 'Hz')}): "
            "lower "
            f"tcspc.bins to {most}, or use narrower bins or a slower laser"
        )


def _check_exposure(one: Pass, state: RigState) -> None:
    period_s = state.sync_period_s
    if one.exposure_s < period_s * (1 - ROUNDING):
        raise RefusedError(
            f"an exposure of {_show(one.exposure_s)} is shorter than the {_show(period_s)} between two laser "
            "pulses (laser.repetition): use a longer exposure"
        )
    hold_off_s = state.config.detector.hold_off_s if one.hold_off_s is None else one.hold_off_s
    if hold_off_s >= one.exposure_s:
        raise RefusedError(
            f"the detector holds off for {_show(hold_off_s)} after a detection, "
            f"but an exposure is {_show(one.exposure_s)}: lower detector.hold_off, or use a longer exposure"
        )


def _check_gate(gate_s: tuple[float, float], state: RigState) -> None:
    period_s = state.sync_period_s
    opens_s, closes_s = gate_s[0], sum(gate_s)
    if closes_s > period_s * (1 + ROUNDING):
        raise RefusedError(
            f"the gate opens {_show(opens_s)} and closes {_show(closes_s)} after a sync pulse, "
            f"but the next pulse comes after {_show(period_s)} (laser.repetition "
            f"{show(1 / period_s, 'Hz')}): lower "
            "detector.gate_delay or detector.gate_width"
        )
    harp = state.config.tcspc
    if not isinstance(harp, HarpConfig):
        return
    ends_s = harp.offset_s + harp.bins * harp.bin_width_s
    if closes_s <= harp.offset_s or opens_s >= ends_s:
        raise RefusedError(
            f"the gate is open from {_show(opens_s)} to {_show(closes_s)} after a sync pulse, "
            f"but the histogram covers {_show(harp.offset_s)} to {_show(ends_s)}: "
            "no photon would be counted. Change "
            "detector.gate_delay, tcspc.offset or tcspc.bins"
        )


def _show(time_s: float) -> str:
    return show(time_s, "s", 5)
