"""What can go wrong in imaging.

ReconError
├── GeometryError     positions that a solver cannot image
├── MemoryBoundError  less memory allowed than imaging needs
├── ParameterError    a wavelength, fade, grid or solver that makes no sense
└── ReachError        a volume that no bin of the record can come from
"""


class ReconError(Exception):
    """Any failure of imaging that its user can mend.

    Parameters
    ----------
    thing : str
        What failed, e.g. ``"solver rsd"``.
    asked : str
        What was asked of it.
    found : str
        What was found instead.
    remedy : str
        What a person can do about it.
    """

    def __init__(self, thing: str, asked: str, found: str, remedy: str) -> None:
        super().__init__(f"{thing}: asked for {asked}, but {found}. {remedy}")
        self.thing = thing
        self.asked = asked
        self.found = found
        self.remedy = remedy

    def __reduce__(self) -> tuple[type, tuple[str, str, str, str]]:
        """Let it pass between processes."""
        return type(self), (self.thing, self.asked, self.found, self.remedy)


class GeometryError(ReconError):
    """Raised when a solver cannot image the positions of a capture."""


class MemoryBoundError(ReconError):
    """Raised when imaging cannot stay below the memory that it was allowed."""


class ParameterError(ReconError):
    """Raised when a parameter is outside the range in which it means something."""


class ReachError(ReconError):
    """Raised when no path to the volume falls inside the record."""
