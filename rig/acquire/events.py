"""What the scan engine tells while it runs; files and displays are consumers of these events."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from math import nan

import numpy as np
from numpy.typing import NDArray

from rig.model.devices import Exposure, Rates, Settings
from rig.model.plan import ScanPlan, Step

_LIGHT_IN_WORDS = {
    None: re.compile(r"the laser could not be confirmed dark at (?P<when>\S+): treat it as EMITTING"),
    True: re.compile(r"laser on since (?P<when>\S+)"),
    False: re.compile(r"laser dark, (?P<how>.+) at (?P<when>\S+)"),
}


class Phase(Enum):
    """What the engine is doing.

    ::

        PREPARING -> AIMING -> BIASING -> LIGHTING -> CHECKING -> EXPOSING -> CLOSING
            ^---------- a pass with other settings ------------------'
    """

    PREPARING = "preparing"
    AIMING = "aiming"
    BIASING = "biasing the detector"
    LIGHTING = "lighting"
    CHECKING = "checking rates"
    EXPOSING = "exposing"
    CLOSING = "closing"


class Outcome(Enum):
    """How a scan ended."""

    COMPLETE = "complete"
    INTERRUPTED = "interrupted"
    FAILED = "failed"


@dataclass(frozen=True)
class PhaseChanged:
    """The engine began another phase."""

    phase: Phase


@dataclass(frozen=True)
class Ready:
    """All is set for the first exposure of a pass.

    Attributes
    ----------
    pass_index
        Which pass of the plan.
    rates
        Sync and count rates.
    warnings
        The timing instrument's own warnings.
    settings
        What each device says of itself and its settings now, by device name.
    dark_hz
        Detections a second before there was light; None where they say nothing, because the gate opens with
        the laser's pulses alone.
    """

    pass_index: int
    rates: Rates
    warnings: tuple[str, ...]
    settings: dict[str, Settings]
    dark_hz: float | None = None


@dataclass(frozen=True)
class StepDone:
    """One step was measured. ``exposure.counts`` is valid only while the event is handled."""

    step: Step
    exposure: Exposure


@dataclass(frozen=True)
class StepCut:
    """A step was ended before its time, because a stop was asked for; it counts as not measured.

    ``exposure`` holds what was counted until then, for as long as the event is handled.
    """

    step: Step
    exposure: Exposure


@dataclass(frozen=True)
class LightChanged:
    """What is known of the laser's light.

    Attributes
    ----------
    on
        Whether the laser says that it emits; None where it could not be asked or does not obey.
    when
        Local time at which it was read back, ISO 8601.
    how
        What speaks for darkness.
    """

    on: bool | None
    when: str
    how: str = "read back twice"

    @property
    def words(self) -> str:
        """What is known, as a sentence."""
        if self.on is None:
            return f"the laser could not be confirmed dark at {self.when}: treat it as EMITTING"
        return f"laser on since {self.when}" if self.on else f"laser dark, {self.how} at {self.when}"

    @classmethod
    def from_words(cls, words: str) -> "LightChanged | None":
        """Read such a sentence, as scan files and logs keep it; None where it is another one."""
        for on, pattern in _LIGHT_IN_WORDS.items():
            if found := pattern.fullmatch(words):
                return cls(on, **found.groupdict())
        return None


@dataclass(frozen=True)
class Noticed:
    """Something less than good was noticed that does not end the scan.

    Attributes
    ----------
    sentence
        What.
    first, last
        The steps that it concerns.
    kind
        ``warning``, or what else it is.
    when_s
        Seconds since 1970 at which it began; NaN where nobody noted that.
    """

    sentence: str
    first: int
    last: int
    kind: str = "warning"
    when_s: float = nan


@dataclass(frozen=True)
class LineDone:
    """All steps of a line were measured: a good moment to put data on disk."""

    steps_done: int


@dataclass(frozen=True)
class Recorded:
    """The timing instrument gave records, perhaps none. ``words`` are valid while this is handled.

    Attributes
    ----------
    words
        (n,) uint32.
    step
        The step that is measured next, where the instrument counts its sync pulses from zero again; or None.
    """

    words: NDArray[np.uint32]
    step: int | None


@dataclass(frozen=True)
class Grown:
    """More frames are planned, of a scan that goes on until it is stopped. ``plan`` is the new one."""

    plan: ScanPlan


@dataclass(frozen=True)
class Ended:
    """The scan is over and the laser is dark.

    Attributes
    ----------
    outcome, reason
        How and why.
    steps_done
        Steps that can be trusted; fewer than were measured where the laser went dark unnoticed.
    """

    outcome: Outcome
    steps_done: int
    reason: str


Event = (
    PhaseChanged | Ready | StepDone | StepCut | LineDone | LightChanged | Noticed | Recorded | Grown | Ended
)
Consumer = Callable[[Event], None]
