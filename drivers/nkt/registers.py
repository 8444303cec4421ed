"""Registers of the SuperK mainboards, and what their numbers mean.

Source: the vendor's SDK manual and register files 60 and 88, as published drivers quote them (nkt-tools,
msl-equipment, golaborate). Not yet run on the hardware.
"""

from dataclasses import dataclass

#: Address of the mainboard.
MAINBOARD = 0x0F

EMISSION = 0x30
"""U8: 0 is off, 3 is on."""
SETUP = 0x31
"""The operating mode."""
INTERLOCK = 0x32
"""Low byte: 0 open, 1 waiting for a reset, 2 closed; high byte: where it is open."""
PULSE_PICKER = 0x34
"""Every how many pulses of the oscillator one leaves; below 256 one byte is read, else two."""
WATCHDOG = 0x36
"""U8: after so many seconds without communication emission ends; 0 is never."""
TYPE = 0x61
SERIAL = 0x65
"""Text."""
STATUS = 0x66
"""Bit 0: emission is on."""

EMISSION_ON = 3
INTERLOCK_CLOSED = 2
INTERLOCK_WAITS = 1
STATUS_EMISSION = 1

#: Where an interlock is open, by the high byte of its register.
OPEN_AT = {
    0: "interlock circuit",
    1: "front panel or key switch",
    2: "door switch",
    3: "external module",
    4: "application",
    5: "internal module",
    6: "power failure",
    7: "disabled by the light source",
    255: "failure of the circuit",
}


@dataclass(frozen=True)
class Mainboard:
    """One type of mainboard.

    Attributes
    ----------
    model
        For people.
    modes
        Name and level register of each operating mode in which the level is set by its register, in 0.1 %.
    """

    model: str
    modes: dict[int, tuple[str, int]]


MAINBOARDS = {
    0x60: Mainboard(
        "SuperK EXTREME or FIANIUM", {0: ("constant current", 0x38), 1: ("constant power", 0x37)}
    ),
    0x88: Mainboard("SuperK FIANIUM", {0: ("internal power", 0x37)}),
}
