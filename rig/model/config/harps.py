"""Sections of PicoQuant's timing instruments: what a person can set of each family, and no more."""

from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from rig.model.config.timing import TcspcConfig
from rig.model.quantities import Seconds, Volts

Edge = Literal["falling", "rising"]


class HarpConfig(TcspcConfig):
    """What all of these timing instruments have."""

    library: Path | None = None
    """The vendor's library; by default the usual places are searched."""
    address: str | None = None
    """Socket of a bench from ``rig sim serve``, on which the instrument is simulated; None: a real
    instrument."""
    serial: str | None = None
    """Serial number, when several instruments are connected."""
    sync_divider: int = 1
    """Number of sync pulses that are counted as one, for lasers that are faster than its sync input."""
    bin_width_s: Seconds = Field(4e-12, gt=0)
    """Width of a bin; it must be one that the instrument has."""
    bins: int = Field(15_000, ge=1)
    """Number of bins of a histogram."""
    offset_s: Seconds = Field(28e-9, ge=0)
    """Start of the histogram after the sync pulse, whole nanoseconds."""


class HydraHarpConfig(HarpConfig):
    """A HydraHarp 400: discriminators, whose levels are those of negative pulses as positive numbers."""

    kind: Literal["hydraharp"] = "hydraharp"
    sync_divider: Literal[1, 2, 4, 8, 16] = 1
    sync_level_v: Volts = Field(0.05, ge=0)
    """Level that a sync pulse must cross."""
    sync_zero_cross_v: Volts = Field(0.01, ge=0)
    """Level of the zero crossing, which sets the time of a sync pulse."""
    input_level_v: Volts = Field(0.05, ge=0)
    """Of every input that a channel uses."""
    input_zero_cross_v: Volts = Field(0.01, ge=0)
    """The same of every input that a channel uses."""


class MultiHarpConfig(HarpConfig):
    """A MultiHarp 150 or 160: edge triggers, whose levels have their sign."""

    kind: Literal["multiharp"] = "multiharp"
    sync_divider: Literal[1, 2, 4, 8, 16] = 1
    sync_level_v: Volts = -0.05
    """Level that a sync pulse must cross."""
    sync_edge: Edge = "falling"
    """A negative pulse begins with its falling edge."""
    input_level_v: Volts = -0.05
    """Of every input that a channel uses."""
    input_edge: Edge = "falling"
    """Of every input that a channel uses."""
    bin_width_s: Seconds = Field(5e-12, gt=0)
    bins: int = Field(12_000, ge=1)


class EitherTriggerConfig(HarpConfig):
    """An instrument with edge triggers or discriminators; all levels have their sign."""

    sync_level_v: Volts = -0.05
    """Level that a sync pulse must cross."""
    sync_edge: Edge | None = None
    """Edge that triggers; None: falling, if the trigger is an edge."""
    sync_zero_cross_v: Volts | None = None
    """Level of the zero crossing; None: -10 mV, if the trigger is a discriminator."""
    input_level_v: Volts = -0.05
    """Of every input that a channel uses."""
    input_edge: Edge | None = None
    """Edge that triggers; None: falling, if the trigger is an edge."""
    input_zero_cross_v: Volts | None = None
    """Level of the zero crossing; None: -10 mV, if the trigger is a discriminator."""

    @property
    def has_cfd(self) -> bool:
        """Whether its inputs trigger by discriminators, and not by edges."""
        raise NotImplementedError

    @model_validator(mode="after")
    def _keys_are_of_its_trigger(self) -> "EitherTriggerConfig":
        alien, trigger = ("edge", "a discriminator") if self.has_cfd else ("zero_cross", "an edge trigger")
        field = alien if self.has_cfd else f"{alien}_v"
        for end in ("sync", "input"):
            if getattr(self, f"{end}_{field}") is not None:
                raise ValueError(
                    f"{end}_{alien} has no meaning for {trigger}; leave it out, or choose the other trigger"
                )
        return self


class PicoHarp330Config(EitherTriggerConfig):
    """A PicoHarp 330."""

    kind: Literal["picoharp330"] = "picoharp330"
    trigger: Literal["edge", "cfd"] = "edge"
    """Kind of trigger of the sync input and of the other inputs."""
    sync_divider: Literal[1, 2, 4, 8] = 1

    @property
    def has_cfd(self) -> bool:
        """Whether its inputs are set to trigger by discriminators."""
        return self.trigger == "cfd"


class HydraHarp500Config(EitherTriggerConfig):
    """A HydraHarp 500; the values that it accepts are not confirmed (docs/timing-instruments.md)."""

    kind: Literal["hydraharp500"] = "hydraharp500"
    trigger: Literal["edge", "cfd"] = "edge"
    """Kind of trigger of the sync input and of the other inputs."""
    sync_divider: Literal[1, 2, 4, 8, 16] = 1

    @property
    def has_cfd(self) -> bool:
        """Whether its inputs are set to trigger by discriminators."""
        return self.trigger == "cfd"


class TimeHarp260Config(EitherTriggerConfig):
    """A TimeHarp 260: the board P has discriminators and bins of 25 ps, the N edges and 250 ps."""

    kind: Literal["timeharp260"] = "timeharp260"
    board: Literal["P", "N"] = "P"
    """Which board it is."""
    sync_divider: Literal[1, 2, 4, 8] = 1
    bin_width_s: Seconds = Field(25e-12, gt=0)
    """Of the N 250 ps where nobody says."""
    bins: int = Field(2400, ge=1)
    """Of the N 240 where nobody says."""

    @property
    def has_cfd(self) -> bool:
        """Whether the board has discriminators."""
        return self.board == "P"

    @model_validator(mode="before")
    @classmethod
    def _usual_bins(cls, table: Any) -> Any:
        if not isinstance(table, dict) or table.get("board") != "N" or "bin_width_s" in table:
            return table  # what a scan file records is complete, and has the fields' own names
        return {"bin_width": "250ps", "bins": 240} | table
