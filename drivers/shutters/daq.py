"""A shutter on a digital output of a data acquisition board."""

from drivers.clock import Clock
from drivers.daq.board import SharedBoard
from drivers.shutters.line_shutter import LineShutter


class DaqShutter(LineShutter):
    """A shutter on a board's line; where it is cannot be read back.

    When the program ends without a word, the line stays as it is: the guard of the light closes it.

    Parameters
    ----------
    board
        The board.
    line
        Its digital output, e.g. ``port1/line0``.
    clock, opens_high, moving_time_s
        See `LineShutter`.
    """

    def __init__(
        self,
        board: SharedBoard,
        line: str,
        *,
        clock: Clock,
        opens_high: bool = True,
        moving_time_s: float = 20e-3,
    ) -> None:
        super().__init__(
            f"shutter at {board.name} {line}",
            clock=clock,
            opens_high=opens_high,
            moving_time_s=moving_time_s,
        )
        self._board = board
        self._line = line

    def _open_line(self) -> str:
        return f"shutter on {self._line} of {self._board.identity()}"

    def _close_line(self) -> None:
        pass

    def _set(self, level: bool) -> None:
        self._board.set_lines((self._line,), level)

    def _level(self) -> None:
        return None
