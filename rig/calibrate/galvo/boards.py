"""Two cameras calibrated by a checkerboard: held flat on the wall at marks, and then freely."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from rig.calibrate.galvo.lens import NUMBERS, CameraModel, Floats
from rig.calibrate.galvo.opencv import opencv
from rig.errors import CalibrationError
from rig.model.devices import Board

#: Fewest boards that each camera has to see, the one on the wall among them.
LEAST_BOARDS = 6
#: Largest median distance of corners from their model [pixels].
WORST_CORNERS_PX = 0.5
#: How well a corner is found, as long as nothing else is known: standard deviation along either axis
#: [pixels].
ROUGH_PX = 0.1
#: Corners are searched for in an image no wider than this [pixels], and then refined in the whole one.
SEARCHED_PX = 800
#: A corner is refined with what is around it, by this part of the distance to its neighbours.
REFINED_PART = 0.3
#: A corner so many standard deviations off is a wrong one; no more than this part of them may be.
WRONG, MOST_WRONG = 6.0, 0.03


@dataclass(frozen=True)
class CalibratedCameras:
    """Both cameras, with the covariance of all their numbers.

    Attributes
    ----------
    cameras
        In the wall's frame, as far as the board on the wall gives it.
    covariance
        (28, 28) of the first camera's numbers and then the second's.
    corners_px
        Root mean square distance of the corners from their model [pixels].
    """

    cameras: tuple[CameraModel, CameraModel]
    covariance: Floats
    corners_px: float


def find_corners(image: NDArray[np.uint16], board: Board) -> Floats | None:
    """Return (rows, columns, 2) pixels of the inner corners, None where the whole board is not seen.

    The first is the board's first (see `Board`), columns run along the last but one axis.
    """
    cv2 = opencv()
    low, high = np.percentile(image[::4, ::4], (0.5, 99.5))
    grey = np.clip((image - low) / max(high - low, 1) * 255, 0, 255).astype(np.uint8)
    scale = max(1.0, image.shape[1] / SEARCHED_PX)
    small = cv2.resize(grey, None, fx=1 / scale, fy=1 / scale, interpolation=cv2.INTER_AREA)
    size = (board.columns, board.rows)
    found, corners = cv2.findChessboardCorners(small, size)
    if not found:
        found, corners = cv2.findChessboardCornersSB(small, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not found:
        return None
    rough = ((corners.reshape(board.rows, board.columns, 2) + 0.5) * scale - 0.5).astype(np.float32)
    apart_px = min(np.linalg.norm(np.diff(rough, axis=axis), axis=-1).min() for axis in (0, 1))
    reach = max(2, int(REFINED_PART * apart_px))
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
    fine = cv2.cornerSubPix(grey, rough.reshape(-1, 1, 2), (reach, reach), (-1, -1), stop)
    return _in_order(fine.reshape(board.rows, board.columns, 2).astype(np.float64), grey)


def _in_order(corners: Floats, grey: NDArray[np.uint8]) -> Floats:
    """Begin with the corner whose square is black, columns and rows right-handed when seen from the front."""
    (along_x, along_y), (up_x, up_y) = corners[0, -1] - corners[0, 0], corners[-1, 0] - corners[0, 0]
    if along_x * up_y - along_y * up_x > 0:  # rows in the image run downwards
        corners = corners[::-1]

    def shade(row: int, column: int) -> int:
        x, y = np.rint(corners[row : row + 2, column : column + 2].mean(axis=(0, 1))).astype(int)
        return int(grey[y, x])

    return corners if shade(0, 0) < shade(0, 1) else corners[::-1, ::-1]


def board_points_m(board: Board) -> Floats:
    """Return (rows, columns, 3) inner corners in the board's own frame [m]."""
    row, column = np.mgrid[: board.rows, : board.columns]
    return np.stack([column, row, np.zeros_like(row)], axis=-1) * board.square_m


