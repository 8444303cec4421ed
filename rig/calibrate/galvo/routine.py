"""The steering mirror calibrated with two cameras: boards, then spots over the scanned wall."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from rig.acquire.acquisition import Watch
from rig.acquire.connect import Station
from rig.calibrate.galvo.cameras import CalibratedCameras, calibrate_cameras, find_corners, opencv
from rig.calibrate.galvo.images import ImagesWriter, WallImages, writing
from rig.calibrate.galvo.mirror import fit_mirror, galvo_model
from rig.calibrate.galvo.pictures import spots_figure
from rig.calibrate.galvo.spots import background, find_spot
from rig.calibrate.galvo.triangulation import MIN_SPOTS, locate
from rig.calibrate.geometry_fit import Floats
from rig.calibrate.raw import origin
from rig.calibrate.routine import Routine
from rig.errors import CalibrationError
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

    def setup(self, config: RigConfig) -> RigConfig:
        """Return the configuration as it is."""
        return config

    def measure(self, station: Station, state: RigState, folder: Path, watch: Watch) -> list[Path]:
        """Show boards to the cameras, then the spot for each angle."""
        config = state.config
        opencv()  # better missed now than after all the work
        if len(station.cameras) != 2:
            raise CalibrationError(
                f"two cameras are needed, {len(station.cameras)} are configured: name two as "
                "cameras.addresses, or calibrate without them: rig calibrate galvo --method flight"
            )
        if self.columns * self.rows < MIN_SPOTS:
            raise CalibrationError(
                f"{self.columns} x {self.rows} mirror angles are too few, {MIN_SPOTS} are needed: measure "
                "more"
            )
        path = folder / "galvo-images.h5"
        operator, used = station.operator, config.cameras
        with writing(path, config, station.devices.read_back(), station.cameras) as writer:
            for number in range(self.boards):
                board = Board(used.board_columns, used.board_rows, used.board_square_m)
                marks_m = used.board_marks_m
                operator.show_board(board, marks_m[number] if number < len(marks_m) else None)
                writer.take("board")
                if watch.should_stop():
                    return []
            operator.prepare(Preparation.MEASURE)
            self._dark(writer, self.darks // 2)
            self._lit(station, config, writer, watch)
            self._dark(writer, self.darks - self.darks // 2)
        return [path]

    def _dark(self, writer: ImagesWriter, number: int) -> None:
        for _ in range(number):
            writer.take("dark")

    def _lit(self, station: Station, config: RigConfig, writer: ImagesWriter, watch: Watch) -> None:
        galvo, laser = station.devices.galvo, station.devices.laser
        angles = mirror_angles_rad(config, self.columns, self.rows)
        galvo.point(*angles[0])  # aims before it lights
        galvo.wait_settled(config.galvo.settle_timeout_s)
        try:
            laser.arm()
            laser.emit()
            for angle in angles:
                if watch.should_stop():
                    break
                galvo.point(*angle)
                galvo.wait_settled(config.galvo.settle_timeout_s)
                writer.take("lit", angle)
            if not laser.emitting():
                raise CalibrationError(
                    "the laser went dark by itself while spots were measured: check its interlock, and begin "
                    "anew"
                )
        finally:
            laser.stop()

    def fit(self, files: Sequence[Path], state: RigState) -> GalvoModel:
        """Return the mirror's model from the pictures of one file."""
        with WallImages(files[0]) as images:
            cameras = _calibrated(images)
            pixels, covariances = _spots(images)
            located = locate(cameras, pixels, covariances)
            angles = images.mirror_rad[located.kept]
            mirror = fit_mirror(angles, located.spots_m, located.covariance, state.config)
            return galvo_model("cameras", mirror, angles, located.spots_m, origin(GalvoModel, [images]))

    def figure(self, files: Sequence[Path], found: GalvoModel) -> Figure:
        """Draw spots, what the model leaves, and where it may be used."""
        return spots_figure(found)


def mirror_angles_rad(config: RigConfig, columns: int, rows: int) -> list[tuple[float, float]]:
    """Return commands over the scan and `BEYOND_M` more, if the mirror were as configured; line by line."""
    limits = np.array([config.galvo.max_angle_x_rad, config.galvo.max_angle_y_rad])
    scan = config.scan
    half_m = (np.array([scan.columns, scan.rows]) - 1) / 2 * scan.spacing_m + BEYOND_M
    ends_m = np.array([[-half_m[0], 0, 0], [half_m[0], 0, 0], [0, -half_m[1], 0], [0, half_m[1], 0]])
    ends = RigState(config).pointing.angles_rad(ends_m)
    left, right = np.tan(np.clip(ends[:2, 0], -limits[0], limits[0]))
    low, high = np.tan(np.clip(ends[2:, 1], -limits[1], limits[1]))
    x = np.arctan(np.linspace(float(left), float(right), columns))
    y = np.arctan(np.linspace(float(low), float(high), rows))
    lines = [(x if row % 2 == 0 else x[::-1], angle_y) for row, angle_y in enumerate(y)]
    return [(float(angle_x), float(angle_y)) for line, angle_y in lines for angle_x in line]


def _calibrated(images: WallImages) -> CalibratedCameras:
    board = images.board
    seen, size = [], (0, 0)
    for pair in zip_longest(images.pictures(0, "board"), images.pictures(1, "board")):
        seen.append([None if image is None else find_corners(image, board) for image in pair])
        size = (pair[0].shape[1], pair[0].shape[0]) if pair[0] is not None else size
    return calibrate_cameras(seen, board, images.marks_m, images.placed_to_m, size)


def _spots(images: WallImages) -> tuple[Floats, Floats]:
    """Return (N, 2, 2) spots in both cameras, and their (N, 2, 2, 2) covariances [pixels]."""
    found = []
    for camera, (name, full) in enumerate(zip(images.cameras, images.full, strict=True)):
        dark = background(np.stack(list(images.pictures(camera, "dark"))), full)
        found.append(
            [
                find_spot(lit, dark, f"{name}, position {index} (mirror at {_degrees(angle)})")
                for index, (lit, angle) in enumerate(
                    zip(images.pictures(camera, "lit"), images.mirror_rad, strict=True)
                )
            ]
        )
    return (
        np.array([[spot.centre for spot in pair] for pair in zip(*found, strict=True)]),
        np.array([[spot.covariance for spot in pair] for pair in zip(*found, strict=True)]),
    )


def _degrees(angle_rad: Floats) -> str:
    x, y = np.degrees(angle_rad)
    return f"{x:.2f}, {y:.2f} deg"
