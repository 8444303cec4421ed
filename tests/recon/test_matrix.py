"""Every camera with every solver on every kind of scan: a planted point is found, or refused by name."""

import numpy as np
import pytest

from recon.camera import ConfocalCamera, PhotoCamera, TransientCamera
from recon.capture import ArrayHistograms, Capture
from recon.errors import GeometryError, ParameterError
from recon.filming import video
from recon.grid import VoxelGrid
from recon.imaging import image
from recon.registry import WAVE_SOLVERS
from recon.wave import VirtualPulse
from support.hidden_points import C, histograms, wall

WAVELENGTH = 0.06
PULSE = VirtualPulse(WAVELENGTH, 6)
LASER = wall(24, 20, 0.02)
DETECTOR = np.array([-0.04, 0.03, 0.0])
BIN = 8e-12
NEAR, FAR = np.array([0.083, -0.057, 0.613]), np.array([0.083, -0.057, 1.413])


RANDOM = np.random.default_rng(6)
JITTERED = LASER + RANDOM.uniform(-6e-3, 6e-3, LASER.shape) * [1, 1, 0]
CURVED = JITTERED + 0.8 * JITTERED[:, :1] ** 2 * [0, 0, 1]
#: Laser spots and detector spots.
SCANS = {
    "one-detector": (LASER, DETECTOR[None]),
    "confocal": (LASER, LASER),
    "jittered": (JITTERED, DETECTOR[None]),
    "jittered-confocal": (JITTERED, JITTERED),
    "curved": (CURVED, DETECTOR[None]),
    "curved-confocal": (CURVED, CURVED),
    "pairs": (LASER, RANDOM.permutation(LASER)),
    "curved-pairs": (CURVED, RANDOM.permutation(CURVED)),
}


def taken(point_m, scan, first_bin_s=0.0, bins=1500):
    laser_m, spots_m = SCANS[scan]
    counts = histograms(point_m, laser_m, spots_m, bins, BIN, first_bin_s, falloff=False)
    return Capture(ArrayHistograms(counts), BIN, np.array([first_bin_s]), laser_m, spots_m)


def steps_m(point_m, camera):
    """Sides of a voxel: in depth an eighth of the depth of focus, where nothing but focus tells depth."""
    cosine = point_m[2] / np.hypot(point_m[2], np.linalg.norm(LASER, axis=1).max())
    depth_m = 0.02 if camera == "confocal" else WAVELENGTH / (1 - cosine) / 8
    across_m = 0.01 * point_m[2] / NEAR[2]
    return np.array([across_m, across_m, depth_m])


def around(point_m, camera, n=3):
    # 0.3 voxels off a voxel's centre, so that the nearest voxel is no accident.
    x_m, y_m, z_m = (
        at + step * (np.arange(-n, n + 1) + 0.3)
        for at, step in zip(point_m, steps_m(point_m, camera), strict=True)
    )
    return VoxelGrid(x_m, y_m, z_m[z_m > 0.1])


def frames_s(point_m):
    return np.linalg.norm(point_m - DETECTOR) / C + 0.05e-9 * (np.arange(-4, 5) + 0.3)


def seen(capture, camera, solver, grid, point_m):
    """(T, z, y, x) amplitude by what a point of count one would give if it were there.

    All terms of U then have one phase, and |U| <= sum_p 1/r_p times the pulse's peak: the maximum of the
    ratio is at the point, whatever the camera.
    """
    if camera == "transient":
        frames = []
        video(
            capture,
            PULSE,
            grid,
            TransientCamera(frames_s(point_m)),
            solver=solver,
            sink=lambda index, plane: frames.append(plane),
        )
        amplitude = np.sqrt(np.stack(frames, axis=1))
    else:
        kind = {"confocal": ConfocalCamera, "photo": PhotoCamera}[camera]
        amplitude = np.abs(image(capture, PULSE, grid, solver=solver, camera=kind()).field)[None]
    z, y, x = np.meshgrid(grid.z_m, grid.y_m, grid.x_m, indexing="ij")
    r_p = np.linalg.norm(np.stack([x, y, z], axis=-1)[..., None, :] - capture.laser_m, axis=-1)
    return amplitude / (1 / r_p).sum(axis=-1)


