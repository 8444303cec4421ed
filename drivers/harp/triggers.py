"""How an input makes one event of one pulse: by a constant-fraction discriminator, or by an edge."""

from dataclasses import dataclass
from enum import IntEnum


@dataclass(frozen=True)
class CfdTrigger:
    """A constant-fraction discriminator.

    Attributes
    ----------
    level_v, zero_cross_v
        Level that a pulse must pass, and level at which its crossing is timed, in the signs of the
        instrument (`drivers.harp.families`).
    """

    level_v: float
    zero_cross_v: float


@dataclass(frozen=True)
class EdgeTrigger:
    """A comparator.

    Attributes
    ----------
    level_v
        What a pulse must pass; with its sign.
    rising
        Whether it is passed upwards. A negative pulse begins with a falling edge.
    """

    level_v: float
    rising: bool = False


Trigger = CfdTrigger | EdgeTrigger


class TriggerMode(IntEnum):
    """What an input that has both is to use; the vendor's numbers."""

    EDGE = 0
    CFD = 1


@dataclass(frozen=True)
class WireTrigger:
    """A trigger in the library's units.

    Attributes
    ----------
    mode
        Which of the two it is.
    level_mv
        Its level.
    second
        Zero crossing [mV] of a discriminator; 0 or 1 for a falling or a rising edge.
    """

    mode: TriggerMode
    level_mv: int
    second: int
