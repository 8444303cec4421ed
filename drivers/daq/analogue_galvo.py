"""A pair of galvanometer mirrors that follow two voltages of a DAQ board, such as Thorlabs GVS011 or GVS012.

Source: Thorlabs' page of the GVS011: +-10 V, 0.5, 0.8 or 1.0 V for each mechanical degree, 0.4 ms to settle
after 0.2 degrees, 25 full strokes a second. Not yet run with one.

Such a galvo has no data interface: nobody can ask where it is. So it is waited for as long as it takes by its
specification, and where it is said to be is where it was sent.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import isfinite
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.daq.board import SharedBoard
from drivers.daq.point_clock import SAMPLES_PER_TICK
from drivers.errors import LimitError, LinkError, RefusedError
from drivers.leaving import leave

#: A board's outputs give at most this to either side [V].
LARGEST_V = 10.0


@dataclass(frozen=True)
class AnalogueLimits:
    """Where the beam may be steered to, and by which voltages; can be asked without a board.

    Attributes
    ----------
    max_angle_rad
        Largest optical deflection to either side, for x and y.
    volts_per_degree
        Volts for each degree by which a mirror turns, for x and y; the beam turns by twice that. Below zero
        where the axis is mounted the other way round.
    device
        Whose limits these are, for messages.
    """

    max_angle_rad: tuple[float, float] = (0.36, 0.28)
    volts_per_degree: tuple[float, float] = (0.5, 0.5)
    device: str = "analogue galvo"

    def volts(self, angles_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the voltages (..., 2) of optical angles (..., 2).

        Raises
        ------
        LimitError
            If one is outside the largest deflections, or beyond what a board's output gives.
        """
        beyond = ~(np.abs(angles_rad) <= self.max_angle_rad)  # also what is no number
        if beyond.any():
            axis = int(np.argwhere(beyond)[0][-1])
            raise LimitError(
                self.device,
                f"point {'xy'[axis]} to {angles_rad[beyond][0]:.4f} rad",
                f"the limit is {self.max_angle_rad[axis]:.4f} rad to either side",
                "Nothing was sent. Choose a smaller grid, or change the limit.",
            )
        volts: NDArray[np.float64] = np.degrees(angles_rad / 2) * self.volts_per_degree
        if (np.abs(volts) > LARGEST_V * (1 + 1e-9)).any():
            raise LimitError(
                self.device,
                f"point by {np.abs(volts).max():.2f} V",
                f"its input accepts {LARGEST_V:g} V to either side",
                "Nothing was sent. Choose a smaller grid, or another scale at the galvo's servo boards.",
            )
        return np.clip(volts, -LARGEST_V, LARGEST_V)  # what rounding put beyond


@dataclass(frozen=True)
class Settling:
    """How long the mirrors take to come to rest.

    Attributes
    ----------
    small_s
        After a small step.
    full_s
        After a step from one end of the range to the other; between these two it grows with the step.
    """

    small_s: float = 1e-3
    full_s: float = 20e-3


