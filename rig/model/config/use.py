"""Sections of how a rig is used: scans, calibrations, and the cameras of these; and notes of people."""

from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Field

from rig.errors import printable
from rig.model.config.section import Section
from rig.model.quantities import Metres, Seconds


class ScanConfig(Section):
    """The scan, unless the command line gives other values."""

    columns: int = Field(180, ge=2)
    """Positions along x."""
    rows: int = Field(130, ge=2)
    """Positions along y."""
    spacing_m: Metres = Field(0.01, gt=0)
    """Distance between positions."""
    row_spacing_m: Metres | None = Field(None, gt=0)
    """Distance between lines, if it differs: a detector of many pixels sees what is between them."""
    exposure_s: Seconds = Field(0.01, gt=0)
    """Measurement time at each position."""
    skip_m: Metres = Field(0.04, ge=0)
    """Side of the square around the detector's spot that is not scanned."""


class CalibrationConfig(Section):
    """Where calibrations are kept, and whether they are used."""

    folder: Path = Path("calibrations")
    """Folder of the calibrations. A relative path starts at the folder of the configuration file that has
    this key, and at the working directory for the built-in rig, which has no file."""
    use: bool = True
    """Whether scans use them."""


class CamerasConfig(Section):
    """The cameras that see the relay wall, and the checkerboard by which they are calibrated."""

    addresses: tuple[str, ...] = ()
    """Numbers, device files or URLs of two cameras, as OpenCV opens them."""
    board_columns: int = Field(9, ge=3)
    """Inner corners of the board along its columns; of this and board_rows, one must be odd and the other
    even."""
    board_rows: int = Field(6, ge=3)
    """Inner corners along its rows."""
    board_square_m: Metres = Field(0.08, gt=0)
    """Side of a square."""
    board_marks_m: tuple[tuple[Metres, Metres], ...] = ((-0.95, -0.2), (-0.32, -0.2), (0.31, -0.2))
    """Marks on the wall for the board's first inner corner; it is held flat on the wall at each of them."""
    board_placed_to_m: Metres = Field(0.2e-3, gt=0)
    """Standard deviation of the distance of either end of the board from its mark."""


#: Text that a person wrote; control characters in it become escapes.
Words = Annotated[str, Field(max_length=4000), AfterValidator(lambda text: printable(text).strip())]


class NotesConfig(Section):
    """Notes of people on a scan. They do not change the measurement."""

    operator: Words = ""
    """Who measures."""
    sample: Words = ""
    """What is measured: the hidden object, the wall."""
    purpose: Words = ""
    """What the scan is for, in a few words."""
    note: Words = ""
    """Other notes."""

    def said(self) -> dict[str, str]:
        """Return what was said, by name."""
        return {name: text for name, text in self.model_dump().items() if text}
