"""The two cameras that confirm where the laser meets the wall (the paper's CCD cameras), and their boards.

Where they stand, their lenses and sensors are not published: all defaults here are unconfirmed.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from simulators.bench import Bench
from simulators.optics.lens import WALL, Distortion, Intrinsics, Lens, Pose, meet

#: How far from its centre a laser spot is drawn, in standard deviations.
SPOT_REACH = 6.0


@dataclass(frozen=True)
class Sensor:
    """From light to numbers.

    Attributes
    ----------
    white_e
        Electrons in a pixel that sees the wall in room light.
    spot_e
        Electrons in all pixels of the laser spot at full power.
    read_e
        Read noise, standard deviation [electrons].
    e_per_count
        Electrons for each count.
    offset
        Counts without light.
    largest
        Count where a pixel is full (12 bits).
    blur_px
        Standard deviation of the lens's blur [pixels].
    """

    white_e: float = 1500.0
    spot_e: float = 60_000.0
    read_e: float = 12.0
    e_per_count: float = 4.0
    offset: float = 64.0
    largest: int = 4095
    blur_px: float = 0.8

    def expose(self, electrons: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.uint16]:
        """Draw an image from the mean electrons of each pixel.

        Poisson's numbers are drawn as Gaussian ones, much quicker: from some hundred electrons on, and beside
        the read noise, nobody can tell.
        """
        spread = np.sqrt(electrons + self.read_e**2, dtype=np.float32)
        drawn = electrons + spread * rng.standard_normal(electrons.shape, dtype=np.float32)
        counts = np.rint(drawn / self.e_per_count + self.offset)
        return np.clip(counts, 0, self.largest).astype(np.uint16)


@dataclass(frozen=True)
class Checkerboard:
    """A flat board of black and white squares.

    Attributes
    ----------
    pose
        Its plane; the origin is the first inner corner, x runs along the columns, y along the rows.
    columns, rows
        Inner corners along x and y.
    square_m
        Side of a square [m].
    """

    pose: Pose
    columns: int = 9
    rows: int = 6
    square_m: float = 0.08

    @property
    def corners_m(self) -> NDArray[np.float64]:
        """(rows * columns, 3) inner corners in the wall's frame, row by row [m]."""
        y, x = np.mgrid[: self.rows, : self.columns].reshape(2, -1) * self.square_m
        return self.pose.outside(np.column_stack([x, y, np.zeros_like(x)]))

    def reflected(self, at_m: NDArray[np.float64], pixel_m: float) -> NDArray[np.float64]:
        """Return (N,) reflectance at (N, 2) points of its plane [m], edges a pixel soft; NaN beside it."""
        squares = at_m / self.square_m
        inside = (squares > -1) & (squares < (self.columns, self.rows))
        nearest = np.rint(squares)
        side = np.clip((squares - nearest) * self.square_m / (pixel_m / 2), -1, 1) * (1 - 2 * (nearest % 2))
        shade = 0.5 - 0.4 * side[:, 0] * side[:, 1]
        return np.where(inside.all(axis=1), shade, np.nan)


