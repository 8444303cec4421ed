"""Sections of how a rig is used: scans, calibrations, and the cameras of these."""

from pathlib import Path

from pydantic import Field

from rig.model.config.section import Section
from rig.model.quantities import Metres, Seconds


class ScanConfig(Section):
    """The scan when the command line does not say otherwise."""

    columns: int = Field(180, ge=2)
    rows: int = Field(130, ge=2)
    spacing_m: Metres = Field(0.01, gt=0)
    row_spacing_m: Metres | None = Field(None, gt=0)
    """Distance between lines, if it is another one: a detector of many pixels sees what is between them."""
    exposure_s: Seconds = Field(0.01, gt=0)
    skip_m: Metres = Field(0.04, ge=0)
    """Side of the square around the detector's spot that is not scanned."""


class CalibrationConfig(Section):
    """What the rig has learned of itself."""

    folder: Path = Path("calibrations")
    """Where calibrations are kept; a relative path begins where the program is called."""
    use: bool = True
    """Whether scans use them."""


class CamerasConfig(Section):
    """The cameras that see the relay wall, and the checkerboard by which they are calibrated."""

    addresses: tuple[str, ...] = ()
    """Numbers, device files or URLs of two cameras, as OpenCV opens them."""
    board_columns: int = Field(9, ge=3)
    """Inner corners along the board's columns and rows: one number odd, the other even."""
    board_rows: int = Field(6, ge=3)
    board_square_m: Metres = Field(0.08, gt=0)
    """Side of a square."""
    board_marks_m: tuple[tuple[Metres, Metres], ...] = ((-0.95, -0.2), (-0.32, -0.2), (0.31, -0.2))
    """Marks on the wall for the board's first inner corner; it is held flat on the wall at each of them."""
    board_placed_to_m: Metres = Field(0.2e-3, gt=0)
    """How well either end of the board is held to its mark, standard deviation."""
