"""A gated single-photon detector with the command set of the ID Quantique ID120, over USBTMC.

``*IDN?``, ``INFO:``, ``BIAS:VOLTAGE``, ``BIAS:ERROR_STATUS?`` and ``REG:`` are the ID120's own (source: a
published driver; not yet run on the hardware). No public command set of a fast-gated detector was found,
therefore the gating commands in `GATE_EXTENSION` and ``GATE:MODE`` are named by us, in the
ID120's manner.
"""

import re
from dataclasses import asdict, dataclass
from math import isfinite, nan
from types import TracebackType
from typing import Any, Self

from drivers.clock import Clock, wait_until
from drivers.errors import (
    DeviceError,
    DeviceNotFoundError,
    LimitError,
    LinkError,
    ProtocolError,
    RefusedError,
)
from drivers.leaving import leave
from drivers.lines.usb_finder import find_instrument
from drivers.lines.usbtmc import UsbTmc

ID120 = (0x1DDC, 0x0330)

BEWARE = "Treat the detector as BIASED: switch it off by hand."

#: So often the bias is taken away before the detector is said to be biased.
DISABLE_TRIES = 3


@dataclass(frozen=True)
class Quantity:
    """A setting of the gate: its commands, and how many of its units make one SI unit."""

    name: str
    command: str
    capability: str
    units_per_si: float


#: Named by us, not by ID Quantique.
GATE_EXTENSION = (
    Quantity("gate_delay_s", "GATE:DELAY", "GATE:DELAY_CAPABILITY?", 1e12),
    Quantity("gate_width_s", "GATE:WIDTH", "GATE:WIDTH_CAPABILITY?", 1e12),
    Quantity("hold_off_s", "HOLDOFF:TIME", "HOLDOFF:CAPABILITY?", 1e9),
    Quantity("excess_bias_v", "BIAS:EXCESS", "BIAS:EXCESS_CAPABILITY?", 1e3),
)


@dataclass(frozen=True, kw_only=True)
class Id120Settings:
    """Everything that is set on connecting. Which values are possible, only the instrument itself tells.

    Attributes
    ----------
    gated
        True: sensitive only inside the gate, which follows the sync input. False: free running.
    gate_delay_s, gate_width_s
        Opening edge after the sync pulse, and how long the gate stays open.
    hold_off_s
        Time after a detection during which the detector stays off.
    excess_bias_v
        Bias above breakdown.
    """

    gated: bool = True
    gate_delay_s: float = 0.0
    gate_width_s: float = 40e-9
    hold_off_s: float = 100e-9
    excess_bias_v: float = 5.0


@dataclass(frozen=True)
class Range:
    """What the instrument allows for one of its settings, in SI units."""

    low: float
    high: float
    step: float


