"""What a person says of a file that does not say all, and whether it was of any use."""

from math import inf
from pathlib import Path
from typing import Any, TypedDict, Unpack

from rig.errors import UsageError

#: Each option's spelling on the command line.
SPELLING = {
    "bin_width_s": "--bin-width",
    "wall_size_m": "--wall-size",
    "depth_pitch_m": "--depth-pitch",
    "time_origin": "--time-origin",
    "fade_from_s": "--fade-from",
    "delays": "--tof",
    "bounces": "--bounces",
    "grid": "--grid",
    "spacing_m": "--spacing",
    "order": "--order",
    "snake": "--snake",
    "detector": "--detector",
    "places": "--places",
    "point_marker": "--point-marker",
    "line_marker": "--line-marker",
    "time_zero_s": "--time-zero",
    "input": "--input",
}
#: What tells the plan of a scan whose file holds photons and markers alone.
OF_PLAN = (
    "grid",
    "spacing_m",
    "order",
    "snake",
    "detector",
    "places",
    "point_marker",
    "line_marker",
    "input",
)
_POSITIVE = ("bin_width_s", "wall_size_m", "depth_pitch_m", "spacing_m")


class Given(TypedDict, total=False):
    """What may be said of a file; None, or left out, leaves it to the file.

    Attributes
    ----------
    bin_width_s
        Width of a bin.
    wall_size_m
        Side of the scanned square, from its first to its last spot.
    depth_pitch_m
        Length of one depth index of the wall's spots.
    time_origin
        ``wall`` or ``laser``.
    fade_from_s
        Rectified time before which the record holds the wall's own light.
    delays
        File with the time of flight to each position.
    bounces
        Which entries of a bounce axis to add up, counted from one.
    grid
        Columns and rows of the scan, where the file holds photons and markers alone.
    spacing_m
        From one spot of that grid to the next.
    order
        Axis along a line, then from line to line, e.g. ``x,-y``.
    snake
        Whether every other line runs backwards.
    detector
        ``confocal``, or x and y of the detector's spot.
    places
        Scan file with the same plan, in place of a grid.
    point_marker, line_marker
        Marker (1 to 4) at which a point, and a line, begins.
    time_zero_s
        When the pulse is on the wall, in the instrument's time.
    input
        Which input of the instrument is imaged, from 0.
    """

    bin_width_s: float | None
    wall_size_m: float | None
    depth_pitch_m: float | None
    time_origin: str | None
    fade_from_s: float | None
    delays: str | Path | None
    bounces: tuple[int, ...] | None
    grid: tuple[int, int] | None
    spacing_m: float | None
    order: str | None
    snake: bool | None
    detector: str | tuple[float, float] | None
    places: str | Path | None
    point_marker: int | None
    line_marker: int | None
    time_zero_s: float | None
    input: int | None


class Options:
    """What was given. It remembers what an importer took, so that nothing given is without effect unseen.

    Raises
    ------
    UsageError
        If a value is none that its option can have.
    """

    def __init__(self, **given: Unpack[Given]) -> None:
        self._given: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
        self._taken: set[str] = set()
        for name in _POSITIVE:
            if name in self._given:
                positive(self._given[name], SPELLING[name])
        if self._given.get("time_origin", "wall") not in {"wall", "laser"}:
            raise UsageError(f"--time-origin must be wall or laser, not '{self._given['time_origin']}'")

    def optional(self, name: str) -> Any:
        """Take what was given under this name; None where nothing was."""
        self._taken.add(name)
        return self._given.get(name)

    def asked(self, name: str, path: object, what: str, hint: str = "") -> Any:
        """Take what only a person can know.

        Parameters
        ----------
        name
            The option.
        path, what
            The file, and what it does not say.
        hint
            What is known of published files, in words.

        Raises
        ------
        UsageError
            If it was not given; it names the option.
        """
        value = self.optional(name)
        if value is None:
            raise UsageError(
                f"{path} does not contain {what}; give it with {SPELLING[name]}{hint and f' ({hint})'}"
            )
        return value

    def not_taken(self) -> dict[str, Any]:
        """Return what was given and not taken, by name."""
        return {name: value for name, value in self._given.items() if name not in self._taken}


def positive(value: float, name: str) -> float:
    """Return a value; raise UsageError, by its name, unless it is a positive number."""
    if not 0 < value < inf:
        raise UsageError(f"{name} must be positive, not {value}")
    return value
