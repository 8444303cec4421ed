"""A line for each change of what matters for safety: emission, power, bias and mirror."""

from collections.abc import Callable

from simulators.bench import Bench


class ChangeLog:
    """Tells a line ``time_s device what value`` whenever a value is another one than before.

    ::

        12.481 galvo mirror -0.012345 0.001000      optical angles x and y that are commanded [rad]
        12.502 laser power 5.00                     in the laser's own scale, 0 to 10
        12.553 laser emission 1                     0 or 1
        12.601 shutter open 1                       0 or 1; 1 where there is none
        12.655 detector bias 1                      0 or 1
        12.655 detector sensitive 1                 0 or 1; 1 where it detects: biased, and free or gated

    The positions of a trajectory, which the mirror takes by itself, are not told.

    The time is that of the bench, in seconds from when it was built. The state in which the log begins is not
    told.

    Parameters
    ----------
    bench
        What is watched.
    tell
        Takes each line, its end included.
    """

    def __init__(self, bench: Bench, tell: Callable[[str], object]) -> None:
        self._bench = bench
        self._tell = tell
        self._known = self._values()
        bench.watchers.append(self._changed)

    def _changed(self, now_s: float) -> None:
        values = self._values()
        for what, value in values.items():
            if value != self._known[what]:
                self._tell(f"{now_s:.3f} {what} {value}\n")
        self._known = values

    def _values(self) -> dict[str, str]:
        light, (x_rad, y_rad) = self._bench.light, self._bench.target_rad
        return {
            "galvo mirror": f"{x_rad:.6f} {y_rad:.6f}",
            "laser power": f"{10 * light.power:.2f}",
            "laser emission": str(int(light.emitting)),
            "shutter open": str(int(not light.shuttered)),
            "detector bias": str(int(light.biased)),
            "detector sensitive": str(int(light.sensitive)),
        }
