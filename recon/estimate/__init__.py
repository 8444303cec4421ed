"""What a file lacks, estimated from its data. Arrays in, values out."""

from recon.estimate.first_bounce import from_first_bounce
from recon.estimate.value import Estimate, EstimateError

__all__ = ["Estimate", "EstimateError", "from_first_bounce"]
