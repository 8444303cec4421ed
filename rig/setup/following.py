"""What follows from the answers: when the histogram begins and ends, when the gate closes, what is divided.

Nothing of it replaces what somebody said.
"""

from math import dist
from typing import Any

from drivers.errors import LimitError
from recon.capture import C_M_PER_S
from rig.devices.kinds import TIMING
from rig.model.config import HarpConfig, RigConfig
from rig.model.presets import Table

#: The gate opens so long after the pulse is on the wall: what is nearer than 40 cm to the wall is not seen.
AFTER_WALL_S = 2.5e-9
#: The histogram begins so long before it.
BEFORE_WALL_S = 1e-9
#: Dividers of the sync pulses that all timing instruments with one have.
DIVIDERS = (1, 2, 4, 8, 16)


def wall_s(rig: RigConfig) -> float:
    """Return when the pulse on the wall's middle is recorded, after the sync pulse."""
    way_m = sum(dist(one, (0.0, 0.0, 0.0)) for one in (rig.galvo.position_m, rig.detector.position_m))
    return rig.timing.electronics_delay_s + way_m / C_M_PER_S


def gate_opens_s(rig: RigConfig) -> float:
    """Return a good time for the gate to open, to 10 ps."""
    return round(wall_s(rig) + AFTER_WALL_S, 11)


def following(rig: RigConfig) -> Table:
    """Return what a rig's distances and rates ask for, as a configuration has it.

    Parameters
    ----------
    rig
        What is known of the rig; where nothing is, it has defaults.
    """
    found: Table = {}
    period_s = 1 / rig.laser.repetition_hz
    detector, harp = rig.detector, rig.tcspc
    left_s = period_s - detector.gate_delay_s
    if detector.gated and 0 < left_s < detector.gate_width_s:
        found["detector"] = {"gate_width": f"{_whole_ns(left_s)}ns"}
    if isinstance(harp, HarpConfig):
        timing: Table = {"offset": f"{max(0, _whole_ns(wall_s(rig) - BEFORE_WALL_S))}ns"}
        if harp.bins * harp.bin_width_s > period_s:
            timing["bins"] = int(period_s / harp.bin_width_s)
        found["tcspc"] = {**timing, **_divided(rig)}
    return found


def _divided(rig: RigConfig) -> dict[str, Any]:
    """Return the smallest divider with which the instrument takes the laser's pulses; nothing if 1 does."""
    kind = TIMING.of(rig.tcspc)
    for divider in DIVIDERS:
        divided = rig.tcspc.model_copy(update={"sync_divider": divider})
        try:
            kind.check(rig.model_copy(update={"tcspc": divided}))
        except LimitError:
            continue
        return {"sync_divider": divider} if divider > 1 else {}
    return {}  # a dry run says why


def _whole_ns(time_s: float) -> int:
    return int(time_s * 1e9 + 1e-6)  # 27 ns are not 26 because of the last digit
