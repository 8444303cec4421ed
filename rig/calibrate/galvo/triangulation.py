"""From the pixels of both cameras to places on the wall: triangulated, a plane laid through, its frame."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.optimize import approx_fprime

from rig.calibrate import Floats, require
from rig.calibrate.galvo.cameras import CalibratedCameras, CameraModel, cameras_of, opencv

#: Fewest spots from which a wall is told, and the part of them that has to be on it.
MIN_SPOTS, MIN_ON_WALL = 12, 0.8
#: A spot is on the wall up to so many standard deviations, and at any rate up to this distance.
OFF_WALL, OFF_WALL_M = 5.0, 3e-3
#: Planes through three spots that are tried.
TRIED = 200
#: Least angle between a camera's view of the spots and the wall.
MIN_VIEW_RAD = np.radians(12.0)
#: Largest root mean square distance at which the cameras' rays may pass each other [pixels].
MAX_MISS_PX = 1.0

Cameras = tuple[CameraModel, CameraModel]


@dataclass(frozen=True)
class WallPlane:
    """The wall as spots show it, in the frame of the board: (3,) origin, and (3, 3) rows x, y and z."""

    origin_m: Floats
    axes: Floats


def locate(
    calibrated: CalibratedCameras, pixels: Floats, covariances: Floats
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Return where spots are on the wall, with errors of spots and of cameras.

    Raises CalibrationError if there are too few spots, the cameras contradict each other, too many spots are
    off any plane, or a camera sees the wall nearly edge-on.

    Parameters
    ----------
    calibrated
        Both cameras.
    pixels, covariances
        (N, 2, 2) spot, camera, (column, row); and (N, 2, 2, 2) their covariances [pixels^2].

    Returns
    -------
    (K, 2) x and y [m]; their (2K, 2K) covariance, since what cameras get wrong they get wrong for all; and
    (N,) which of the spots given were on the wall.
    """
    number = len(pixels)
    require(
        number >= MIN_SPOTS,
        f"{number} spots are too few for a calibration, {MIN_SPOTS} are needed: measure more angles",
    )
    points_m, spread_m2, missed_px = triangulate(calibrated.cameras, pixels, covariances)
    require(
        missed_px <= MAX_MISS_PX,
        f"the two cameras contradict each other about the spots by {missed_px:.1f} pixels (root mean "
        f"square), more than {MAX_MISS_PX:g}: was one moved after the boards were shown? Show them again",
    )
    good = on_one_plane(points_m, spread_m2)
    require(
        good.sum() >= max(MIN_SPOTS, MIN_ON_WALL * number),
        f"only {good.sum()} of {number} spots lie on one plane: does the beam meet something in front of "
        "the wall, or is the wall not flat? Clear the way, or measure a smaller area",
    )
    pixels, covariances, points_m = pixels[good], covariances[good], points_m[good]
    wall = plane_of(points_m, spread_m2[good])
    _refuse_edge_on(calibrated.cameras, points_m, wall)
    spots_m, spread_m2 = _on_wall(calibrated.cameras, pixels, covariances, points_m, wall)

    def with_numbers(numbers: Floats) -> Floats:
        cameras = cameras_of(numbers)
        there_m, spread_m2, _ = triangulate(cameras, pixels, covariances)
        return _on_wall(cameras, pixels, covariances, there_m, plane_of(there_m, spread_m2))[0].ravel()

    numbers = np.concatenate([camera.numbers for camera in calibrated.cameras])
    slopes = approx_fprime(numbers, with_numbers, 0.1 * np.sqrt(calibrated.covariance.diagonal()))
    covariance = slopes @ calibrated.covariance @ slopes.T + block_diag(*spread_m2)
    return spots_m, covariance, good


def triangulate(cameras: Cameras, pixels: Floats, covariances: Floats) -> tuple[Floats, Floats, float]:
    """Return (N, 3) points [m], their (N, 3, 3) covariances, and by how much rays miss each other [pixels].

    Points are those whose images are nearest to the pixels, in units of their errors.
    """
    ideal = [camera.ideal(pixels[:, number]).T for number, camera in enumerate(cameras)]
    points = opencv().triangulatePoints(*(camera.pose for camera in cameras), *ideal)
    return _nearest(cameras, pixels, covariances, (points[:3] / points[3]).T, np.eye(3))


