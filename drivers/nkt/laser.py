"""NKT Photonics SuperK EXTREME and FIANIUM lasers with a pulse picker, on their serial line.

Source: `drivers.nkt.registers`; not yet run on the hardware. UNCONFIRMED: that any question counts for the
watchdog, and what bit 0 of the status says while emission begins. The filter behind such a laser (VARIA,
SELECT) is set with the vendor's program.
"""

from contextlib import suppress
from functools import partial

from drivers.clock import Clock
from drivers.errors import DeviceError, DeviceNotFoundError, RefusedError
from drivers.leaving import leave
from drivers.nkt import registers
from drivers.nkt.bus import NktBus
from drivers.nkt.registers import MAINBOARDS, Mainboard
from drivers.nkt.settings import NktSettings
from drivers.two_step import TwoStepLaser

#: After so long without a question the laser ends emission by itself: the computer is gone. It is asked five
#: times a second while it emits.
WATCHDOG_S = 5


class NktLaser(TwoStepLaser):
    """A SuperK laser; a context manager that leaves it dark.

    Its interlock is asked, and never reset: that is for a person who has looked at the beam's way. While it
    emits the laser itself watches that it is asked, and goes dark when the computer is gone.

    Parameters
    ----------
    address
        Serial address, e.g. ``/dev/ttyUSB0``.
    clock
        The time to wait by.
    settings
        What it is set to when it is armed.
    emission_timeout_s
        Longest wait for the laser to confirm that it emits.
    timeout_s
        Longest wait for one answer.

    Attributes
    ----------
    identity
        Model and serial number.
    """

    def __init__(
        self,
        address: str,
        *,
        clock: Clock,
        settings: NktSettings,
        emission_timeout_s: float = 10.0,
        timeout_s: float = 0.2,
    ) -> None:
        self._bus = NktBus(address, clock=clock, timeout_s=timeout_s)
        super().__init__(self._bus.name, clock=clock, emission_timeout_s=emission_timeout_s)
        self._settings = settings
        self._board = MAINBOARDS[0x60]
        self._has_picker = True
        self._watchdog_found_s: int | None = None

    def settings(self) -> dict[str, str | int | float | bool]:
        """Return identity, level, mode, repetition rate, watchdog, interlock and emission as read back."""
        self._require_connection()
        mode, level = self._mode()
        picked = self._bus.read(registers.PULSE_PICKER) if self._has_picker else 1
        return {
            "identity": self.identity,
            "level_percent": self._bus.read(level) / 10,
            "mode": mode,
            "repetition_hz": self._settings.oscillator_hz / max(picked, 1),
            "watchdog_s": self._bus.read(registers.WATCHDOG),
            "interlock": self._interlock() or "closed",
            "emitting": self.emitting(),
        }

    def _open(self) -> None:
        self._bus.open()

    def _close(self) -> None:
        self._bus.close()

    def _recognise(self) -> None:
        self._board = self._found_board()
        try:
            self._has_picker = bool(self._bus.read(registers.PULSE_PICKER))
        except RefusedError:
            self._has_picker = False
        number = b""
        with suppress(RefusedError):  # some boards keep none
            number = self._bus.read_bytes(registers.SERIAL)
        printable = "".join(one for one in number.decode("ascii", "replace") if one.isprintable())
        self.identity = " ".join(["NKT", self._board.model, printable]).strip()

    def _found_board(self) -> Mainboard:
        asked = "answer like a SuperK laser"
        try:
            kind = self._bus.read(registers.TYPE)
        except DeviceError as problem:
            raise DeviceNotFoundError(
                self.name,
                asked,
                problem.answered,
                f"{problem.remedy} Perhaps another device is at this address.",
            ) from None
        if kind not in MAINBOARDS:
            known = " or ".join(f"{one:02X}" for one in MAINBOARDS)
            raise DeviceNotFoundError(
                self.name,
                asked,
                f"the module at this address has the type {kind:02X}, not {known}",
                "Check the address.",
            )
        return MAINBOARDS[kind]

    def _prepare(self) -> None:
        """Check the interlock, then set watchdog, pulse picker and level."""
        if interlock := self._interlock():
            raise RefusedError(
                self.name,
                "be ready to emit",
                f"its interlock {interlock}",
                "Make sure that nobody is in the path of the beam, then close the interlock and reset it "
                "at the laser.",
            )
        _, level = self._mode()
        if self._watchdog_found_s is None:
            self._watchdog_found_s = self._bus.read(registers.WATCHDOG)
        self._bus.set(registers.WATCHDOG, WATCHDOG_S)
        self._pick()
        self._bus.set(level, round(self._settings.level_percent * 10), size=2)

    def _pick(self) -> None:
        picked = self._settings.picked
        if self._has_picker:
            self._bus.set(registers.PULSE_PICKER, picked, size=2)
        elif picked != 1:
            raise RefusedError(
                self.name,
                f"let every {picked}th pulse out",
                "it has no pulse picker",
                "Configure the oscillator's rate as repetition rate.",
            )

    def _mode(self) -> tuple[str, int]:
        """Return the operating mode's name, and the register of its level."""
        mode = self._bus.read(registers.SETUP)
        if mode not in self._board.modes:
            known = " or ".join(name for name, _ in self._board.modes.values())
            raise RefusedError(
                self.name,
                "let the computer set its level",
                f"it is in mode {mode}, where something else sets it",
                f"Set it to {known} with the vendor's program.",
            )
        return self._board.modes[mode]

    def _interlock(self) -> str:
        """Return why the interlock is not closed; empty if it is."""
        where, state = divmod(self._bus.read(registers.INTERLOCK), 256)
        if state == registers.INTERLOCK_CLOSED:
            return ""
        if state == registers.INTERLOCK_WAITS:
            return "waits for its reset"
        return f"is open: {registers.OPEN_AT.get(where, f'place {where}')}"

    def _give_back(self) -> None:
        """Give the watchdog back as it was found: who lights the laser at its panel asks it nothing."""
        if self._watchdog_found_s is not None:
            self._bus.set(registers.WATCHDOG, self._watchdog_found_s)
            self._watchdog_found_s = None

    def _switch(self, on: bool) -> None:
        if on:  # once: light must not come by a second order, when it may no longer be wanted
            self._bus.write(registers.EMISSION, registers.EMISSION_ON, tries=1)
        else:
            self._bus.write(registers.EMISSION, 0)

    def _says_emitting(self) -> bool:
        """Ask the emission register and the status; both have to say that there is no light.

        Each question has its own return address, so that no late answer to another one is taken for its own.
        """
        register, status = self._bus.read(registers.EMISSION), self._bus.read(registers.STATUS)
        return bool(register or status & registers.STATUS_EMISSION)

    def _says_lit(self) -> bool:
        register, status = self._bus.read(registers.EMISSION), self._bus.read(registers.STATUS)
        return register == registers.EMISSION_ON and bool(status & registers.STATUS_EMISSION)

    def _lower_power(self) -> None:
        levels = {level for _, level in self._board.modes.values()}
        leave([partial(self._bus.set, level, 0, size=2) for level in sorted(levels)], None)
