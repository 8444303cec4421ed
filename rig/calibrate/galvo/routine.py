"""The steering mirror calibrated with two cameras: boards, then spots over the scanned wall."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import zip_longest
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from rig.acquire.acquisition import Watch
from rig.acquire.connect import Station
from rig.calibrate import Floats, figures, require
from rig.calibrate.galvo.cameras import (
    WITHOUT_OPENCV,
    CalibratedCameras,
    calibrate_cameras,
    find_corners,
    opencv,
)
from rig.calibrate.galvo.images import ImagesWriter, WallImages, writing
from rig.calibrate.galvo.mirror import fit_mirror, galvo_model
from rig.calibrate.galvo.spots import background, find_spot
from rig.calibrate.galvo.triangulation import MIN_SPOTS, locate
from rig.calibrate.geometry_fit import Spots
from rig.calibrate.raw import origin
from rig.calibrate.routine import Routine, beam
from rig.model.calibrations.kinds import GalvoModel
from rig.model.config import RigConfig
from rig.model.devices import Board, Preparation
from rig.model.state import RigState

#: Spots are measured so far beyond the scan, as far as the mirror goes: so much may it be misaligned.
BEYOND_M = 0.15


@dataclass(frozen=True)
class CameraRoutine(Routine[GalvoModel]):
    """Sees where the beam meets the wall.

    Attributes
    ----------
    columns, rows
        Mirror angles.
    boards
        Pictures of the board, the first ones at its marks on the wall.
    darks
        Pictures of the dark wall, half before and half after.
    """

    columns: int = 11
    rows: int = 9
    boards: int = 12
    darks: int = 8

    makes = GalvoModel

    def lacking(self, config: RigConfig) -> str:
        """Say that the rig has no two cameras, or that nothing here can see by them."""
        cameras = len(config.cameras.addresses)
        if cameras != 2 and not config.simulated:
            return (
                f"two cameras are needed, {cameras} are configured: give two as cameras.addresses, or "
                "calibrate without them: rig calibrate galvo --method flight"
            )
        return WITHOUT_OPENCV if find_spec("cv2") is None else ""

    def measure(self, station: Station, state: RigState, folder: Path, watch: Watch) -> list[Path]:
        """Show boards to the cameras, then the spot for each angle."""
        config, used = state.config, state.config.cameras
        opencv()  # better missed now than after all the work
        require(
            len(station.cameras) == 2,
            f"two cameras are needed, {len(station.cameras)} are configured: give two as cameras.addresses, "
            "or calibrate without them: rig calibrate galvo --method flight",
        )
        require(
            self.columns * self.rows >= MIN_SPOTS,
            f"{self.columns} x {self.rows} mirror angles are too few, {MIN_SPOTS} are needed: measure more",
        )
        path = folder / "galvo-images.h5"
        with writing(path, config, station.devices.read_back(), station.cameras) as writer:
            for _, mark_m in zip_longest(range(self.boards), used.board_marks_m[: self.boards]):
                board = Board(used.board_columns, used.board_rows, used.board_square_m)
                station.operator.show_board(board, mark_m)
                writer.take("board")
                if watch.should_stop():
                    return []
            station.operator.prepare(Preparation.MEASURE)
            for _ in range(self.darks // 2):
                writer.take("dark")
            self._lit(station, config, writer, watch)
            for _ in range(self.darks - self.darks // 2):
                writer.take("dark")
        return [path]

    def _lit(self, station: Station, config: RigConfig, writer: ImagesWriter, watch: Watch) -> None:
        angles = mirror_angles_rad(config, self.columns, self.rows)
        with beam(station, config, angles[0], watch) as (galvo, goes_on):
            for angle in angles:
                goes_on()
                galvo.point(*angle)
                galvo.wait_settled(config.galvo.settle_timeout_s)
                writer.take("lit", angle)
            require(
                station.devices.laser.emitting(),
                "the laser went dark while spots were measured: check its interlock, and start again",
            )

    def fit(self, files: Sequence[Path], state: RigState) -> GalvoModel:
        """Return the mirror's model from the pictures of one file."""
        with WallImages(files[0]) as images:
            cameras = _calibrated(images)
            spots_m, covariance, on_wall = locate(cameras, *_spots(images))
            spots = Spots(images.mirror_rad[on_wall], spots_m, covariance)
            fit, source = fit_mirror(spots, state.config), origin(GalvoModel, [images])
            return galvo_model("cameras", fit, spots, spots.mirror_rad, source, positions=len(spots_m))

    def figure(self, files: Sequence[Path], found: GalvoModel) -> Figure:
        """Draw measured spots with magnified residuals, where the model may be used, and how they scatter."""
        spots_m = np.array(found.spots_m)
        residual_m = spots_m - found.pointing().spots_m(np.array(found.mirror_rad))[:, :2]
        figure, axes = figures.panels(
            f"{found.positions} spots by {found.method}: residual {found.residual_m * 1e3:.2f} mm, "
            f"standard error of a spot {found.spot_error_m * 1e3:.2f} mm",
            [["wall", "cloud"]], (13, 5.2), width_ratios=(1.9, 1),
        )  # fmt: skip
        wall, cloud = axes["wall"], axes["cloud"]
        figures.outline(wall, found.area_m)
        wall.plot(*spots_m.T, "o", color=figures.BLUE, markersize=3, label="measured spot")
        figures.arrows(wall, spots_m, residual_m, "measured less modelled", 0.2)
        figures.legend_below(wall)
        reach = 1.2e3 * float(np.abs(residual_m).max())
        cloud.axvline(0, color=figures.GREY, linewidth=0.8)
        figures.residuals(cloud, *(1e3 * residual_m).T, fmt="o", color=figures.RED)
        cloud.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", title="residuals",
                  xlabel="residual along x (mm)", ylabel="residual along y (mm)")  # fmt: skip
        for axis in (cloud.xaxis, cloud.yaxis):
            axis.set_major_locator(MaxNLocator(5))
        return figure