class Id120Spad:
    """A gated detector; a context manager that leaves it without bias.

    Connecting leaves it without bias too, and sets the gate. The limits are the instrument's own, see
    `range_of`.

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
        Longest wait for one transfer.

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
        timeout_s: float = 1.0,
    ) -> None:
        self.name = f"SPAD {serial}" if serial else "SPAD"
        self.identity = ""
        self._serial = serial
        self._backend = backend
        self._clock = clock
        self._settings = settings or Id120Settings()
        self._mode = "EXT" if self._settings.gated else "FREE"
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
            self._configure()
        except BaseException as problem:
            leave([self._close, link.close], problem)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        leave([self.disable, self._close], problem)

    def enable(self) -> None:
        """Bias the detector and open the configured gate; return when both are confirmed.

        Raises
        ------
        RefusedError
            The bias did not come, or is faulty, or the gate is not as configured. The detector was disabled.
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
            mode = self._ask("GATE:MODE?")
            if mode != self._mode:
                raise self._refused(f"gate in mode {self._mode}", f"it is in mode {mode}")
        except BaseException as problem:
            leave([self.disable], problem)
            raise

    def disable(self) -> None:
        """Remove the bias and verify that it is gone; safe to call at any time.

        Raises
        ------
        RefusedError
            The detector says that it still runs.
        LinkError, ProtocolError
            It was told to go off, and whether it did cannot be known.
        """
        if self._link is None:
            return
        doubt: BaseException | None = None
        interrupted: BaseException | None = None
        for _ in range(DISABLE_TRIES):  # neither a garbled transfer nor an interrupt must leave the bias on
            try:
                self._tell("REG:RUN FALSE")
                if not self._flag("REG:RUN?"):
                    break
                doubt = RefusedError(self.name, "be without bias", "it says that it still runs", BEWARE)
            except DeviceError as problem:
                doubt = type(problem)(self.name, "be without bias", problem.answered, BEWARE)
            except BaseException as problem:
                doubt = interrupted = problem
        else:
            assert doubt is not None
            raise doubt
        if interrupted is not None:
            raise interrupted

    def set_gate(self, delay_s: float, width_s: float) -> None:
        """Move the gate: opening edge after the sync pulse, and how long it stays open.

        Raises
        ------
        LimitError
            One of them is outside the instrument's range; nothing was sent.
        RefusedError
            The instrument kept another value.
        LinkError, ProtocolError
            No answer, or none that makes sense.
        """
        self._set({"gate_delay_s": delay_s, "gate_width_s": width_s})

    def set_hold_off(self, hold_off_s: float) -> None:
        """Set the time after a detection during which the detector stays off.

        Raises
        ------
        LimitError, RefusedError, LinkError, ProtocolError
            As for `set_gate`.
        """
        self._set({"hold_off_s": hold_off_s})

    def range_of(self, setting: str) -> Range:
        """Return what the instrument allows for one of the settings in `GATE_EXTENSION`.

        Unconfirmed: the form of the answer; lowest, highest and step are taken from it in this order.

        Raises
        ------
        LinkError, ProtocolError
            No answer, or none that makes sense.
        """
        quantity = next(one for one in GATE_EXTENSION if one.name == setting)
        answer = self._ask(quantity.capability)
        numbers = [float(text) for text in re.findall(r"[-+]?\d+(?:\.\d+)?", answer)]
        if len(numbers) not in (2, 3) or not all(map(isfinite, numbers)) or numbers[0] > numbers[1]:
            raise self._nonsense(quantity.capability, answer)
        low, high, step = (*numbers, 1.0)[:3]
        unit = quantity.units_per_si
        return Range(low / unit, high / unit, step / unit)

    def settings(self) -> dict[str, str | int | float | bool]:
        """Return product, gate, hold-off, bias, temperature and state as read back."""
        settings: dict[str, str | int | float | bool] = {
            "identity": self.identity,
            "product": self._ask("INFO:PRODUCT_NAME?"),
            "serial_number": self._ask("INFO:PRODUCT_SERIAL_NUMBER?"),
            "firmware": self._ask("INFO:FIRMWARE_VERSION?"),
            "gated": self._ask("GATE:MODE?") == "EXT",
            "bias_v": self._number("BIAS:VOLTAGE?") / 1e6,
            "temperature_c": self._number("REG:MEASURED_TEMP?") / 1e3,
            "running": self._flag("REG:RUN?"),
        }
        for quantity in GATE_EXTENSION:
            settings[quantity.name] = self._number(f"{quantity.command}?") / quantity.units_per_si
        return settings

    def _identify(self) -> None:
        identity = self._ask("*IDN?")
        if self._expected_identity not in identity:
            raise DeviceNotFoundError(
                self.name,
                f"be {self._expected_identity!r}",
                f"it says {identity!r}",
                "Another instrument was found: name the detector's serial number in the configuration.",
            )
        self.identity = identity

    def _configure(self) -> None:
        """Set the gate as wanted, and verify it."""
        wanted = asdict(self._settings)
        self._set({quantity.name: wanted[quantity.name] for quantity in GATE_EXTENSION})
        self._tell(f"GATE:MODE {self._mode}")
        mode = self._ask("GATE:MODE?")
        if mode != self._mode:
            raise self._refused(f"gate in mode {self._mode}", f"it is in mode {mode}")

    def _set(self, wanted: dict[str, float]) -> None:
        """Check all values against the instrument's limits, then set and verify each."""
        quantities = [quantity for quantity in GATE_EXTENSION if quantity.name in wanted]
        ranges = [self._require_within_range(quantity, wanted[quantity.name]) for quantity in quantities]
        for quantity, allowed in zip(quantities, ranges, strict=True):
            value = round(wanted[quantity.name] * quantity.units_per_si)
            self._tell(f"{quantity.command} {value}")
            kept = self._number(f"{quantity.command}?")
            if abs(kept - value) > allowed.step * quantity.units_per_si:
                raise self._refused(f"set {quantity.command} {value}", f"it kept {kept:g}")

    def _require_within_range(self, quantity: Quantity, wanted: float) -> Range:
        """Return the instrument's range, after refusing what is outside of it."""
        allowed = self.range_of(quantity.name)
        slack = 0.5 / quantity.units_per_si  # what rounding to the wire's unit may add
        if not isfinite(wanted) or not allowed.low - slack <= wanted <= allowed.high + slack:
            raise LimitError(
                self.name,
                f"set {quantity.name} = {wanted:g}",
                f"its range is {allowed.low:g} to {allowed.high:g}",
                "It was not sent. Correct the configuration.",
            )
        return allowed

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
        return RefusedError(
            self.name, asked, answered, "Check its temperature, supply and sync cable; connect anew."
        )

    def _nonsense(self, question: str, answer: str) -> ProtocolError:
        return ProtocolError(
            self.name,
            f"answer {question!r}",
            f"{answer[:200]!r} came",
            "Check its firmware version; connect anew.",
        )
