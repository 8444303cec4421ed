"""The scan plan: an immutable value that can be printed, timed and stored without hardware.

A plan is made of passes, a pass of steps. A step says where to aim and how long; a pass says what its steps
have in common and how the rig is set for them. A grid is one way to make the steps of a pass, a list of spots
another.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from rig.errors import DataFileError, RefusedError, UsageError
from rig.model.config import RigConfig
from rig.model.devices import Preparation
from rig.model.problems import in_words
from rig.model.quantities import show, show_length

#: No wall has a position farther away, and squares of what is far beyond are no numbers.
FARTHEST_M = 1e6
Coordinate = Annotated[float, Field(ge=-FARTHEST_M, le=FARTHEST_M)]
Distance = Annotated[float, Field(gt=0, le=FARTHEST_M)]
Point = tuple[Coordinate, Coordinate, Coordinate]

#: Spots of a list that are put on disk together, as those of a grid's line are.
SPOTS_OF_A_LINE = 100
#: How often a progressive order halves the pitch: it begins with every eighth position along both axes.
HALVINGS = 3
#: A mirror whose servo is linear comes to rest exponentially: a step that is larger by e takes longer by one
#: time constant. A small step is at rest after so many (to 1e-4 of it).
SETTLING_CONSTANTS = 9.2
#: More steps than this are no scan, but a slip in typing or a damaged file.
MAX_STEPS = 5_000_000
#: A scan whose frames go on until it is stopped begins with so many, and gets so many more at once at most.
FIRST_FRAMES, MORE_FRAMES = 2, 64


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Return a copy with other values, checked again, without what was computed from the old ones."""
        values = {name: getattr(self, name) for name in type(self).model_fields}
        return type(self)(**{**values, **(update or {})})


class Square(_Part):
    """A square of the wall that a grid leaves out."""

    x_m: Coordinate
    y_m: Coordinate
    side_m: Distance


class Grid(_Part):
    """A grid about the wall's origin; its lines run along x, from the bottom up."""

    kind: Literal["grid"] = "grid"
    columns: int = Field(ge=1)
    rows: int = Field(ge=1)
    spacing_m: Distance
    """Distance between neighbours along x, and along y unless `row_spacing_m` says otherwise."""
    row_spacing_m: Distance | None = None
    """Distance between lines, where a detector of many pixels sees what is between them."""
    order: Literal["snake", "unidirectional", "random", "progressive"] = "snake"
    """snake: lines alternate in direction, so that the mirror never jumps. unidirectional: all lines run to
    the right. progressive: from coarse to fine, in rounds, each of them a snake (`_rounds`)."""
    seed: int = 0
    """Seed of the random order."""
    without: tuple[Square, ...] = ()
    """What is left out, e.g. around a detector's spot, where the first bounce is much brighter than all
    else."""

    @property
    def places(self) -> int:
        """Number of positions, those that are left out among them."""
        return self.columns * self.rows

    @property
    def area_m(self) -> tuple[float, float]:
        """Distance between the outermost positions along x and y."""
        across_m = self.row_spacing_m or self.spacing_m
        return (self.columns - 1) * self.spacing_m, (self.rows - 1) * across_m

    @cached_property
    def spots_m(self) -> NDArray[np.float64]:
        """(P, 3) laser spots in the order in which they are visited."""
        return self._visited[0]

    @cached_property
    def line_of_spot(self) -> NDArray[np.int64]:
        """(P,) which line each spot belongs to, counted in the order of visits."""
        return self._visited[1]

    @property
    def skipped(self) -> int:
        """Number of grid positions left out."""
        return self.places - len(self.spots_m)

    @property
    def rounds(self) -> tuple[int, ...]:
        """Number of spots visited by the end of each round; one round, unless the order is progressive."""
        of_spot = self._visited[2]
        return tuple(
            (np.flatnonzero(np.append(of_spot[1:] != of_spot[:-1], True)) + 1)[: len(of_spot)].tolist()
        )

    @cached_property
    def _visited(self) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
        """(P, 3) spots in order, and (P,) line and round of each."""
        shape = self.rows, self.columns
        rounds = _rounds(shape) if self.order == "progressive" else np.zeros(shape, np.int64)
        rows, columns, lines = _snakes(rounds)
        if self.order == "unidirectional":
            rows, columns = (index.ravel() for index in np.indices(shape))
            lines = rows
        spots_m = np.zeros((self.places, 3))
        spots_m[:, 0] = (columns - (self.columns - 1) / 2) * self.spacing_m
        spots_m[:, 1] = (rows - (self.rows - 1) / 2) * (self.row_spacing_m or self.spacing_m)
        if self.order == "random":
            spots_m = spots_m[np.random.default_rng(self.seed).permutation(len(spots_m))]
        kept = np.ones(len(spots_m), bool)
        for square in self.without:
            away_m = np.abs(spots_m[:, :2] - (square.x_m, square.y_m)).max(axis=1)
            kept &= away_m > square.side_m / 2
        return spots_m[kept], lines[kept], rounds[rows, columns][kept]