@dataclass(frozen=True)
class Camera:
    """A camera that sees the relay wall.

    Attributes
    ----------
    pose, intrinsics, distortion
        Where it stands, and its lens.
    sensor
        Its noise.
    wall_m
        Width and height of the white wall [m]; around it is grey.
    spot_sigma_m
        Standard deviation of the Gaussian laser spot on the wall [m].
    """

    pose: Pose
    intrinsics: Intrinsics = field(default_factory=Intrinsics)
    distortion: Distortion = field(default_factory=Distortion)
    sensor: Sensor = field(default_factory=Sensor)
    wall_m: tuple[float, float] = (2.4, 1.9)
    spot_sigma_m: float = 1.5e-3

    @cached_property
    def lens(self) -> Lens:
        """Its geometry."""
        return Lens(self.pose, self.intrinsics, self.distortion)

    def image(self, bench: Bench, rng: np.random.Generator) -> NDArray[np.uint16]:
        """Take a picture of the wall now: (height, width), with the spot where the mirror really points.

        The exposure is taken as short: a moving mirror is not smeared.
        """
        spot_m = bench.geometry.laser_spot_m(bench.position_rad)
        return self.image_of_spot(spot_m, bench.light.on_wall, rng)

    def image_of_spot(
        self, spot_m: tuple[float, float, float], power: float, rng: np.random.Generator
    ) -> NDArray[np.uint16]:
        """Take a picture of the wall with a laser spot of this fraction of full power on it."""
        electrons = self._wall_e.copy()
        if power > 0:
            self._add_spot(electrons, np.array(spot_m), power)
        return self.sensor.expose(electrons, rng)

    def image_of_board(self, board: Checkerboard, rng: np.random.Generator) -> NDArray[np.uint16]:
        """Take a picture of a checkerboard in front of the wall, the laser dark."""
        away_m = float(np.linalg.norm(board.corners_m.mean(axis=0) - self.pose.position_m))
        at_m = meet(self.pose.position_m, self._rays, board.pose)
        seen = board.reflected(at_m, away_m / self.intrinsics.fx)
        seen = seen.reshape(self._wall_e.shape)
        return self.sensor.expose(np.where(np.isnan(seen), self._wall_e, seen * self.sensor.white_e), rng)

    @cached_property
    def _rays(self) -> NDArray[np.float64]:
        """(height * width, 3) directions of all pixels, row by row."""
        row, column = np.mgrid[: self.intrinsics.height, : self.intrinsics.width].reshape(2, -1)
        return self.lens.rays(np.column_stack([column, row]).astype(np.float64))

    @cached_property
    def _wall_e(self) -> NDArray[np.float64]:
        """(height, width) electrons of the wall in room light."""
        at_m = meet(self.pose.position_m, self._rays, WALL)
        white = (np.abs(at_m) <= np.array(self.wall_m) / 2).all(axis=1)
        electrons = self.sensor.white_e * np.where(white, 1.0, 0.3)
        return electrons.reshape(self.intrinsics.height, self.intrinsics.width)

    def _add_spot(self, electrons: NDArray[np.float64], spot_m: NDArray[np.float64], power: float) -> None:
        """Add an elliptical Gaussian: the round spot on the wall, as the lens maps its neighbourhood."""
        step_m = 1e-4 * np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
        centre = self.lens.project(spot_m)[0]
        left_right_down_up = self.lens.project(spot_m + step_m)
        if not np.isfinite(centre).all():
            return
        slopes = (left_right_down_up[0::2] - left_right_down_up[1::2]).T / 2e-4  # pixels by metres, (2, 2)
        spread = self.spot_sigma_m**2 * slopes @ slopes.T + self.sensor.blur_px**2 * np.eye(2)
        reach = SPOT_REACH * np.sqrt(spread.diagonal())
        low = np.maximum(np.ceil(centre - reach), 0).astype(int)
        high = np.floor(centre + reach).astype(int) + 1
        y, x = np.mgrid[low[1] : high[1], low[0] : high[0]].astype(np.float64)
        if not x.size:
            return
        part = electrons[low[1] : high[1], low[0] : high[0]]  # smaller than x where the image ends
        x, y = (
            x[: part.shape[0], : part.shape[1]] - centre[0],
            y[: part.shape[0], : part.shape[1]] - centre[1],
        )
        inverse = np.linalg.inv(spread)
        square = inverse[0, 0] * x * x + 2 * inverse[0, 1] * x * y + inverse[1, 1] * y * y
        part += (
            power * self.sensor.spot_e * np.exp(-square / 2) * np.sqrt(np.linalg.det(inverse)) / (2 * np.pi)
        )


def default_cameras() -> tuple[Camera, Camera]:
    """Return two cameras beside the rig, both looking at the middle of the wall."""
    places = ((-0.9, 0.5, 2.4), (0.9, 0.4, 2.6))
    return (
        Camera(Pose.looking_at(places[0], (0.0, 0.0, 0.0))),
        Camera(Pose.looking_at(places[1], (0.0, 0.0, 0.0))),
    )
