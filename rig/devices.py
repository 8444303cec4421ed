"""What the application asks of its devices, stated by the consumer.

The classes in `drivers` satisfy these protocols without knowing them. Each device is a context manager that
identifies itself on entry and is left safe on exit: the laser dark, the gate closed, the mirror at rest.
"""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray


class Clock(Protocol):
    """Something that tells time and can wait."""

    def now_s(self) -> float:
        """Return a monotonic time in seconds."""
        ...

    def sleep(self, duration_s: float) -> None:
        """Wait for ``duration_s`` seconds of this clock."""
        ...


class Device(Protocol):
    """What all devices share."""

    @property
    def identity(self) -> str:
        """Maker, model, serial number and firmware as the device reports them."""
        ...

    def settings(self) -> dict[str, str | int | float | bool]:
        """Return the settings as read back from the device, or as last accepted where it has no read-back."""
        ...


class Galvo(Device, Protocol):
    """A two-axis beam-steering mirror."""

    def point(self, angle_x_rad: float, angle_y_rad: float) -> None:
        """Steer the beam to these optical angles (right and up, facing the wall), without waiting."""
        ...

    def wait_settled(self, timeout_s: float) -> None:
        """Return when the mirror is stable; raise if it is not after ``timeout_s``."""
        ...


class Laser(Device, Protocol):
    """A pulsed laser. Emission takes two steps, and never begins on connect."""

    def arm(self) -> None:
        """Take control and set the power; still dark."""
        ...

    def emit(self) -> None:
        """Begin emission; raise unless armed, and unless the read-back confirms it."""
        ...

    def stop(self) -> None:
        """End emission and disarm; safe to call at any time."""
        ...

    def emitting(self) -> bool:
        """Return what the laser itself says about its emission."""
        ...


class GatedSpad(Device, Protocol):
    """A single-photon detector with a gate locked to the laser's pulses."""

    def enable(self) -> None:
        """Bias the detector and open the configured gate on every pulse."""
        ...

    def disable(self) -> None:
        """Remove the bias; safe to call at any time."""
        ...


class Exposure(Protocol):
    """What one timed measurement gave."""

    @property
    def counts(self) -> NDArray[np.uint32]:
        """(bins,) photons a bin; valid until the next measurement."""
        ...

    @property
    def live_time_s(self) -> float:
        """Measurement time that the instrument reports."""
        ...

    @property
    def warnings(self) -> tuple[str, ...]:
        """Plain sentences about this measurement, e.g. overflow or a lost sync; empty when all is well."""
        ...


class Rates(Protocol):
    """Count rates as the timing instrument measures them, in counts a second."""

    @property
    def sync_hz(self) -> float:
        """Sync pulses."""
        ...

    @property
    def input_hz(self) -> float:
        """Photons."""
        ...


class Tcspc(Device, Protocol):
    """A time-correlated single-photon counter that makes histograms of start-stop times."""

    @property
    def bin_width_s(self) -> float:
        """The bin width that the instrument really uses."""
        ...

    @property
    def first_bin_s(self) -> float:
        """Left edge of the first bin of a histogram, after the sync pulse."""
        ...

    def measure(self, exposure_s: float) -> Exposure:
        """Clear, expose for ``exposure_s``, and return the histogram."""
        ...

    def rates(self) -> Rates:
        """Return sync and input count rates."""
        ...

    def warnings(self) -> tuple[str, ...]:
        """Return what the instrument itself warns about, as plain sentences."""
        ...