def _on_wall(
    cameras: Cameras, pixels: Floats, covariances: Floats, points_m: Floats, wall: WallPlane
) -> tuple[Floats, Floats]:
    """Return (N, 2) places on the wall [m] and their (N, 2, 2) covariances from the pixels' errors."""
    along = wall.axes[:2]
    points_m = wall.origin_m + (points_m - wall.origin_m) @ along.T @ along
    points_m, spread_m2, _ = _nearest(cameras, pixels, covariances, points_m, along)
    return (points_m - wall.origin_m) @ along.T, spread_m2


def _nearest(
    cameras: Cameras, pixels: Floats, covariances: Floats, points_m: Floats, ways: Floats
) -> tuple[Floats, Floats, float]:
    """Move points along (k, 3) ``ways`` until their images are nearest to the pixels, by Gauss and Newton."""
    roots = np.linalg.inv(np.linalg.cholesky(covariances))  # (N, camera, 2, 2) make pixels' errors 1
    for _ in range(3):  # the start is nearly there: each step squares what is left
        pictures = [camera.projected(points_m) for camera in cameras]
        missing_px = pixels - np.stack([images for images, _, _ in pictures], axis=1)
        slopes = np.stack([by_point for _, _, by_point in pictures], axis=1) @ ways.T
        weighted = (roots @ slopes).reshape(len(points_m), 4, len(ways))
        missing = (roots @ missing_px[..., None]).reshape(len(points_m), 4, 1)
        spread_m2 = np.linalg.inv(weighted.swapaxes(1, 2) @ weighted)
        points_m = points_m + (spread_m2 @ weighted.swapaxes(1, 2) @ missing)[..., 0] @ ways
    missing_px = pixels - np.stack([camera.project(points_m) for camera in cameras], axis=1)
    return points_m, np.asarray(spread_m2, dtype=float), float(np.sqrt((missing_px**2).sum(axis=-1).mean()))


def on_one_plane(points_m: Floats, spread_m2: Floats) -> NDArray[np.bool_]:
    """Return which of (N, 3) points are on the plane that has most of them, of those tried through three."""
    rng = np.random.default_rng(0)
    best = np.zeros(len(points_m), bool)
    for _ in range(TRIED):
        a, b, c = points_m[rng.choice(len(points_m), 3, replace=False)]
        normal = np.cross(b - a, c - a)
        area = np.linalg.norm(normal)
        if area < 1e-6:
            continue
        normal = normal / area
        sigma_m = np.sqrt(np.einsum("i,nij,j->n", normal, spread_m2, normal))
        near = np.abs((points_m - a) @ normal) < np.maximum(OFF_WALL * sigma_m, OFF_WALL_M)
        if near.sum() > best.sum():
            best = near
    return best


def plane_of(points_m: Floats, spread_m2: Floats) -> WallPlane:
    """Lay the plane z = a + b x + c y through (N, 3) points by weighted least squares, and take its frame.

    The origin goes onto the plane along its normal, and x as far as needed to be in it.
    """
    design = np.column_stack([np.ones(len(points_m)), points_m[:, :2]])
    weight = 1 / np.sqrt(spread_m2[:, 2, 2])
    (height_m, *slope), *_ = np.linalg.lstsq(design * weight[:, None], points_m[:, 2] * weight, rcond=None)
    z = np.array([-slope[0], -slope[1], 1.0])
    z = z / np.linalg.norm(z)
    x = np.array([1.0, 0.0, 0.0]) - z[0] * z
    x = x / np.linalg.norm(x)
    return WallPlane(z * (height_m * z[2]), np.array([x, np.cross(z, x), z]))


def _refuse_edge_on(cameras: Cameras, points_m: Floats, wall: WallPlane) -> None:
    for number, camera in enumerate(cameras, 1):
        view = camera.position_m - points_m.mean(axis=0)
        angle = np.arcsin(abs(view @ wall.axes[2]) / np.linalg.norm(view))
        require(
            angle >= MIN_VIEW_RAD,
            f"camera {number} sees the wall nearly edge-on, at {np.degrees(angle):.0f} deg: "
            "its spots are not accurate across the wall. Put it where it sees the wall at "
            f"{np.degrees(MIN_VIEW_RAD):.0f} deg or more",
        )