def _rounds(shape: tuple[int, int]) -> NDArray[np.int64]:
    """Return in which round of a progressive order each position comes, (rows, columns).

    Round 0 has every eighth position along both axes. Then, in turn, a round adds the centres of the
    squares that were measured, which leaves a lattice turned by 45 degrees, and the next the centres of that
    one's squares, which leaves a square lattice of half the pitch. So each round doubles the positions, and
    after each they are evenly spread over the whole aperture.
    """
    row, column = np.indices(shape)
    rounds = np.zeros(shape, np.int64)
    stride = 1
    for number in range(2 * HALVINGS, 0, -2):
        on_lattice = (row % stride == 0) & (column % stride == 0)
        odd_row, odd_column = row // stride % 2 == 1, column // stride % 2 == 1
        rounds[on_lattice & (odd_row != odd_column)] = number
        rounds[on_lattice & odd_row & odd_column] = number - 1
        stride *= 2
    return rounds


def _snakes(rounds: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Order positions round by round, line by line, so that the mirror goes on from near where it is.

    Rounds go up and down in turn, and the lines of a round to the right and to the left.

    Parameters
    ----------
    rounds
        (rows, columns) round of each position.

    Returns
    -------
    rows, columns, lines
        (P,) place of each position in the grid, and its line, in the order of visits.
    """
    height = len(rounds)
    row, column = (index.ravel() for index in np.indices(rounds.shape))
    of_place = rounds.ravel()
    number = of_place * height + np.where(of_place % 2 == 0, row, height - 1 - row)
    numbers, line = np.unique(number, return_inverse=True)
    first = np.searchsorted(numbers, of_place * height)  # the line with which its round begins
    along = np.where((line - first) % 2 == 0, column, -column)
    order = np.lexsort((along, line))
    return row[order], column[order], line[order]


class Spots(_Part):
    """A list of spots, in the order in which they are visited."""

    kind: Literal["spots"] = "spots"
    spots: tuple[Point, ...] = Field(min_length=1)
    """Positions on the wall [m]."""

    @property
    def places(self) -> int:
        """Number of positions."""
        return len(self.spots)

    @cached_property
    def spots_m(self) -> NDArray[np.float64]:
        """(P, 3) laser spots in the order in which they are visited."""
        return np.array(self.spots, dtype=float)

    @cached_property
    def line_of_spot(self) -> NDArray[np.int64]:
        """(P,) which line each spot belongs to."""
        return np.arange(len(self.spots)) // SPOTS_OF_A_LINE


class Pass(_Part):
    """Steps that have exposure and settings in common; what is None is as the rig's state has it."""

    name: str = ""
    """What the pass is for, e.g. ``covered``."""
    positions: Annotated[Grid | Spots, Field(discriminator="kind")]
    exposure_s: float = Field(gt=0)
    """Measurement time of each step."""
    motion: Literal["step", "continuous"] = "step"
    """step: the mirror comes to rest at each position. continuous: it never stops along a line."""
    frames: int = Field(1, ge=1)
    """How often all positions are visited."""
    until_stopped: bool = False
    """Whether more frames are added when these are measured, until a person stops the scan."""
    gate_s: tuple[float, float] | None = None
    """Opening edge of the gate after the sync pulse, and its width."""
    hold_off_s: float | None = None
    """Time after a detection during which the detector stays off."""
    preparation: Preparation | None = None
    """What the person at the rig is asked to do before it."""

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.positions.spots_m) * self.frames

    def same_settings(self, other: "Pass") -> bool:
        """Return whether the rig is set alike for both."""
        names = ("gate_s", "hold_off_s", "preparation")
        return all(getattr(self, name) == getattr(other, name) for name in names)


