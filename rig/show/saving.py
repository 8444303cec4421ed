"""Pictures as files: they appear whole or not at all."""

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from rig.atomic import appearing, refusals_told
from rig.errors import DataFileError

if TYPE_CHECKING:  # who writes what another process has drawn needs nothing that draws
    from matplotlib.figure import Figure

DPI = 100


def save(figure: "Figure", path: str | Path) -> None:
    """Write a figure as a picture; its format follows the ending.

    Raises
    ------
    DataFileError
        If the picture cannot be written, or its format is not known.
    """
    path = Path(path)
    try:
        drawn = packed(figure, path.suffix)
    except ValueError as error:
        raise DataFileError(f"cannot write the picture {path}: {error}") from error
    write(drawn, path)


def packed(figure: "Figure", ending: str) -> bytes:
    """Return a figure as a picture file has it; raises ValueError if its format is not known.

    Parameters
    ----------
    figure
        What is drawn.
    ending
        Of the file, as ".png".
    """
    memory = BytesIO()
    figure.savefig(memory, dpi=DPI, format=ending.lower().lstrip("."))
    return memory.getvalue()


def write(drawn: bytes, path: Path) -> None:
    """Write a picture that is drawn; raises as `save`."""
    with refusals_told(path, "the picture "), appearing(path) as partial:
        partial.write_bytes(drawn)
