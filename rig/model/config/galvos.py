"""Sections of beam-steering mirrors."""

from math import degrees, pi
from typing import Literal

from pydantic import Field, model_validator

from rig.model.config.section import DeviceSection, Point
from rig.model.quantities import Metres, Radians, Seconds


class GalvoConfig(DeviceSection):
    """What all beam-steering mirrors have."""

    address: str | None = None
    """Its address; None if its driver finds it."""
    position_m: Point = (-0.15, 0.0, 2.5)
    """Position of the mirror from which the beam leaves; at rest it sends the beam at right angles to the
    wall."""
    mirrors: Literal[1, 2] = 1
    """1: one mirror that turns about both axes. 2: a galvanometer pair."""
    incidence_rad: Radians = Field(0.0, ge=0, lt=pi / 2)
    """Angle between the incoming beam and the normal of one mirror at rest."""
    incidence_direction_rad: Radians = 0.0
    """Direction that this beam comes from, turned from x towards y: for a person who faces the wall, 0 is
    the right, 90 degrees is above."""
    separation_m: Metres = Field(0.0, ge=0)
    """Distance between the mirrors of a pair."""
    max_angle_x_rad: Radians = Field(0.436332312998582, gt=0)  # 25 degrees
    """Largest optical angle to either side."""
    max_angle_y_rad: Radians = Field(0.349065850398866, gt=0)  # 20 degrees
    """Largest optical angle up or down."""
    beam_dump_rad: tuple[Radians, Radians] | None = None
    """Optical angles of a beam dump, to which the mirror goes when the laser cannot be made dark."""
    settle_timeout_s: Seconds = Field(0.1, gt=0)
    """Longest wait for the mirror to be stable after a move."""
    settle_time_s: Seconds = Field(0.006, ge=0)
    """Usual time to settle after a small step; used only to estimate how long a scan takes."""
    turn_time_s: Seconds = Field(0.008, gt=0)
    """Continuous scans: time in which the mirror turns around at the end of a line."""
    lag_s: Seconds = Field(0.8e-3, ge=0)
    """Continuous scans: by how much the mirror trails its command; a calibrated value replaces it."""


class OptotuneConfig(GalvoConfig):
    """An Optotune MR-15-30 steering mirror, or another one behind the same electronics."""

    needs_address = True

    kind: Literal["optotune"] = "optotune"
    address: str | None = None
    """Serial port or pyserial URL."""
    serial: str | None = None
    """The board's serial number, or another part of its identity text, when there are several boards."""
    turn_time_s: Seconds = Field(0.004, gt=0)
    """Continuous scans: time in which the mirror turns around at the end of a line. At 1 cm a millisecond
    on a wall at 2.5 m, 4 rad/s, 4 ms take 3000 rad/s^2 of optical angle at most
    (`rig.model.sweep.HARDEST_TURN`). The full range of 50 degrees to either side at 20 Hz, which is the
    mirror's bandwidth for it, takes 13800. Much faster lines need longer turns."""


class AnalogueGalvoConfig(GalvoConfig):
    """A galvanometer pair that follows two voltages of an NI-DAQmx board, such as Thorlabs GVS012."""

    kind: Literal["analogue"] = "analogue"
    address: str | None = None
    """Socket of a bench from ``rig sim serve``, whose board is used; None: a real board."""
    device: str = Field("Dev1", min_length=1)
    """The board's name in NI MAX; the same as the point clock's, if both must work together."""
    channels: tuple[str, str] = ("ao0", "ao1")
    """The board's analogue outputs for x and y."""
    volts_per_degree: tuple[float, float] = (0.5, 0.5)
    """Volts for each degree by which a mirror turns, for x and y; the beam turns twice that. Negative if
    an axis is mounted the other way around."""
    mirrors: Literal[1, 2] = 2
    settle_time_s: Seconds = Field(0.001, ge=0)
    """Waiting time after a small step; the mirror cannot report that it has settled."""
    settle_time_full_s: Seconds = Field(0.02, ge=0)
    """Waiting time after a step from one end of the range to the other."""
    turn_time_s: Seconds = Field(0.003, gt=0)
    """Continuous scans: time in which the mirror turns around at the end of a line."""
    lag_s: Seconds = Field(0.13e-3, ge=0)
    """Continuous scans: by how much the mirror trails its command."""

    @model_validator(mode="after")
    def _within_the_range(self) -> "AnalogueGalvoConfig":
        if self.channels[0] == self.channels[1]:
            raise ValueError(f"channels: x and y are both {self.channels[0]}; give each its own")
        for axis, scale in zip("xy", self.volts_per_degree, strict=True):
            volts = degrees(getattr(self, f"max_angle_{axis}_rad") / 2) * abs(scale)
            if not 0 < volts <= 10 * (1 + 1e-9):  # 40 degrees at 0.5 V are just allowed
                raise ValueError(
                    f"max_angle_{axis} is {volts:.3g} V at volts_per_degree {scale:g}, and must be above "
                    "0 V and at most 10 V. Lower the angle, or give the scale that is set at the servo board"
                )
        return self
