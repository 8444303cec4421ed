"""Two cameras calibrated by a checkerboard: held flat on the wall at marks, and then freely.

OpenCV's terms: camera frame x right and y down in the image, z forward; a point X of the wall's frame is
R X + t there; pinhole with the distortion of Brown (Photogrammetric Engineering 37, 1971).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.optimize import OptimizeResult, least_squares
from scipy.spatial.transform import Rotation

from rig.calibrate import Floats, require
from rig.errors import UsageError
from rig.model.devices import Board

#: Of a camera, in the order of OpenCV's Jacobian: rotation vector [rad], translation [m], fx, fy, cx, cy
#: [pixels], k1, k2, p1, p2.
NUMBERS = 14
#: Fewest boards that each camera has to see, the one on the wall among them.
MIN_BOARDS = 6
#: Largest median distance of corners from their model [pixels].
MAX_CORNERS_PX = 0.5
#: How well a corner is found, as long as nothing else is known: standard deviation along either axis
#: [pixels].
ROUGH_PX = 0.1
#: Corners are searched for in an image no wider than this [pixels], and then refined in the whole one.
SEARCHED_PX = 800
#: A corner is refined with what is around it, by this part of the distance to its neighbours.
REFINED_PART = 0.3
#: A corner so many standard deviations off is a wrong one; no more than this part of them may be.
WRONG, MAX_WRONG = 6.0, 0.03


#: What to do where OpenCV is missing.
WITHOUT_OPENCV = (
    "OpenCV is not installed: pip install opencv-python-headless (or, in this program's source folder, "
    "pip install '.[cameras]'), or calibrate without cameras: rig calibrate galvo --method flight"
)


def opencv() -> Any:
    """Return the module, which only cameras need; raises UsageError if it is not installed."""
    try:
        import cv2
    except ImportError:
        raise UsageError(f"calibrating cameras: {WITHOUT_OPENCV}") from None
    return cv2


@dataclass(frozen=True)
class CameraModel:
    """A camera in the wall's frame, by its (14,) numbers, see `NUMBERS`."""

    numbers: Floats

    @classmethod
    def of(cls, matrix: Floats, distortion: Floats, turn: Rotation, shift_m: Floats) -> Self:
        """Put together from OpenCV's camera matrix (3, 3), distortion (k1, k2, p1, p2, ...) and pose."""
        inner = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *np.ravel(distortion)[:4]]
        return cls(np.array([*turn.as_rotvec(), *shift_m, *inner]))

    @property
    def _lens(self) -> tuple[Floats, Floats]:
        """Camera matrix and distortion."""
        fx, fy, cx, cy = self.numbers[6:10]
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), self.numbers[10:]

    @property
    def pose(self) -> Floats:
        """(3, 4) [R t]."""
        return np.column_stack([Rotation.from_rotvec(self.numbers[:3]).as_matrix(), self.numbers[3:6]])

    @property
    def position_m(self) -> Floats:
        """(3,) where it stands [m]."""
        return -self.pose[:, :3].T @ self.pose[:, 3]

    def project(self, points_m: Floats) -> Floats:
        """(..., 3) points [m] to (..., 2) pixels (column, row)."""
        return self.projected(points_m.reshape(-1, 3))[0].reshape(*points_m.shape[:-1], 2)

    def projected(self, points_m: Floats) -> tuple[Floats, Floats, Floats]:
        """Return pixels of (N, 3) points, (N, 2), with their derivatives.

        These are (N, 2, 14) by the camera's numbers and (N, 2, 3) by the point.
        """
        pixels, slopes = opencv().projectPoints(points_m, self.numbers[:3], self.numbers[3:6], *self._lens)
        slopes = slopes.reshape(-1, 2, NUMBERS)
        return pixels.reshape(-1, 2), slopes, slopes[..., 3:6] @ self.pose[:, :3]

    def ideal(self, pixels: Floats) -> Floats:
        """(N, 2) pixels to (N, 2) tangents x / z, y / z of the rays in the camera's frame."""
        cv2 = opencv()
        stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-12)
        return cv2.undistortPoints(pixels.reshape(-1, 1, 2), *self._lens, criteria=stop).reshape(-1, 2)


