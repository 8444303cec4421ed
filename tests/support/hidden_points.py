"""Histograms of hidden points and the image's defining sum, in few lines that share nothing with `recon`."""

import numpy as np

C = 299_792_458.0


def wall(nx, ny, pitch_m, centre_m=(0.0, 0.0)):
    """(nx ny, 3) positions, row by row."""
    x, y = np.meshgrid(
        (np.arange(nx) - (nx - 1) / 2) * pitch_m + centre_m[0],
        (np.arange(ny) - (ny - 1) / 2) * pitch_m + centre_m[1],
    )
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)


def histograms(points_m, laser_m, detector_m, bins, bin_width_s, first_bin_s=0.0, falloff=True):
    """A count at (|p - x| + |x - c|)/c for each point, shared linearly between the two nearest bins."""
    detector_m = np.broadcast_to(detector_m, laser_m.shape)
    first_bin_s = np.broadcast_to(first_bin_s, len(laser_m))
    counts = np.zeros((len(laser_m), bins), np.float32)
    rows = np.arange(len(laser_m))
    for point in np.atleast_2d(points_m):
        r_p = np.linalg.norm(laser_m - point, axis=1)
        r_c = np.linalg.norm(detector_m - point, axis=1)
        at = ((r_p + r_c) / C - first_bin_s) / bin_width_s - 0.5
        n = np.floor(at).astype(int)
        strength = 100 / (r_p * r_c) ** 2 if falloff else np.full(len(rows), 100.0)
        for shift, share in ((0, 1 - (at - n)), (1, at - n)):
            inside = (n + shift >= 0) & (n + shift < bins)
            np.add.at(counts, (rows[inside], n[inside] + shift), (strength * share)[inside])
    return counts


def direct_sum(counts, times_s, laser_m, detector_m, grid, frequencies, weights, confocal):
    """U(v) = sum_w g exp(i w r_c/c) sum_p H^ exp(i w r_p/c)/r_p in double precision, term by term.

    `times_s` is (bins,) or (positions, bins); confocal has 2 r_p in place of r_p + r_c.
    """
    times_s = np.broadcast_to(times_s, counts.shape)
    z, y, x = np.meshgrid(grid.z_m, grid.y_m, grid.x_m, indexing="ij")
    voxels = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    r_p = np.linalg.norm(voxels[:, None] - laser_m, axis=2)
    path = 2 * r_p if confocal else r_p + np.linalg.norm(voxels - detector_m[0], axis=1)[:, None]
    total = np.zeros(len(voxels), complex)
    for frequency, weight in zip(frequencies, weights, strict=True):
        H = (counts * np.exp(-1j * frequency * times_s)).sum(axis=1)
        total += weight * (np.exp(1j * frequency * path / C) / r_p) @ H
    return total.reshape(grid.shape)