def calibrate_cameras(
    seen: Sequence[Sequence[Floats | None]],
    board: Board,
    marks_m: Floats,
    placed_to_m: float,
    size: tuple[int, int],
) -> CalibratedCameras:
    """Adjust both cameras and all boards at once, so that the corners are where they were seen.

    Parameters
    ----------
    seen
        For each board and each of the two cameras, its corners as `find_corners` gives them. The first M
        boards were flat on the wall.
    board
        The board.
    marks_m
        (M, 2) where its first inner corner was then.
    placed_to_m
        Standard deviation of either end's place on the wall.
    size
        Width and height of the images [pixels].

    Raises
    ------
    CalibrationError
        If a camera did not see the board on the wall, or too few boards, or corners do not fit.
    """
    _refuse_unseen(seen, len(marks_m))
    points_m = board_points_m(board)
    start = _first_guess(seen, points_m, marks_m, size)
    index = [n for n, pair in enumerate(seen) if any(corners is not None for corners in pair)]
    blank = np.full((*points_m.shape[:2], 2), np.nan)
    pixels = np.array([[blank if corners is None else corners for corners in seen[n]] for n in index])
    along_m = (board.columns - 1) * board.square_m
    # a board on the wall may be off along x, along y, and turned; the others are wherever they are
    slack = np.tile([placed_to_m, placed_to_m, placed_to_m * np.sqrt(2) / along_m], len(marks_m))
    good = np.isfinite(pixels[..., 0])
    sigma_px = ROUGH_PX

    def apart_px(numbers: Floats) -> Floats:
        cameras, wall, free = _unpack(numbers, len(marks_m))
        places = _places(points_m, marks_m, wall, free)
        return np.stack([camera.project(places) for camera in cameras], axis=1) - pixels

    def residuals(numbers: Floats) -> Floats:
        return np.concatenate(
            [apart_px(numbers)[good].ravel() / sigma_px, numbers[2 * NUMBERS :][: len(slack)] / slack]
        )

    # wrong corners are left out first; then it is known how well the others are found
    fit = least_squares(residuals, start, x_scale="jac", loss="soft_l1", max_nfev=40)
    off_px = np.linalg.norm(apart_px(fit.x), axis=-1)
    right = good & (off_px < WRONG * max(float(np.median(off_px[good])) / 1.18, 0.01))
    if (good & ~right).sum() > MOST_WRONG * good.sum() or float(np.median(off_px[good])) > WORST_CORNERS_PX:
        raise CalibrationError(
            f"the corners of the boards are {np.median(off_px[good]):.2f} pixels (median) from any pair of "
            f"cameras that could have seen them, and {(good & ~right).sum()} of {good.sum()} are far off: "
            "was a board moved between two pictures, is it flat, and are its numbers of corners and its "
            "squares as configured?"
        )
    good = right
    for _ in range(2):
        fit = least_squares(residuals, fit.x, x_scale="jac")
        free = 2 * good.sum() - len(fit.x) + len(slack)
        sigma_px *= float(np.sqrt((fit.fun[: -len(slack)] ** 2).sum() / free))
    covariance = np.linalg.inv(fit.jac.T @ fit.jac)[: 2 * NUMBERS, : 2 * NUMBERS]
    return CalibratedCameras(_unpack(fit.x, len(marks_m))[0], covariance, float(np.sqrt(2) * sigma_px))


def _unpack(numbers: Floats, marks: int) -> tuple[tuple[CameraModel, CameraModel], Floats, Floats]:
    """Return cameras, the (M, 3) numbers of the boards on the wall and the (n, 6) of the others."""
    first, second, rest = np.split(numbers, [NUMBERS, 2 * NUMBERS])
    wall, free = np.split(rest, [3 * marks])
    return (CameraModel(first), CameraModel(second)), wall.reshape(-1, 3), free.reshape(-1, 6)


def _places(points_m: Floats, marks_m: Floats, wall: Floats, free: Floats) -> Floats:
    """Return (boards, rows, columns, 3) corners in the wall's frame [m]."""
    flat = np.column_stack([np.zeros((len(wall), 2)), wall[:, 2], marks_m + wall[:, :2], np.zeros(len(wall))])
    poses = np.concatenate([flat, free])
    turns = Rotation.from_rotvec(poses[:, :3]).as_matrix()
    return np.asarray(np.einsum("bij,rcj->brci", turns, points_m) + poses[:, None, None, 3:])


def _refuse_unseen(seen: Sequence[Sequence[Floats | None]], marks: int) -> None:
    for number in range(2):
        unseen = [index for index in range(marks) if index >= len(seen) or seen[index][number] is None]
        if unseen or not marks:
            raise CalibrationError(
                f"camera {number + 1} does not see the whole board on the wall (board {unseen or 0}): where "
                "the wall is cannot be told. Light it evenly, keep hands off its corners, put its marks "
                "where both cameras see them, and check the configured numbers of corners"
            )
        boards = sum(pair[number] is not None for pair in seen)
        if boards < LEAST_BOARDS:
            raise CalibrationError(
                f"camera {number + 1} sees the whole board in {boards} of {len(seen)} pictures, "
                f"{LEAST_BOARDS} are needed: hold it where both cameras see it, still and tilted"
            )


def _first_guess(
    seen: Sequence[Sequence[Floats | None]],
    points_m: Floats,
    marks_m: Floats,
    size: tuple[int, int],
) -> Floats:
    """Return what each camera says alone, by OpenCV: cameras, and boards by the first that sees them."""
    cv2 = opencv()
    flat_m = points_m.reshape(-1, 3).astype(np.float32)
    cameras: list[CameraModel] = []
    boards: dict[int, Floats] = {}
    for number in range(2):
        mine = [(index, corners) for index, pair in enumerate(seen) if (corners := pair[number]) is not None]
        pixels = [np.reshape(corners, (-1, 1, 2)).astype(np.float32) for _, corners in mine]
        _, matrix, distortion, turns, shifts = cv2.calibrateCamera(
            [flat_m] * len(mine), pixels, size, None, None, flags=cv2.CALIB_FIX_K3
        )
        turn, shift_m = Rotation.from_rotvec(np.ravel(turns[0])), np.ravel(shifts[0])
        shift_m = shift_m - turn.apply((*marks_m[mine[0][0]], 0.0))  # the wall's frame, not the board's
        cameras.append(CameraModel.of(matrix, distortion, turn, shift_m))
        for (index, _), of_board, board_shift_m in zip(mine, turns, shifts, strict=True):
            relative = turn.inv() * Rotation.from_rotvec(np.ravel(of_board))
            place_m = turn.inv().apply(np.ravel(board_shift_m) - shift_m)
            boards.setdefault(index, np.array([*relative.as_rotvec(), *place_m]))
    free = [boards[index] for index in sorted(boards) if index >= len(marks_m)]
    return np.concatenate([*(camera.numbers for camera in cameras), np.zeros(3 * len(marks_m)), *free])
