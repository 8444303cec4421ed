"""The ID Quantique ID120, a single-photon detector that runs freely, over USBTMC.

Source of all commands: one published driver; not yet run by us on the hardware. It has no gate that a public
command sets. UNCONFIRMED: the unit of ``DEADTIME:TIME`` (ns here; that driver calls it microseconds, for a
range of 40 to 1 000 000 in steps of 40), the form in which ranges are told, and what ``REG:STATE?`` says.
"""

import re
from dataclasses import dataclass
from math import isfinite, nan
from types import TracebackType
from typing import Any, Self

from drivers.clock import Clock, wait_until
from drivers.errors import (
    DeviceNotFoundError,
    LimitError,
    LinkError,
    ProtocolError,
    RefusedError,
)
from drivers.leaving import insist, leave
from drivers.lines.usb_finder import find_instrument
from drivers.lines.usbtmc import UsbTmc

ID120 = (0x1DDC, 0x0330)

BEWARE = "Treat the detector as BIASED: switch it off by hand."

#: Units of ``DEADTIME:TIME`` a second: UNCONFIRMED.
DEAD_TIME_PER_S = 1e9


@dataclass(frozen=True, kw_only=True)
class Id120Settings:
    """What is set on connecting. Which values are possible, only the instrument itself tells.

    Attributes
    ----------
    hold_off_s
        Dead time: so long after a detection the detector stays off.
    """

    hold_off_s: float = 120e-9


@dataclass(frozen=True)
class Range:
    """What the instrument allows for its dead time [s]."""

    low: float
    high: float
    step: float


