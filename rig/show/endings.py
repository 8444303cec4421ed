"""Names that pictures and videos can have: checked before any work is done, and before anything is drawn."""

import shutil
from pathlib import Path

from rig.errors import UsageError

#: Endings of pictures; matplotlib writes them all.
PICTURES = ("eps", "jpeg", "jpg", "pdf", "png", "ps", "svg", "svgz", "tif", "tiff", "webp")
VIDEOS = (".gif", ".mp4")


def check_picture(path: Path) -> None:
    """Refuse a name that no picture can have.

    Raises
    ------
    UsageError
        If the ending is not that of a picture.
    """
    if path.suffix.lower().lstrip(".") not in PICTURES:
        raise UsageError(
            f"cannot write the picture {path}: its ending '{path.suffix}' is not one of "
            f"{', '.join(PICTURES)}; use .png, or .pdf for print"
        )


def check_video(path: Path) -> None:
    """Refuse a name that no video can have.

    Raises
    ------
    UsageError
        If the ending is unknown, or MP4 is asked for and ffmpeg is not installed.
    """
    if path.suffix.lower() not in VIDEOS:
        raise UsageError(f"cannot write the video {path}: its ending must be .gif or .mp4")
    if path.suffix.lower() == ".mp4" and shutil.which("ffmpeg") is None:
        raise UsageError(
            f"cannot write the video {path}: MP4 needs the program ffmpeg, which is not on the PATH; "
            f"install it, or write a GIF: {path.with_suffix('.gif')}"
        )
