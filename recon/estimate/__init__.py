"""What a file lacks, estimated from its data: time zero, bin width, wall size. Arrays in, values out."""

from recon.estimate.first_bounce import from_first_bounce
from recon.estimate.record import profile
from recon.estimate.unknown import bin_width, time_origin, wall_size
from recon.estimate.value import Estimate, EstimateError

__all__ = [
    "Estimate",
    "EstimateError",
    "bin_width",
    "from_first_bounce",
    "profile",
    "time_origin",
    "wall_size",
]
