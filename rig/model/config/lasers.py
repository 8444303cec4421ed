"""Sections of lasers."""

from typing import Literal

from pydantic import Field, model_validator

from rig.model.config.section import DeviceSection, require_ceiling
from rig.model.quantities import Hertz, Watts


class LaserConfig(DeviceSection):
    """What all lasers have."""

    address: str | None = None
    """Its address; None if its driver finds it."""
    repetition_hz: Hertz = Field(10e6, gt=0)
    """Pulses a second."""

    @property
    def fraction_of_full(self) -> float:
        """The power as a fraction of the laser's full power; 1 where it cannot be set."""
        return 1.0

    @property
    def power_in_words(self) -> str:
        """The power, for people."""
        return "full power"


class ExternalLaserConfig(LaserConfig):
    """A laser without a data interface: a person switches it, or a shutter does."""

    kind: Literal["external"] = "external"
    model: str = "laser"
    """Name of the product, for people to read."""
    power: str = "as set by hand"
    """Its power, for people to read."""

    @property
    def fraction_of_full(self) -> float:
        """The power as a fraction of the laser's full power, which nobody knows here."""
        return 1.0

    @property
    def power_in_words(self) -> str:
        """The power, for people."""
        return f"power {self.power}"


class KatanaConfig(LaserConfig):
    """A Onefive/NKT Katana 05, green, whose power has a scale of its own."""

    needs_address = True

    kind: Literal["katana"] = "katana"
    address: str | None = None
    """Serial port or pyserial URL."""
    power_setpoint: float = Field(0.0, ge=0, le=10)
    """Power setting on the laser's own scale, 0 to 10."""
    max_power_setpoint: float = Field(10.0, ge=0, le=10)
    """The rig's own upper limit of the power setting; a scan with more is refused."""
    repetition_hz: Hertz = Field(10e6, gt=0)
    """Pulses a second."""
    trigger: Literal["internal", "external"] = "internal"
    """What makes the pulses."""

    @model_validator(mode="after")
    def _below_the_ceiling(self) -> "KatanaConfig":
        require_ceiling("power_setpoint", self.power_setpoint, self.max_power_setpoint)
        return self

    @property
    def fraction_of_full(self) -> float:
        """The power as a fraction of the laser's full power."""
        return self.power_setpoint / 10

    @property
    def power_in_words(self) -> str:
        """The power, for people."""
        return f"power {self.power_setpoint:g} of 10"


class Katana08Config(LaserConfig):
    """A Onefive/NKT Katana 08HP, 775 nm, whose power is in watt."""

    needs_address = True

    kind: Literal["katana-08hp"] = "katana-08hp"
    address: str | None = None
    """Serial port or pyserial URL."""
    power_w: Watts = Field(0.0, ge=0, le=3.1)
    """Power; published drivers ask for 3.1 W at most."""
    max_power_w: Watts = Field(3.1, ge=0, le=3.1)
    """The rig's own upper limit of the power; a scan with more is refused."""
    repetition_hz: Hertz = Field(18e6, ge=18e6, le=80e6)
    """Pulses a second."""
    trigger: Literal["internal", "level", "ttl"] = "internal"
    """What makes the pulses: the laser, a level at Tr-1, or TTL at Tr-2."""

    @model_validator(mode="after")
    def _below_the_ceiling(self) -> "Katana08Config":
        require_ceiling("power", self.power_w, self.max_power_w)
        return self

    @property
    def fraction_of_full(self) -> float:
        """The power as a fraction of the laser's full power."""
        return self.power_w / 3.1

    @property
    def power_in_words(self) -> str:
        """The power, for people."""
        return f"power {self.power_w:g} W"


#: A pulse picker lets every 65535th pulse out at the most: its register has 16 bits.
_MOST_PICKED = 65535


class NktConfig(LaserConfig):
    """An NKT Photonics SuperK laser with a pulse picker, whose level is in percent."""

    needs_address = True

    kind: Literal["nkt"] = "nkt"
    address: str | None = None
    """Serial port or pyserial URL."""
    level_percent: float = Field(0.0, ge=0, le=100)
    """Level, in percent of full power or of full current, depending on the laser's mode."""
    max_level_percent: float = Field(100.0, ge=0, le=100)
    """The rig's own upper limit of the level; a scan with more is refused."""
    oscillator_hz: Hertz = Field(80e6, gt=0)
    """Pulses a second at the input of the pulse picker: see the laser's label."""
    repetition_hz: Hertz = Field(10e6, gt=0)
    """Pulses a second at the output of the pulse picker: the oscillator's rate divided by a whole number."""

    @model_validator(mode="after")
    def _possible(self) -> "NktConfig":
        require_ceiling("level_percent", self.level_percent, self.max_level_percent)
        picked = max(1, round(min(self.oscillator_hz / self.repetition_hz, _MOST_PICKED)))
        nearest_hz = self.oscillator_hz / picked
        if abs(nearest_hz - self.repetition_hz) > 1e-3 * self.repetition_hz:
            raise ValueError(
                f"repetition {self.repetition_hz / 1e6:g} MHz is not the oscillator's "
                f"{self.oscillator_hz / 1e6:g} MHz by a whole number; the nearest is "
                f"{nearest_hz / 1e6:.6g} MHz, every {picked}th pulse"
            )
        return self

    @property
    def fraction_of_full(self) -> float:
        """The power as a fraction of the laser's full power."""
        return self.level_percent / 100

    @property
    def power_in_words(self) -> str:
        """The power, for people."""
        return f"level {self.level_percent:g} %"
