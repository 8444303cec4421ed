"""Devices without a data interface: what a person sets, and what is known of it.

None of them opens anything. A person is asked for what is needed, and the answer is kept for the scan file.
"""

from types import TracebackType
from typing import Self

from drivers import errors as device_errors
from drivers.leaving import leave
from rig.errors import RefusedError
from rig.model.config import ExternalDelayerConfig, ExternalDetectorConfig
from rig.model.devices import Operator, Request, Settings
from rig.model.quantities import show

#: What is said of a laser that only a person can switch off.
BEWARE = "Treat the laser as EMITTING: switch it off by hand, now."

NEVER_ASKED = "never asked"


class DetectorByHand:
    """A detector whose bias, gate and hold-off a person sets.

    It is asked about when it is needed: before the first light, and when gate or hold-off change.

    Parameters
    ----------
    config
        How it has to be set.
    operator
        Who sets it; None where nobody is there, as in the guard's process.
    delayed
        Whether a delayer triggers the gate; else the detector delays it itself.
    """

    by_hand = frozenset({"bias", "hold_off", "gate_delay", "gate_width"})

    def __init__(
        self, config: ExternalDetectorConfig, operator: Operator | None, *, delayed: bool = False
    ) -> None:
        self.identity = f"{config.model}, without a data interface"
        self._model = config.model
        self._gated = config.gated
        self._delayed = delayed
        self._operator = operator
        self._wanted = (config.gate_delay_s, config.gate_width_s, config.hold_off_s)
        self._confirmed: tuple[float, float, float] | None = None
        self._answer = NEVER_ASKED

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        pass

    def enable(self) -> None:
        """Have it confirmed that the detector is set as wanted, unless it was before.

        Raises
        ------
        RigError
            The person says no, or nobody can answer.
        """
        if self._confirmed == self._wanted:
            return
        self._confirmed = None
        wanted = Request("detector", self._words(), {"biased": True, **self._asked()})
        self._answer = somebody(self._operator, wanted).set_by_hand(wanted)
        self._confirmed = self._wanted

    def disable(self) -> None:
        """Do nothing: no program can take this bias away."""

    def set_gate(self, delay_s: float, width_s: float) -> None:
        """Want another gate; a person is asked for it before the next light."""
        self._wanted = (delay_s, width_s, self._wanted[2])

    def set_hold_off(self, hold_off_s: float) -> None:
        """Want another hold-off; a person is asked for it before the next light."""
        self._wanted = (*self._wanted[:2], hold_off_s)

    def settings(self) -> Settings:
        """Return what a person was asked for, and the answer; nothing is read back."""
        return {"identity": self.identity, "set": "by hand", "answer": self._answer, **self._asked()}

    def _asked(self) -> dict[str, bool | float]:
        """Return what a person is asked for, by names and SI values."""
        delay_s, width_s, hold_off_s = self._wanted
        delay = {} if self._delayed else {"gate_delay_s": delay_s}
        return {"gated": self._gated, **delay, "gate_width_s": width_s, "hold_off_s": hold_off_s}

    def _words(self) -> str:
        """Return the same as an order."""
        delay_s, width_s, hold_off_s = self._wanted
        if not self._gated:
            gate = "free running"
        elif self._delayed:
            gate = f"gated by its trigger input, open for {show(width_s, 's', 4)}"
        else:
            since = show(delay_s, "s", 4)
            gate = f"gated, open from {since} after the sync pulse for {show(width_s, 's', 4)}"
        return f"Set the detector ({self._model}): bias on; {gate}; hold-off {show(hold_off_s, 's', 4)}"


class DelayerByHand:
    """A delayer of the gate that a person sets.

    Parameters
    ----------
    config
        What it is.
    operator
        Who sets it; None where nobody is there, as in the guard's process.
    """

    def __init__(self, config: ExternalDelayerConfig, operator: Operator | None) -> None:
        self.identity = f"{config.model}, without a data interface"
        self._model = config.model
        self._operator = operator
        self._wanted_s = 0.0
        self._confirmed_s: float | None = None
        self._answer = NEVER_ASKED

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        pass

    def set_delay(self, delay_s: float) -> None:
        """Want a delay; a person is asked for it before the next light."""
        self._wanted_s = delay_s

    def enable(self) -> None:
        """Have it confirmed that the delayer is set as wanted, unless it was before.

        Raises
        ------
        RigError
            The person says no, or nobody can answer.
        """
        if self._confirmed_s == self._wanted_s:
            return
        self._confirmed_s = None
        wanted = Request(
            "delayer",
            f"Set the delayer of the gate ({self._model}) to {show(self._wanted_s, 's', 4)}, its output on",
            {"triggered": True, "delay_s": self._wanted_s},
        )
        self._answer = somebody(self._operator, wanted).set_by_hand(wanted)
        self._confirmed_s = self._wanted_s

    def disable(self) -> None:
        """Do nothing: no program can switch it off."""

    def settings(self) -> Settings:
        """Return what a person was asked for, and the answer; nothing is read back."""
        return {
            "identity": self.identity,
            "set": "by hand",
            "answer": self._answer,
            "delay_s": self._wanted_s,
        }


class LaserByHand:
    """A laser that only a person can switch: what the guard has in its hands in place of a laser.

    A context manager that does not leave in silence while there is light.

    It knows what it was told, and says that there is light until it is told that there is none.

    Parameters
    ----------
    model
        Name of the product, for people to read.
    """

    def __init__(self, model: str) -> None:
        self.identity = f"{model}, without a data interface"
        self._model = model
        self._lit = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        leave([self.stop], problem)

    def arm(self) -> None:
        """Do nothing: there is nothing to prepare."""

    def emit(self) -> None:
        """Take it that there is light from now on."""
        self._lit = True

    def stop(self) -> None:
        """Refuse while there is light: nobody but a person can end it.

        Raises
        ------
        drivers.errors.RefusedError
            While there is light.
        """
        if self._lit:
            raise self.refusal()

    def take_word(self) -> None:
        """Believe a person who has switched it off."""
        self._lit = False

    def emitting(self) -> bool:
        """Return whether there is light, as far as was told."""
        return self._lit

    def settings(self) -> Settings:
        """Return what is known: how it is switched, and whether it is taken to emit."""
        return {"identity": self.identity, "switched": "by hand", "emitting": self._lit}

    def refusal(self) -> device_errors.RefusedError:
        """Return in words that no program can put it out."""
        return device_errors.RefusedError(
            f"laser ({self._model})",
            "be dark",
            "it has no data interface, and no program can switch it off",
            BEWARE,
        )


class UnseenLaser:
    """A laser behind a shutter, of which nothing is known: it is taken to emit all the time.

    Parameters
    ----------
    model
        Name of the product, for people to read.
    """

    def __init__(self, model: str) -> None:
        self.identity = f"{model}, without a data interface"

    def arm(self) -> None:
        """Do nothing: there is nothing to prepare."""

    def emit(self) -> None:
        """Do nothing: it may emit already."""

    def stop(self) -> None:
        """Do nothing: nobody here can change that."""

    def emitting(self) -> bool:
        """Return that it has to be taken to emit."""
        return True

    def settings(self) -> Settings:
        """Return what is known."""
        return {"identity": self.identity, "switched": "by hand, behind the shutter"}


def somebody(operator: Operator | None, wanted: Request) -> Operator:
    """Return who sets something by hand.

    Raises
    ------
    rig.errors.RefusedError
        If nobody is there.
    """
    if operator is None:
        raise RefusedError(f"a person must be at the rig for this: {wanted.words}")
    return operator