@dataclass(frozen=True)
class CalibratedCameras:
    """Both cameras in the wall's frame, as far as the board on the wall gives it.

    With them the (28, 28) covariance of the first one's numbers and then the second's, and the root mean
    square distance of the corners from their model [pixels].
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


class _Bundle:
    """The corners of B boards as both cameras see them, by all U unknown numbers.

    These are both cameras', then three for each of the M boards on the wall (off along x, along y, turned
    about z), then six for each other board (rotation vector and place).
    """

    def __init__(self, points_m: Floats, marks_m: Floats, boards: int) -> None:
        self._points_m = points_m.reshape(-1, 3)
        walls = len(marks_m)
        flat = np.zeros((6, 3))
        flat[[3, 4, 2], [0, 1, 2]] = 1
        self._spread = block_diag(*[flat] * walls, *[np.eye(6)] * (boards - walls))
        self._fixed = np.zeros((boards, 6))
        self._fixed[:walls, 3:5] = marks_m

    def images(self, numbers: Floats) -> tuple[Floats, Floats]:
        """Return (B, 2, corners, 2) pixels and their (..., U) derivatives."""
        cv2 = opencv()
        poses = self._fixed + (self._spread @ numbers[2 * NUMBERS :]).reshape(-1, 6)
        pixels = np.zeros((len(poses), 2, len(self._points_m), 2))
        slopes = np.zeros((*pixels.shape, len(numbers)))
        for index, pose in enumerate(poses):
            by_unknown = self._spread[6 * index : 6 * index + 6]
            for number, camera in enumerate(cameras_of(numbers)):
                own = slopes[index, number, ..., number * NUMBERS : (number + 1) * NUMBERS]
                pose_seen = cv2.composeRT(pose[:3], pose[3:], camera.numbers[:3], camera.numbers[3:6])
                turn, shift_m, *by = map(np.squeeze, pose_seen)
                by_board, by_camera = np.split(np.block([by[:4], by[4:]]), 2, axis=1)
                both = CameraModel(np.concatenate([turn, shift_m, camera.numbers[6:]]))
                pixels[index, number], by_both, _ = both.projected(self._points_m)
                by_pose, by_lens = by_both[..., :6], by_both[..., 6:]
                own[...] = np.concatenate([by_pose @ by_camera, by_lens], axis=-1)
                slopes[index, number, ..., 2 * NUMBERS :] = by_pose @ by_board @ by_unknown
        return pixels, slopes


def cameras_of(numbers: Floats) -> tuple[CameraModel, CameraModel]:
    """Return both cameras, whose numbers come first."""
    return CameraModel(numbers[:NUMBERS]), CameraModel(numbers[NUMBERS : 2 * NUMBERS])


def calibrate_cameras(
    corners: Sequence[Sequence[Floats | None]],
    board: Board,
    marks_m: Floats,
    placed_to_m: float,
    size: tuple[int, int],
) -> CalibratedCameras:
    """Adjust both cameras and all boards at once, so that the corners are where they were seen.

    Raises CalibrationError if a camera did not see the board on the wall, or too few boards, or corners do
    not fit.

    Parameters
    ----------
    corners
        For each board and each of the two cameras, its corners as `find_corners` gives them.
    marks_m, placed_to_m
        The first M boards were flat on the wall: (M, 2) where their first inner corner was, and the standard
        deviation of either end's place.
    size
        Width and height of the images [pixels].
    """
    _refuse_unseen(corners, len(marks_m))
    points_m = board_points_m(board)
    start = _first_guess(corners, points_m, marks_m, size)
    given = [pair for pair in corners if any(one is not None for one in pair)]
    blank = np.full((*points_m.shape[:2], 2), np.nan)
    pixels = np.array([[blank if one is None else one for one in pair] for pair in given])
    pixels = pixels.reshape(len(given), 2, -1, 2)
    bundle = _Bundle(points_m, marks_m, len(given))
    along_m = (board.columns - 1) * board.square_m
    # a board on the wall may be off along x, along y, and turned; the others are wherever they are
    slack = np.tile([placed_to_m, placed_to_m, placed_to_m * np.sqrt(2) / along_m], len(marks_m))
    placed = np.arange(2 * NUMBERS, 2 * NUMBERS + len(slack))
    priors = np.zeros((len(slack), len(start)))
    priors[np.arange(len(slack)), placed] = 1 / slack

    def adjusted(start: Floats, good: NDArray[np.bool_], sigma_px: float, **how: Any) -> OptimizeResult:
        def residuals(numbers: Floats) -> Floats:
            apart_px = (bundle.images(numbers)[0] - pixels)[good]
            return np.concatenate([apart_px.ravel() / sigma_px, priors @ numbers])

        def slopes(numbers: Floats) -> Floats:
            by_number = bundle.images(numbers)[1][good]
            return np.concatenate([by_number.reshape(-1, len(numbers)) / sigma_px, priors])

        return least_squares(residuals, start, jac=slopes, x_scale="jac", **how)

    # wrong corners are left out first; then it is known how well the others are found. Neither solver takes
    # a singular value decomposition of all the residuals, which is slow where threads compete
    good = np.isfinite(pixels[..., 0])
    fit = adjusted(start, good, ROUGH_PX, loss="soft_l1", tr_solver="lsmr", max_nfev=40)
    off_px = np.linalg.norm(bundle.images(fit.x)[0] - pixels, axis=-1)
    median_px = float(np.median(off_px[good]))
    right = good & (off_px < WRONG * max(median_px / 1.18, 0.01))
    wrong = int((good & ~right).sum())
    require(
        wrong <= MAX_WRONG * good.sum() and median_px <= MAX_CORNERS_PX,
        f"the corners of the boards are {median_px:.2f} pixels (median) from any pair of cameras that could "
        f"have seen them, and {wrong} of {good.sum()} are far off: was a board moved between two pictures, "
        "is it flat, and are its numbers of corners and its squares as configured?",
    )
    sigma_px = ROUGH_PX
    for _ in range(2):
        fit = adjusted(fit.x, right, sigma_px, method="lm")
        free = 2 * right.sum() - len(fit.x) + len(slack)
        sigma_px *= float(np.sqrt((fit.fun[: -len(slack)] ** 2).sum() / free))
    covariance = np.linalg.inv(fit.jac.T @ fit.jac)[: 2 * NUMBERS, : 2 * NUMBERS]
    return CalibratedCameras(cameras_of(fit.x), covariance, float(np.sqrt(2) * sigma_px))


def _refuse_unseen(corners: Sequence[Sequence[Floats | None]], walls: int) -> None:
    for number in range(2):
        unseen = [index for index in range(walls) if index >= len(corners) or corners[index][number] is None]
        require(
            walls and not unseen,
            f"camera {number + 1} does not see the whole board on the wall (board {unseen or 0}): "
            "the place of the wall cannot be determined. Light it evenly, keep hands off its corners, "
            "put its marks where both "
            "cameras see them, and check the configured numbers of corners",
        )
        boards = sum(pair[number] is not None for pair in corners)
        require(
            boards >= MIN_BOARDS,
            f"camera {number + 1} sees the whole board in {boards} of {len(corners)} pictures, "
            f"but {MIN_BOARDS} are needed: hold it where both cameras see it, still and tilted",
        )


def _first_guess(
    corners: Sequence[Sequence[Floats | None]], points_m: Floats, marks_m: Floats, size: tuple[int, int]
) -> Floats:
    """Return what each camera says alone, by OpenCV: cameras, and boards by the first that sees them."""
    cv2 = opencv()
    flat_m = points_m.reshape(-1, 3).astype(np.float32)
    cameras: list[Floats] = []
    boards: dict[int, Floats] = {}
    for number in range(2):
        mine = [(index, one) for index, pair in enumerate(corners) if (one := pair[number]) is not None]
        pixels = [np.reshape(one, (-1, 1, 2)).astype(np.float32) for _, one in mine]
        _, matrix, distortion, turns, shifts = cv2.calibrateCamera(
            [flat_m] * len(mine), pixels, size, None, None, flags=cv2.CALIB_FIX_K3
        )
        turn, shift_m = Rotation.from_rotvec(np.ravel(turns[0])), np.ravel(shifts[0])
        shift_m = shift_m - turn.apply((*marks_m[mine[0][0]], 0.0))  # the wall's frame, not the board's
        cameras.append(CameraModel.of(matrix, distortion, turn, shift_m).numbers)
        for (index, _), of_board, board_shift_m in zip(mine, turns, shifts, strict=True):
            relative = turn.inv() * Rotation.from_rotvec(np.ravel(of_board))
            place_m = turn.inv().apply(np.ravel(board_shift_m) - shift_m)
            boards.setdefault(index, np.array([*relative.as_rotvec(), *place_m]))
    free = [boards[index] for index in sorted(boards) if index >= len(marks_m)]
    return np.concatenate([*cameras, np.zeros(3 * len(marks_m)), *free])
