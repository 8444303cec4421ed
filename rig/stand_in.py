"""Who takes the place of the person and the cameras when a calibration runs on the simulated rig."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rig.devices import Galvo, Operator, Preparation, WallCamera

if TYPE_CHECKING:
    from simulators.bench import Bench
    from simulators.cameras import Camera

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

#: How well a person steers a beam onto a mark: standard deviation along x and along y [m].
AIMING_ERROR_M = 0.3e-3


def stand_ins(bench: "Bench") -> tuple[Operator, tuple[WallCamera, ...]]:
    """Return a person and two cameras who act on, and see, the bench."""
    from simulators.cameras import default_cameras

    cameras = tuple(_BenchCamera(bench, camera, number) for number, camera in enumerate(default_cameras(), 1))
    return _BenchOperator(bench), cameras


class _BenchOperator:
    """Does at once what is asked, and aims as well as a person can."""

    def __init__(self, bench: "Bench") -> None:
        self._bench = bench
        self._rng = np.random.default_rng((bench.seed, 1))

    def prepare(self, preparation: Preparation) -> None:
        self._bench.change_light(**{**_AS_FOR_A_SCAN, **_LIGHT[preparation]})

    def aim_at(self, galvo: Galvo, mark_m: tuple[float, float]) -> tuple[float, float]:
        wanted_m = np.array(mark_m) + AIMING_ERROR_M * self._rng.standard_normal(2)
        angles = np.zeros(2)
        for _ in range(30):  # as a person does: look where the spot is, correct, look again
            seen_m = self._spot_m(galvo, angles)
            moved_m = [self._spot_m(galvo, angles + nudge) - seen_m for nudge in 1e-3 * np.eye(2)]
            step = np.linalg.solve(np.array(moved_m).T / 1e-3, wanted_m - seen_m)
            angles = angles + step * min(1.0, 0.2 / float(np.abs(step).max() + 1e-30))
            if np.abs(step).max() < 1e-9:
                break
        self._spot_m(galvo, angles)
        return float(angles[0]), float(angles[1])

    def _spot_m(self, galvo: Galvo, angles_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        galvo.point(float(angles_rad[0]), float(angles_rad[1]))
        galvo.wait_settled(1.0)
        mirror = self._bench.mirror.position(self._bench.clock.now_s())
        return np.array(self._bench.geometry.laser_spot_m(mirror)[:2])


class _BenchCamera:
    """Takes pictures of the bench's wall, each with noise of its own."""

    def __init__(self, bench: "Bench", camera: "Camera", number: int) -> None:
        self.name = f"camera {number}"
        self._bench, self._camera = bench, camera
        self._rng = np.random.default_rng((bench.seed, 2, number))

    def image(self) -> NDArray[np.uint16]:
        return self._camera.image(self._bench, self._rng)
