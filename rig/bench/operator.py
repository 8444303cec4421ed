"""Who takes the place of the person and the cameras when a calibration runs on the simulated rig."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rig.model.devices import Board, Galvo, Operator, Preparation, Request, WallCamera

if TYPE_CHECKING:
    from simulators.bench import Bench
    from simulators.optics.cameras import Camera, Checkerboard

#: What the bench's light is changed to; a density of 1 in the beam, and a lamp that counts 1e6 a second.
_LIGHT: dict[Preparation, dict[str, float | bool]] = {
    Preparation.MEASURE: {},
    Preparation.ATTENUATE: {"attenuation": 0.1},
    Preparation.BLOCK: {"blocked": True},
    Preparation.COVER: {"blocked": True, "covered": True},
    Preparation.LAMP: {"blocked": True, "lamp_hz": 1e6},
}
_AS_FOR_A_SCAN: dict[str, float | bool] = {
    "attenuation": 1.0,
    "blocked": False,
    "covered": False,
    "lamp_hz": 0.0,
}

#: What a person sets by hand, as the bench calls it too.
_BY_HAND = {"emitting", "biased", "gated", "triggered", "gate_delay_s", "gate_width_s", "hold_off_s"}

#: How well a person steers a beam onto a mark: standard deviation along x and along y [m].
AIMING_ERROR_M = 0.3e-3

#: How well a person holds a board to marks on the wall: standard deviation of either end, along x and y [m].
PLACING_ERROR_M = 0.2e-3


def simulated_operator(bench: "Bench") -> tuple[Operator, tuple[WallCamera, ...]]:
    """Return a person and two cameras who act on, and see, the bench."""
    from simulators.optics.cameras import default_cameras

    operator = SimulatedOperator(bench)
    return operator, tuple(
        BenchCamera(operator, camera, number) for number, camera in enumerate(default_cameras(), 1)
    )


class SimulatedOperator:
    """Does at once what is asked, and aims as well as a person can."""

    def __init__(self, bench: "Bench") -> None:
        self.bench = bench
        self.board: Checkerboard | None = None
        self._rng = np.random.default_rng((bench.seed, 1))

    def set_by_hand(self, wanted: Request, meanwhile: Callable[[], bool] = lambda: False) -> str:
        """Set the bench as asked; a laser that is switched off by hand gives no sync pulses either."""
        changes = {name: value for name, value in wanted.settings.items() if name in _BY_HAND}
        if "delay_s" in wanted.settings:  # of a delayer that adds nothing by itself
            changes["gate_delay_s"] = wanted.settings["delay_s"]
        self.bench.change_light(**changes)  # type: ignore[arg-type]
        return "the simulated person"

    def tell(self, words: str) -> None:
        """Be told."""

    def prepare(self, preparation: Preparation) -> None:
        """Change the bench's light as asked."""
        self.board = None
        self.bench.change_light(**{**_AS_FOR_A_SCAN, **_LIGHT[preparation]})

    def aim_at(
        self, galvo: Galvo, mark_m: tuple[float, float], meanwhile: Callable[[], None]
    ) -> tuple[float, float]:
        """Steer the beam onto a mark; return the angles [rad]."""
        self.board = None
        wanted_m = np.array(mark_m) + AIMING_ERROR_M * self._rng.standard_normal(2)
        angles = np.zeros(2)
        for _ in range(30):  # as a person does: look where the spot is, correct, look again
            meanwhile()
            seen_m = self._spot_m(galvo, angles)
            moved_m = [self._spot_m(galvo, angles + nudge) - seen_m for nudge in 1e-3 * np.eye(2)]
            step = np.linalg.solve(np.array(moved_m).T / 1e-3, wanted_m - seen_m)
            angles = angles + step * min(1.0, 0.2 / float(np.abs(step).max() + 1e-30))
            if np.abs(step).max() < 1e-9:
                break
        self._spot_m(galvo, angles)
        return float(angles[0]), float(angles[1])

    def show_board(self, board: Board, mark_m: tuple[float, float] | None) -> None:
        """Hold the board to a mark on the wall, or before the wall where both cameras see it."""
        from simulators.motion.mount import rotated
        from simulators.optics.cameras import Checkerboard
        from simulators.optics.lens import Pose

        length_m = (board.columns - 1) * board.square_m
        if mark_m is not None:
            left_m, right_m = PLACING_ERROR_M * self._rng.standard_normal((2, 2))
            rotation = rotated(0.0, 0.0, float(right_m[1] - left_m[1]) / length_m)
            corner_m = np.array([*(np.array(mark_m) + left_m), 0.0])
        else:  # turned by up to 30 degrees, somewhere before the wall where both cameras see it
            middle_m = self._rng.uniform((-0.8, -0.55, 0.3), (0.8, 0.55, 0.8))
            rotation = rotated(*self._rng.uniform(-0.5, 0.5, 3))
            half_m = np.array([length_m, (board.rows - 1) * board.square_m, 0.0]) / 2
            corner_m = middle_m - rotation @ half_m
        self.board = Checkerboard(Pose(rotation.T, corner_m), board.columns, board.rows, board.square_m)

    def _spot_m(self, galvo: Galvo, angles_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        galvo.point(float(angles_rad[0]), float(angles_rad[1]))
        galvo.wait_settled(1.0)
        mirror = self.bench.position_rad
        return np.array(self.bench.geometry.laser_spot_m(mirror)[:2])


class BenchCamera:
    """Takes pictures of the bench's wall, or of the board before it, each with noise of its own."""

    def __init__(self, operator: SimulatedOperator, camera: "Camera", number: int) -> None:
        self.name = f"camera {number}"
        self.full = camera.sensor.largest
        self._operator, self._camera = operator, camera
        self._rng = np.random.default_rng((operator.bench.seed, 2, number))

    def image(self) -> NDArray[np.uint16]:
        """Return a picture of the wall as it is now."""
        if self._operator.board:
            return self._camera.image_of_board(self._operator.board, self._rng)
        return self._camera.image(self._operator.bench, self._rng)
