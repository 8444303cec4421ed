"""Where the mirror may point, known without it."""

from dataclasses import dataclass
from math import ceil, hypot, isfinite, pi, radians, tan

import numpy as np
from numpy.typing import NDArray

from drivers.errors import LimitError
from drivers.optotune.frames import AROUND
from drivers.optotune.registers import BAUD, MOST_SAMPLES, SAMPLES_A_FRAME, SAMPLING_HZ

#: One unit of X or Y is this tangent of the optical angle: the unit circle is 50 degrees.
TAN_PER_UNIT = tan(radians(50.0))

#: Bits on the line for each byte: 8, a start and a stop bit.
BITS_A_BYTE = 10
#: A command that sets or asks for samples says in so many bytes which; a sample has 4.
PLACE_BYTES, SAMPLE_BYTES = 5, 4


@dataclass(frozen=True)
class OptotuneLimits:
    """Where the beam may be steered to; can be asked without a mirror.

    Attributes
    ----------
    max_angle_rad
        Largest optical deflection to either side, for x and y.
    device
        Whose limits these are, for messages.
    memory_samples
        What the board's memory of patterns holds, both axes together (unconfirmed: as many as its commands
        can reach).
    """

    max_angle_rad: tuple[float, float] = (0.36, 0.28)
    device: str = "steering mirror"
    memory_samples: int = MOST_SAMPLES

    @property
    def longest_trajectory(self) -> int:
        """How many positions a trajectory has at most; the last is held twice in memory, in each axis."""
        return self.memory_samples // 2 - 1

    def loading_s(self, positions: int) -> float:
        """Estimate how long it takes to load a trajectory and to read it back, at the line's speed.

        Frames there and back, without what is escaped. Over USB, where the line has no speed of its own, it
        takes less, or as much where an exchange takes a millisecond more.
        """
        samples = 2 * (positions + 1)
        frames = ceil(samples / SAMPLES_A_FRAME)
        sent_and_read = frames * (4 * AROUND + 2 * PLACE_BYTES) + 2 * SAMPLE_BYTES * samples
        return sent_and_read * BITS_A_BYTE / BAUD

    def check(self, angle_x_rad: float, angle_y_rad: float) -> None:
        """Raise `LimitError` unless the beam may be steered to these optical angles."""
        self.units(angle_x_rad, angle_y_rad)

    def units(self, angle_x_rad: float, angle_y_rad: float) -> tuple[float, float]:
        """Return optical angles in the board's units: X and Y within the unit circle.

        Raises
        ------
        LimitError
            If they are outside the largest deflections, or outside the unit circle.
        """
        angles = (angle_x_rad, angle_y_rad)
        for axis, angle, limit in zip("xy", angles, self.max_angle_rad, strict=True):
            if not isfinite(angle) or abs(angle) > min(limit, pi / 2):
                raise LimitError(
                    self.device,
                    f"point {axis} to {angle:.4f} rad",
                    f"the limit is {limit:.4f} rad to either side",
                    "Nothing was sent. Choose a smaller grid, or change the limit.",
                )
        # Adding zero turns -0.0 into 0.0, so that the wire never carries "-0.000000000".
        x, y = (round(tan(angle) / TAN_PER_UNIT, 9) + 0.0 for angle in angles)
        if hypot(x, y) > 1.0:
            raise LimitError(
                self.device,
                f"point to ({angle_x_rad:.4f}, {angle_y_rad:.4f}) rad",
                f"that is {hypot(x, y):.3f} times the mirror's range",
                "Nothing was sent. Choose a smaller grid.",
            )
        return x, y

    def trajectory_units(self, angles_rad: NDArray[np.float64], tick_s: float) -> NDArray[np.float64]:
        """Return (n, 2) positions in the board's units.

        Raises
        ------
        LimitError
            If any is outside, there is none, there are more than the memory holds, or ticks come too fast.
        """
        asked = f"follow {len(angles_rad)} positions, one every {tick_s:g} s"
        if not 0 < len(angles_rad) <= self.longest_trajectory:
            raise LimitError(
                self.device,
                asked,
                f"its memory holds from 1 to {self.longest_trajectory}",
                "Nothing was sent. Load the scan in parts.",
            )
        if not tick_s * SAMPLING_HZ >= 2:
            raise LimitError(
                self.device,
                asked,
                f"it reads its trigger input every {1 / SAMPLING_HZ:g} s, and needs two readings for a tick",
                "Nothing was sent. Choose a longer exposure.",
            )
        return np.array([self.units(x_rad, y_rad) for x_rad, y_rad in angles_rad.tolist()])
