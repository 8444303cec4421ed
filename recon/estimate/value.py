"""An estimate, and what is said where the data cannot tell."""

from dataclasses import dataclass

from recon.errors import ReconError


class EstimateError(ReconError):
    """Raised when a record cannot tell what it is asked for."""


@dataclass(frozen=True)
class Estimate:
    """A value that was read off the data.

    Attributes
    ----------
    quantity
        ``time-origin``, ``bin-width`` or ``wall-size``.
    value, low, high
        The value and the interval that holds the truth in 95 of 100 cases; [s] or [m].
    how
        What it was read off, in words.
    """

    quantity: str
    value: float
    low: float
    high: float
    how: str
