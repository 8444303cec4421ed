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


def histograms(
    points_m, laser_m, detector_m, bins, bin_width_s, first_bin_s=0.0, falloff=True, strengths=None
):
    """A count at (|p - x| + |x - c|)/c for each point, shared linearly between the two nearest bins."""
    detector_m = np.broadcast_to(detector_m, laser_m.shape)
    first_bin_s = np.broadcast_to(first_bin_s, len(laser_m))
    counts = np.zeros((len(laser_m), bins), np.float32)
    rows = np.arange(len(laser_m))
    points_m = np.atleast_2d(points_m)
    strengths = np.ones(len(points_m)) if strengths is None else strengths
    for point, factor in zip(points_m, strengths, strict=True):
        r_p = np.linalg.norm(laser_m - point, axis=1)
        r_c = np.linalg.norm(detector_m - point, axis=1)
        at = ((r_p + r_c) / C - first_bin_s) / bin_width_s - 0.5
        n = np.floor(at).astype(int)
        strength = factor * (100 / (r_p * r_c) ** 2 if falloff else np.full(len(rows), 100.0))
        for shift, share in ((0, 1 - (at - n)), (1, at - n)):
            inside = (n + shift >= 0) & (n + shift < bins)
            np.add.at(counts, (rows[inside], n[inside] + shift), (strength * share)[inside])
    return counts


def snake(laser_m, columns):
    """Positions row by row, every second row backwards."""
    rows = laser_m.reshape(-1, columns, 3).copy()
    rows[1::2] = rows[1::2, ::-1]
    return rows.reshape(-1, 3)


def exact(capture, result):
    """U(v) = sum_w g sum_p H^_p exp(i w (r_p + r_c)/c)/r_p in complex128, each record with its own two paths.

    Term by term, over the frequencies and bins that the solver says it used.
    """
    first = np.broadcast_to(capture.first_bin_s, capture.positions)[:, None]
    times_s = first + (np.arange(capture.bins) + 0.5) * capture.bin_width_s
    parts = []
    for block in result.depth_blocks:
        axes = np.meshgrid(result.grid.z_m[block.planes], result.grid.y_m, result.grid.x_m, indexing="ij")
        voxels = np.stack([axis.ravel() for axis in axes[::-1]], axis=1)[:, None]
        r_p = np.linalg.norm(voxels - capture.laser_m, axis=2)
        r_c = np.linalg.norm(voxels - capture.detector_m, axis=2)
        total = 0
        for frequency, weight in zip(block.band.frequencies_rad_per_s, block.band.weights, strict=True):
            turn = np.exp(-1j * frequency * times_s[:, block.bins])
            spectrum = (capture.histograms.counts[:, block.bins] * turn).sum(axis=1)
            total = total + weight * (np.exp(1j * frequency * (r_p + r_c) / C) / r_p) @ spectrum
        parts.append(total.reshape(axes[0].shape))
    return np.concatenate(parts)


def worst(found, wanted):
    """The largest difference, in parts of the largest wanted value."""
    return np.abs(found - wanted).max() / np.abs(wanted).max()