class Id120Spad:
    """An ID120; a context manager that leaves it without bias.

    Connecting leaves it without bias too, and sets the dead time, within the instrument's own limits.

    Parameters
    ----------
    serial
        USB serial number; None takes the only detector there is.
    backend
        A pyusb backend; None takes the system's libusb.
    clock
        The time to wait by.
    settings
        What it is set to.
    expected_identity
        Text that the answer to ``*IDN?`` must contain. Unconfirmed what the real one says.
    enable_timeout_s
        Longest wait for the bias.
    timeout_s
        Longest wait for one transfer. The published driver waits up to 20 s; there is no light without an
        answer in 4 s.

    Attributes
    ----------
    identity
        What the instrument answered to ``*IDN?``.
    """

    by_hand: frozenset[str] = frozenset()

    def __init__(
        self,
        *,
        serial: str | None = None,
        backend: Any = None,
        clock: Clock,
        settings: Id120Settings | None = None,
        expected_identity: str = "ID120",
        enable_timeout_s: float = 10.0,
        timeout_s: float = 5.0,
    ) -> None:
        self.name = f"SPAD {serial}" if serial else "SPAD"
        self.identity = ""
        self._serial = serial
        self._backend = backend
        self._clock = clock
        self._settings = settings or Id120Settings()
        self._expected_identity = expected_identity
        self._enable_timeout_s = enable_timeout_s
        self._timeout_s = timeout_s
        self._link: UsbTmc | None = None

    def __enter__(self) -> Self:
        device = find_instrument(self.name, vendor_product=ID120, serial=self._serial, backend=self._backend)
        self.name = f"SPAD at USB {device.idVendor:04x}:{device.idProduct:04x}"
        link = UsbTmc(device, name=self.name, clock=self._clock, timeout_s=self._timeout_s)
        try:
            link.open()
            self._link = link
            self._identify()
            self.disable()
            self.set_hold_off(self._settings.hold_off_s)
        except BaseException as problem:
            leave([self._close, link.close], problem)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        leave([self.disable, self._close], problem)

    def enable(self) -> None:
        """Bias the detector; return when that is confirmed.

        Raises
        ------
        RefusedError
            The bias did not come, or is faulty. The detector was disabled.
        LinkError, ProtocolError
            No answer, or none that makes sense. The detector was told to go off.
        """
        try:
            self._tell("REG:RUN TRUE")
            if not wait_until(
                self._clock,
                lambda: self._flag("REG:RUN?"),
                timeout_s=self._enable_timeout_s,
                every_s=0.1,
            ):
                raise self._refused("run", f"it does not after {self._enable_timeout_s:g} s")
            if self._flag("BIAS:ERROR_STATUS?"):
                raise self._refused("hold its bias", "it reports a bias error")
        except BaseException as problem:
            leave([self.disable], problem)
            raise

    def disable(self) -> None:
        """Remove the bias and verify that it is gone; safe to call at any time.

        Raises
        ------
        RefusedError
            The detector reports that it still runs.
        LinkError, ProtocolError
            It was told to go off, and whether it did cannot be known.
        """
        if self._link is None:
            return
        insist(self._take_bias, name=self.name, asked="switch its bias off", beware=BEWARE)

    def set_gate(self, delay_s: float, width_s: float) -> None:
        """Refuse: it has no gate.

        Raises
        ------
        LimitError
            Always; nothing was sent.
        """
        raise LimitError(
            self.name, "open a gate", "it is free-running", "Nothing was sent. Use a gated detector."
        )

    def set_hold_off(self, hold_off_s: float) -> None:
        """Set the time after a detection during which the detector stays off.

        Raises
        ------
        LimitError
            It is outside the instrument's range; nothing was sent.
        RefusedError
            The instrument kept another value.
        LinkError, ProtocolError
            No answer, or none that makes sense.
        """
        allowed = self._dead_times()
        slack_s = 0.5 / DEAD_TIME_PER_S  # what rounding to the wire's unit may add
        if not isfinite(hold_off_s) or not allowed.low - slack_s <= hold_off_s <= allowed.high + slack_s:
            raise LimitError(
                self.name,
                f"set a dead time of {hold_off_s:g} s",
                f"its range is {allowed.low:g} to {allowed.high:g} s",
                "It was not sent. Correct detector.hold_off.",
            )
        value = round(hold_off_s * DEAD_TIME_PER_S)
        self._tell(f"DEADTIME:TIME {value}")
        kept = self._number("DEADTIME:TIME?")
        if abs(kept - value) > allowed.step * DEAD_TIME_PER_S:
            raise self._refused(f"set DEADTIME:TIME {value}", f"it kept {kept:g}")

    def _dead_times(self) -> Range:
        """Ask for the range; lowest, highest and step are taken from the answer in this order."""
        question = "DEADTIME:CAPABILITY?"
        answer = self._ask(question)
        numbers = [float(text) for text in re.findall(r"[-+]?\d+(?:\.\d+)?", answer)]
        if len(numbers) not in (2, 3) or not all(map(isfinite, numbers)) or numbers[0] > numbers[1]:
            raise self._nonsense(question, answer)
        low, high, step = (*numbers, 1.0)[:3]
        return Range(low / DEAD_TIME_PER_S, high / DEAD_TIME_PER_S, step / DEAD_TIME_PER_S)

    def settings(self) -> dict[str, str | int | float | bool]:
        """Return product, hold-off, bias, temperature and state as read back."""
        return {
            "identity": self.identity,
            "product": self._ask("INFO:PRODUCT_NAME?"),
            "serial_number": self._ask("INFO:PRODUCT_SERIAL_NUMBER?"),
            "firmware": self._ask("INFO:FIRMWARE_VERSION?"),
            "gated": False,
            "hold_off_s": self._number("DEADTIME:TIME?") / DEAD_TIME_PER_S,
            "bias_v": self._number("BIAS:VOLTAGE?") / 1e6,
            "temperature_c": self._number("REG:MEASURED_TEMP?") / 1e3,
            "running": self._flag("REG:RUN?"),
            "bias_error": self._flag("BIAS:ERROR_STATUS?"),
            "state": self._ask("REG:STATE?"),
        }

    def _identify(self) -> None:
        identity = self._ask("*IDN?")
        if self._expected_identity not in identity:
            raise DeviceNotFoundError(
                self.name,
                f"be {self._expected_identity!r}",
                f"its identity is {identity!r}",
                "Another instrument was found: name the detector's serial number in the configuration.",
            )
        self.identity = identity

    def _take_bias(self) -> None:
        """Tell it to run no more, and raise unless it does not."""
        self._tell("REG:RUN FALSE")
        if self._flag("REG:RUN?"):
            raise RefusedError(self.name, "switch its bias off", "it reports that it still runs", BEWARE)

    def _tell(self, command: str) -> None:
        self._connected().write(command.encode("ascii") + b"\n")

    def _ask(self, question: str) -> str:
        self._tell(question)
        answer = self._connected().read(f"answer {question!r}").decode("ascii", "backslashreplace").strip()
        if not answer.isprintable():
            raise self._nonsense(question, answer)
        return answer

    def _number(self, question: str) -> float:
        answer = self._ask(question)
        try:
            value = float(answer)
        except ValueError:
            value = nan
        if not isfinite(value):
            raise self._nonsense(question, answer)
        return value

    def _flag(self, question: str) -> bool:
        answer = self._ask(question)
        if answer not in ("TRUE", "FALSE"):
            raise self._nonsense(question, answer)
        return answer == "TRUE"

    def _connected(self) -> UsbTmc:
        if self._link is None:
            raise LinkError(
                self.name, "answer", "it is not connected", "Use the detector inside its with block."
            )
        return self._link

    def _close(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            link.close()

    def _refused(self, asked: str, answered: str) -> RefusedError:
        return RefusedError(self.name, asked, answered, "Check its temperature and supply; connect again.")

    def _nonsense(self, question: str, answer: str) -> ProtocolError:
        return ProtocolError(
            self.name,
            f"answer {question!r}",
            f"{answer[:200]!r} came",
            "Check its firmware version; connect again.",
        )