@dataclass(frozen=True)
class Step:
    """One measurement.

    Attributes
    ----------
    index
        Its place in the plan, and in the scan file.
    spot_m
        Where the laser is sent.
    exposure_s
        How long is measured.
    pass_index
        Which pass it belongs to.
    ends_line
        Whether a line of the wall ends with it: a good moment to put data on disk.
    """

    index: int
    spot_m: Point
    exposure_s: float
    pass_index: int
    ends_line: bool


class ScanPlan(_Part):
    """Which spots are lit, in which order, for how long, and how the rig is set meanwhile."""

    passes: tuple[Pass, ...] = Field(min_length=1)

    @model_validator(mode="before")
    @classmethod
    def _from_older(cls, plan: Any) -> Any:
        return _with_passes(plan) if isinstance(plan, dict) and "columns" in plan else plan

    @model_validator(mode="after")
    def _is_possible(self) -> "ScanPlan":
        places = sum(one.positions.places * one.frames for one in self.passes)
        if places > MAX_STEPS:
            raise ValueError(f"{places:,} positions are more than the {MAX_STEPS:,} that a plan can have")
        if any(one.until_stopped for one in self.passes) and not (len(self.passes) == 1 and self.continuous):
            raise ValueError("frames without an end need a continuous scan of one pass only")
        if len({one.motion for one in self.passes}) > 1:
            raise ValueError("all passes must have the same motion: step or continuous")
        return self

    @property
    def frames(self) -> int:
        """How often all positions are visited; 1 of a plan of several passes, which differ."""
        return self.passes[0].frames if len(self.passes) == 1 else 1

    @property
    def endless(self) -> bool:
        """Whether frames go on until somebody stops the scan; as many as are planned now can be seen here."""
        return self.passes[0].until_stopped

    def longer(self, most_steps: int) -> "ScanPlan | None":
        """Return the plan with more frames: twice as many, or `MORE_FRAMES`; None where no more fit.

        Parameters
        ----------
        most_steps
            How many steps it may have.
        """
        one = self.passes[0]
        fitting = min(most_steps, MAX_STEPS) // len(one.positions.spots_m)
        frames = min(2 * one.frames, one.frames + MORE_FRAMES, fitting)
        if frames <= one.frames:
            return None
        return ScanPlan(passes=(one.model_copy(update={"frames": frames}),))

    @property
    def continuous(self) -> bool:
        """Whether the mirror never stops along a line; photons are then recorded one by one."""
        return self.passes[0].motion == "continuous"

    @classmethod
    def grid(cls, config: RigConfig, **changes: Any) -> "ScanPlan":
        """Return the configuration's scan, one pass over a grid.

        Parameters
        ----------
        config
            Names grid, exposure, and the spots of the detector, around which nothing is measured.
        changes
            ``columns``, ``rows``, ``spacing_m``, ``exposure_s``, ``skip_m``, ``order``, ``seed``, ``frames``,
            ``motion`` of the command line, where they are not None; and what else a `Pass` has.

        Raises
        ------
        UsageError
            If a value is none that a plan can have.
        """
        wanted: dict[str, Any] = {
            "columns": config.scan.columns,
            "rows": config.scan.rows,
            "spacing_m": config.scan.spacing_m,
            "row_spacing_m": config.scan.row_spacing_m,
            "exposure_s": config.scan.exposure_s,
            "skip_m": config.scan.skip_m,
        }
        wanted |= {name: value for name, value in changes.items() if value is not None}
        skip_m = wanted.pop("skip_m")
        of_grid = {name: wanted.pop(name) for name in tuple(wanted) if name in Grid.model_fields}
        spots = [channel.spot_m for channel in config.channels] if skip_m > 0 else []
        try:
            without = tuple(Square(x_m=x_m, y_m=y_m, side_m=skip_m) for x_m, y_m, _ in spots)
            return cls(passes=(Pass(positions=Grid(**of_grid, without=without), **wanted),))
        except ValidationError as error:
            raise UsageError(f"such a scan cannot be made: {_explain(error)}") from None

    @classmethod
    def from_json(cls, text: str, source: object) -> "ScanPlan":
        """Read the plan that a scan file holds, of this or of an older program.

        Raises
        ------
        DataFileError
            If it is none; ``source`` is named.
        """
        try:
            return cls.model_validate_json(text)
        except ValidationError as error:
            raise DataFileError(f"{source}: its plan cannot be read: {_explain(error)}") from None

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.spots_m)

    def require_positions(self) -> None:
        """Raise RefusedError where nothing is left to measure."""
        if not len(self):
            raise RefusedError(
                "the plan has no positions: the skipped square covers the whole grid; make skip smaller"
            )

    def steps(self, first: int = 0) -> Iterator[Step]:
        """Yield the steps from ``first`` on."""
        for index in range(first, len(self)):
            x_m, y_m, z_m = self.spots_m[index].tolist()
            yield Step(
                index,
                (x_m, y_m, z_m),
                float(self.exposures_s[index]),
                int(self.pass_of_step[index]),
                bool(self.ends_line[index]),
            )

    @cached_property
    def spots_m(self) -> NDArray[np.float64]:
        """(S, 3) laser spot of each step."""
        return np.concatenate([np.tile(one.positions.spots_m, (one.frames, 1)) for one in self.passes])

    @cached_property
    def exposures_s(self) -> NDArray[np.float64]:
        """(S,) measurement time of each step."""
        return np.repeat([one.exposure_s for one in self.passes], list(map(len, self.passes)))

    @cached_property
    def pass_of_step(self) -> NDArray[np.int64]:
        """(S,) which pass each step belongs to."""
        return np.repeat(np.arange(len(self.passes)), list(map(len, self.passes)))

    @cached_property
    def ends_line(self) -> NDArray[np.bool_]:
        """(S,) whether a line ends with each step."""
        ends = []
        for one in self.passes:
            lines = one.positions.line_of_spot
            ends += [np.append(lines[1:] != lines[:-1], True)[: len(lines)]] * one.frames
        return np.concatenate(ends)

    def range_of_pass(self, index: int) -> range:
        """Return the steps of a pass."""
        first = sum(map(len, self.passes[:index]))
        return range(first, first + len(self.passes[index]))

    @property
    def exposure_total_s(self) -> float:
        """Measurement time of the whole scan."""
        return float(sum(len(one) * one.exposure_s for one in self.passes))

    def in_words(self) -> str:
        """Return what is scanned, in a line."""
        each = [_pass_in_words(one) for one in self.passes]
        return each[0] if len(each) == 1 else f"{len(each)} passes: {'; '.join(dict.fromkeys(each))}"

    def duration_s(self, config: RigConfig) -> float:
        """Estimate how long the scan takes on hardware: exposure, settling and readout of each step."""
        settling = sum(one.frames * _settling(one.positions) for one in self.passes)
        return (
            self.exposure_total_s
            + settling * config.galvo.settle_time_s
            + len(self) * config.tcspc.readout_time_s
        )


