"""How a hidden scene moves: all of it together, on a straight line at constant speed, back and forth."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil, floor, hypot

from simulators.transport.light_paths import Spot

#: Distance between the positions that are drawn [m]. The scene is at most half of it away from where it
#: should be, and light goes there and back: 0.5 mm of path, 1.7 ps, far inside the system's 65 ps.
STEP_M = 5e-4


@dataclass(frozen=True)
class BackAndForth:
    """A way from one end to the other and back, again and again; it begins at its first end.

    Attributes
    ----------
    travel_m
        From the first end to the last [m]; the middle is where the scene stands without motion.
    duration_s
        Time from one end to the other [s].

    Raises
    ------
    ValueError
        If it takes no time.
    """

    travel_m: Spot
    duration_s: float

    def __post_init__(self) -> None:
        if not self.duration_s > 0:
            raise ValueError(f"a motion takes time, not {self.duration_s} s")

    @property
    def steps(self) -> int:
        """Positions on the way, one end counted."""
        return max(1, ceil(hypot(*self.travel_m) / STEP_M))

    def step_at(self, at_s: float) -> int:
        """Return the nearest of the positions at a bench time [s], from 0 to `steps`."""
        turns = at_s / self.duration_s
        way = turns - 2 * floor(turns / 2)
        return round((way if way <= 1 else 2 - way) * self.steps)

    def offset_m(self, step: int) -> Spot:
        """Return by how much the scene is moved at a position [m]."""
        part = step / self.steps - 0.5
        x_m, y_m, z_m = self.travel_m
        return part * x_m, part * y_m, part * z_m

    def pieces(self, begin_s: float, duration_s: float) -> Iterator[tuple[int, float]]:
        """Cut a time into (position, duration [s]) in which the scene hardly moves, in order."""
        number = max(1, ceil(duration_s / self.duration_s * self.steps))
        for index in range(number):
            yield self.step_at(begin_s + (index + 0.5) / number * duration_s), duration_s / number
