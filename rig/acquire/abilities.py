"""What a mirror that never stops needs of a rig: asked before a scan, and again where it is needed."""

from typing import TypeVar

from rig.devices.kinds import TIMING, Tagging
from rig.errors import RefusedError
from rig.model.config import RigConfig

T = TypeVar("T")


def tagging_of(config: RigConfig) -> Tagging:
    """Return how the timing instrument records each photon; raises `RefusedError` if it does not."""
    tagging = TIMING.of(config.tcspc).tagging
    if tagging is None:
        raise RefusedError(
            f"tcspc.kind = '{config.tcspc.kind}' cannot record single photons, "
            "which a mirror that never stops needs: use --mode step"
        )
    return tagging


def require_point_clock(clock: T | None) -> T:
    """Return a rig's point clock, or its section; raises `RefusedError` where there is none."""
    if clock is None:
        raise RefusedError(
            "a mirror that never stops needs a point clock, which sends pulses to the mirror and to the "
            "timing instrument: describe yours in [point_clock] (docs/point-clock.md), or use --mode step"
        )
    return clock
