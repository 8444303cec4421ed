"""Numbers for an image: how wide a point is, how far off a depth, how well two shapes overlap, how noisy."""

from recon.measures.displacement import displacement_m
from recon.measures.quality import contrast, signal_to_noise, surroundings
from recon.measures.resolution import Resolution, predicted, pulse_depth_m
from recon.measures.surface import (
    CLOSE_M,
    DepthError,
    depth_error,
    overlap,
    sampled_depth,
    surface_of_mesh,
    surface_of_voxels,
)
from recon.measures.widths import Width, Widths, half_maximum_width, widths

__all__ = [
    "CLOSE_M",
    "DepthError",
    "Resolution",
    "Width",
    "Widths",
    "contrast",
    "depth_error",
    "displacement_m",
    "half_maximum_width",
    "overlap",
    "predicted",
    "pulse_depth_m",
    "sampled_depth",
    "signal_to_noise",
    "surface_of_mesh",
    "surface_of_voxels",
    "surroundings",
    "widths",
]