def mirror_angles_rad(config: RigConfig, columns: int, rows: int) -> list[tuple[float, float]]:
    """Return commands for a grid over the scan and `BEYOND_M` more, if the mirror were as configured.

    They go line by line, there and back. Where a spot is out of the mirror's reach, they end at its limits.
    """
    limits = np.array([config.galvo.max_angle_x_rad, config.galvo.max_angle_y_rad])
    scan = config.scan
    half_m = (np.array([scan.columns, scan.rows]) - 1) / 2 * scan.spacing_m + BEYOND_M
    x_m, y_m = np.meshgrid(
        *(np.linspace(-half, half, n) for half, n in zip(half_m, (columns, rows), strict=True))
    )
    x_m[1::2] = x_m[1::2, ::-1]
    spots_m = np.stack([x_m, y_m, np.zeros_like(x_m)], axis=-1).reshape(-1, 3)
    angles = np.clip(RigState(config).pointing.angles_rad(spots_m), -limits, limits)
    return [(x, y) for x, y in angles.tolist()]


def _calibrated(images: WallImages) -> CalibratedCameras:
    board = images.board
    corners, size = [], (0, 0)
    for pair in zip_longest(images.pictures(0, "board"), images.pictures(1, "board")):
        corners.append([None if image is None else find_corners(image, board) for image in pair])
        size = (pair[0].shape[1], pair[0].shape[0]) if pair[0] is not None else size
    return calibrate_cameras(corners, board, images.marks_m, images.placed_to_m, size)


def _spots(images: WallImages) -> tuple[Floats, Floats]:
    """Return (N, 2, 2) spots in both cameras, and their (N, 2, 2, 2) covariances [pixels]."""
    found = []
    for camera, (name, full) in enumerate(zip(images.cameras, images.full, strict=True)):
        dark = background(np.stack(list(images.pictures(camera, "dark"))), full)
        for index, (lit, (x, y)) in enumerate(
            zip(images.pictures(camera, "lit"), np.degrees(images.mirror_rad), strict=True)
        ):
            found.append(find_spot(lit, dark, f"{name}, position {index} (mirror at {x:.2f}, {y:.2f} deg)"))
    centres = np.array([spot.centre for spot in found]).reshape(2, -1, 2)
    covariances = np.array([spot.covariance for spot in found]).reshape(2, -1, 2, 2)
    return centres.swapaxes(0, 1), covariances.swapaxes(0, 1)