@pytest.mark.parametrize("first_bin_s", [0.0, 2.4e-9])
@pytest.mark.parametrize("camera", ["confocal", "photo", "transient"])
@pytest.mark.parametrize("solver", WAVE_SOLVERS)
@pytest.mark.parametrize("scan", SCANS)
def test_the_point_is_found_or_refused(scan, solver, camera, first_bin_s):
    # S.18: pi d^4/(4 L^3 lambda) is 0.35 at the near point and 0.03 at the far one, radians.
    point_m = FAR if solver == "fresnel" else NEAR
    capture, grid = taken(point_m, scan, first_bin_s), around(point_m, camera)
    if len(capture.detector_m) > 1 and camera == "transient":
        with pytest.raises(GeometryError, match=r"transient camera: .* own detector spot"):
            seen(capture, camera, solver, grid, point_m)
        return
    if solver == "fresnel" and scan not in ("one-detector", "confocal"):
        with pytest.raises(GeometryError, match="Use the rsd solver"):
            seen(capture, camera, solver, grid, point_m)
        return
    if solver == "backprojection" and camera == "photo":
        with pytest.raises(ParameterError, match=r"photo camera, .* infinitely long pulse"):
            seen(capture, camera, solver, grid, point_m)
        return
    ratio = seen(capture, camera, solver, grid, point_m)
    t, k, j, i = np.unravel_index(ratio.argmax(), ratio.shape)
    found = np.array([grid.x_m[i], grid.y_m[j], grid.z_m[k]])
    assert np.all(np.abs(found - point_m) <= steps_m(point_m, camera) / 2)
    if camera == "transient":
        # Once-scattered light is seen when the flash arrives. Half a frame; and a voxel that is nearer to the
        # aperture than the point is, by dz, shows the same light dz/c later.
        error_s = frames_s(point_m)[t] - np.linalg.norm(point_m - DETECTOR) / C
        assert abs(error_s) <= 0.025e-9 + abs(found[2] - point_m[2]) / C
    # What the law promises: 100 counts in phase. Sharing a count between bins of lambda/25 damps by
    # (pi/25)^2/2, one voxel in depth by a few percent.
    assert ratio.max() == pytest.approx(100, rel=0.05)


@pytest.mark.parametrize(
    ("scan", "camera"),
    [
        (scan, camera)
        for scan, (_, spots_m) in SCANS.items()
        for camera in ("confocal", "photo", "transient")
        if len(spots_m) == 1 or camera != "transient"
    ],
)
def test_solvers_agree(scan, camera):
    capture, grid = taken(NEAR, scan), around(NEAR, camera)
    ratio = {name: seen(capture, camera, name, grid, NEAR) for name in ("rsd", "direct")}
    # Single precision, and interpolation between lattice points to 3e-4 along each axis, or in tables to
    # 1.2e-4.
    assert np.abs(ratio["rsd"] - ratio["direct"]).max() < 1e-3 * ratio["direct"].max()
    if camera != "photo":
        in_time = seen(capture, camera, "backprojection", grid, NEAR)
        # The band is cut at 3 sigma, which takes 0.27 % of the pulse away.
        assert np.abs(in_time - ratio["direct"]).max() < 1e-2 * ratio["direct"].max()


def test_fresnel_nears_the_exact_wave_as_the_aperture_shrinks():
    worst = []
    for depth_m in (0.8, 1.6):
        grid = VoxelGrid(np.array([0.01]), np.array([0.01]), np.array([depth_m]))
        capture = taken(np.array([0.01, 0.01, depth_m]), "one-detector")
        exact, near = (image(capture, PULSE, grid, solver=name).field.item() for name in ("rsd", "fresnel"))
        worst.append(abs(near - exact) / abs(exact))
    # Phase and amplitude errors are of fourth and second order in the aperture's angle: a sum of 1/8 and 1/4
    # of them at least at twice the depth.
    assert worst[1] < worst[0] / 3