class AnalogueGalvo:
    """Two mirrors on two analogue channels; a context manager that leaves them at rest in the middle.

    Parameters
    ----------
    board
        The board, maybe shared with the point clock.
    channels
        Its analogue channels for x and y, e.g. ``ao0`` and ``ao1``.
    clock
        The time to wait by.
    limits
        A position outside is refused unsent.
    settling
        How long it is waited for.

    Attributes
    ----------
    limits
        As given.
    identity
        The board's model and serial number, and the scale.
    longest_trajectory
        How many positions a trajectory has at most.
    """

    def __init__(
        self,
        board: SharedBoard,
        channels: tuple[str, str],
        *,
        clock: Clock,
        limits: AnalogueLimits | None = None,
        settling: Settling | None = None,
    ) -> None:
        self.limits = replace(limits or AnalogueLimits(), device=f"analogue galvo on {board.name}")
        self.identity = ""
        self.longest_trajectory = board.most_samples // SAMPLES_PER_TICK
        self._board = board
        self._channels = channels
        self._clock = clock
        self._settling = settling or Settling()
        self._open = False
        self._fastest_hz = 0.0
        self._target_rad = (0.0, 0.0)
        self._may_be_anywhere = True  # before the first move, and while a trajectory is followed
        self._settled_s = 0.0

    def __enter__(self) -> Self:
        x, y = self.limits.volts_per_degree
        self.identity = f"analogue galvo, {x:g} and {y:g} V per degree, on {self._board.identity()}"
        self._fastest_hz = self._board.fastest_hz(analogue=True)
        self._open, self._may_be_anywhere = True, True
        try:
            self.point(0.0, 0.0)
        except BaseException as problem:
            self._open = False
            leave([self._board.let_go_of_volts], problem)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        # After a failure the mirror stays where it is: what failed may be what puts the light out.
        rest = [] if problem is not None else [lambda: self.point(0.0, 0.0)]
        leave([*rest, self._board.let_go_of_volts], problem)
        self._open = False

    def point(self, angle_x_rad: float, angle_y_rad: float) -> None:
        """Steer the beam to these optical angles (right and up, facing the wall), without waiting.

        Raises
        ------
        LimitError
            The position is outside the limits; nothing was sent.
        LinkError, RefusedError
            The board is gone, or refuses.
        """
        self._require_open("point")
        angles_rad = np.array([angle_x_rad, angle_y_rad])
        volts = self.limits.volts(angles_rad)
        self._board.set_volts(self._channels, volts.tolist())
        self._moved_to(angles_rad)

    def wait_settled(self, timeout_s: float) -> None:
        """Return when the mirrors must have come to rest, by the time since the last move.

        They cannot be asked. While they follow a trajectory there is nothing to wait for.

        Raises
        ------
        RefusedError
            That would take longer than ``timeout_s``.
        """
        self._require_open("settle")
        wait_s = self._settled_s - self._clock.now_s()
        if wait_s > timeout_s:
            raise RefusedError(
                self.limits.device,
                f"settle within {timeout_s:g} s",
                f"a move of this size takes {wait_s:.3g} s more",
                "Allow more time: galvo.settle_timeout.",
            )
        if wait_s > 0:
            self._clock.sleep(wait_s)

    def loading_s(self, positions: int) -> float:
        """Return how long `trajectory` takes: no time, since they go to the board with its start."""
        return 0.0

    def trajectory(
        self,
        angles_rad: NDArray[np.float64],
        tick_s: float,
        meanwhile: Callable[[], None] = lambda: None,
    ) -> None:
        """Load positions that the mirrors take one after the other, one at each tick of the point clock.

        They go to the first at once, and stay at the last; `point` ends it at any time.

        Parameters
        ----------
        angles_rad
            (n, 2) optical angles; all are checked before anything is sent.
        tick_s
            Time between two ticks.
        meanwhile
            Not called: they are kept in memory until the point clock starts.

        Raises
        ------
        LimitError
            A position is outside the limits, there are none or too many, or the ticks are too fast.
        """
        self._require_open("follow a trajectory")
        self._check_trajectory(angles_rad, tick_s)
        volts = self.limits.volts(angles_rad)
        self.point(*angles_rad[0].tolist())
        self._board.load_volts(
            self._channels, np.repeat(volts, SAMPLES_PER_TICK, axis=0), SAMPLES_PER_TICK / tick_s
        )
        self._target_rad = (float(angles_rad[-1, 0]), float(angles_rad[-1, 1]))
        self._may_be_anywhere = True

    def settings(self) -> dict[str, str | int | float | bool]:
        """Return scale, limits, and where it was sent: there is no read-back."""
        self._require_open("report its settings")
        return {
            "identity": self.identity,
            "angle_x_rad": self._target_rad[0],
            "angle_y_rad": self._target_rad[1],
            "max_angle_x_rad": self.limits.max_angle_rad[0],
            "max_angle_y_rad": self.limits.max_angle_rad[1],
            "volts_per_degree_x": self.limits.volts_per_degree[0],
            "volts_per_degree_y": self.limits.volts_per_degree[1],
            "settling": "a fixed waiting time, not read back",
            "settling_small_s": self._settling.small_s,
            "settling_full_s": self._settling.full_s,
        }

    def _moved_to(self, angles_rad: NDArray[np.float64]) -> None:
        """Note a move, and when it must have ended."""
        range_rad = 2 * np.array(self.limits.max_angle_rad)
        moved = (
            1.0 if self._may_be_anywhere else float((np.abs(angles_rad - self._target_rad) / range_rad).max())
        )
        takes_s = self._settling.small_s + moved * (self._settling.full_s - self._settling.small_s)
        self._settled_s = max(self._settled_s, self._clock.now_s() + takes_s)
        self._target_rad = (float(angles_rad[0]), float(angles_rad[1]))
        self._may_be_anywhere = False

    def _check_trajectory(self, angles_rad: NDArray[np.float64], tick_s: float) -> None:
        shortest_s = SAMPLES_PER_TICK / self._fastest_hz
        if (
            angles_rad.ndim != 2
            or angles_rad.shape[1] != 2
            or not 0 < len(angles_rad) <= self.longest_trajectory
        ):
            asked = f"follow positions of shape {angles_rad.shape}"
            limit = f"the shape must be (n, 2), with n from 1 to {self.longest_trajectory}"
        elif not isfinite(tick_s) or tick_s < shortest_s:
            asked, limit = (
                f"move every {tick_s:g} s",
                f"the board needs at least {shortest_s:.3g} s for each move",
            )
        else:
            return
        raise LimitError(self.limits.device, asked, limit, "Nothing was sent. Change exposure or grid.")

    def _require_open(self, asked: str) -> None:
        if not self._open:
            raise LinkError(self.limits.device, asked, "it is not open", "Use the galvo in a with block.")
