"""Sections of point clocks."""

from typing import Literal

from pydantic import Field, model_validator

from rig.model.config.section import DeviceSection


class PointClockConfig(DeviceSection):
    """What all point clocks have."""


class DaqClockConfig(PointClockConfig):
    """A point clock: digital outputs of an NI-DAQmx board, which step the mirror and mark the points."""

    kind: Literal["daq"] = "daq"
    address: str | None = None
    """Socket of a bench from ``rig sim serve``, whose board is used; None: a real board."""
    device: str = Field("Dev1", min_length=1)
    """The board's name in NI MAX."""
    markers: tuple[str, ...] = Field(
        ("port0/line0", "port0/line1", "port0/line2", "port0/line3"), min_length=1, max_length=4
    )
    """Lines to the timing instrument's marker inputs M1, M2, M3 and M4: points, lines, frames, a spare."""
    step: str = "port0/line4"
    """Line to the mirror's trigger input; empty if the mirror has none."""
    counter: str = "ctr0"
    """The counter whose pulses clock all samples."""

    @model_validator(mode="after")
    def _lines_differ(self) -> "DaqClockConfig":
        lines = [*self.markers, self.step]
        twice = sorted({line for line in lines if line and lines.count(line) > 1})
        if twice:
            raise ValueError(f"two pulses go to {twice[0]}; give each its own line")
        return self