def _pass_in_words(one: Pass) -> str:
    """Return what a pass scans, in a line."""
    where = one.positions
    if isinstance(where, Spots):
        spots = f"{len(where.spots):,} spots"
    else:
        spots = f"{where.columns} x {where.rows} positions {show_length(where.spacing_m)} apart"
        if where.row_spacing_m:
            spots += f", lines {show_length(where.row_spacing_m)}"
        if where.order != "snake":
            spots += f", {where.order}"
    told = [f"{one.name}: {spots}" if one.name else spots, f"{show(one.exposure_s, 's')} each", one.motion]
    if one.until_stopped:
        told.append("frames until stopped")
    elif one.frames > 1:
        told.append(f"{one.frames} frames")
    return ", ".join(told)


def _settling(positions: Grid | Spots) -> float:
    """Return how long the mirror takes to settle at all positions, in times of a small step."""
    spots_m = positions.spots_m
    if isinstance(positions, Spots) or len(spots_m) < 2:
        return float(len(spots_m))
    steps = np.linalg.norm(np.diff(spots_m, axis=0), axis=1) / positions.spacing_m
    return len(spots_m) + float(np.log(np.maximum(steps, 1)).sum()) / SETTLING_CONSTANTS


def _with_passes(older: dict[str, Any]) -> dict[str, Any]:
    """Return a plan of an older program, a grid with one exposure, as one pass; as it is where it is none."""
    try:
        x_m, y_m, _ = older["detector_spot_m"]
        square = {"x_m": x_m, "y_m": y_m, "side_m": older["skip_m"]}
        grid = {name: older[name] for name in ("columns", "rows", "spacing_m")}
        grid |= {"kind": "grid", "without": [square] if older["skip_m"] > 0 else []}
        return {"passes": [{"positions": grid, "exposure_s": older["exposure_s"]}]}
    except (KeyError, TypeError, ValueError):
        return older


def _explain(error: ValidationError) -> str:
    told = []
    for problem in error.errors():
        place = ".".join(map(str, problem["loc"]))
        told.append(f"{place}: {in_words(problem)}" if place else in_words(problem))
    return "; ".join(told)
