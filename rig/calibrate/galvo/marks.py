"""The file of marks onto which the beam was steered: JSON, so that it can be written by hand too."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from rig.atomic import appearing
from rig.calibrate.galvo.flight import Marks
from rig.errors import DataFileError

FORMAT = "rig-wall-marks"
Pair = tuple[float, float]


def write_marks(path: Path, pairs: Sequence[tuple[Pair, Pair]], galvo: str) -> None:
    """Write (mark [m], commanded angles [rad]) pairs, and the identity of the mirror that was steered."""
    content = {
        "format": FORMAT,
        "version": 1,
        "galvo": galvo,
        "marks": [{"mark_m": list(mark), "mirror_rad": list(angles)} for mark, angles in pairs],
    }
    with appearing(path) as partial:
        partial.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def read_marks(path: Path, devices: Mapping[str, Mapping[str, object]]) -> tuple[Marks, str]:
    """Return the marks of a file, and its SHA-256.

    Parameters
    ----------
    path
        The file.
    devices
        Of the scan that belongs to it.

    Raises
    ------
    DataFileError
        If it cannot be read, is of another kind, or of another mirror.
    """
    try:
        data = path.read_bytes()
        content = json.loads(data)
        if content.get("format") != FORMAT or content.get("version") != 1:
            raise ValueError(f"it is no {FORMAT} of version 1")
        marks = Marks(
            np.array([one["mark_m"] for one in content["marks"]], dtype=float).reshape(-1, 2),
            np.array([one["mirror_rad"] for one in content["marks"]], dtype=float).reshape(-1, 2),
        )
        if not (np.isfinite(marks.mark_m).all() and np.isfinite(marks.mirror_rad).all()):
            raise ValueError("a number in it is none")
    except OSError as error:
        raise DataFileError(f"{path}: cannot be read ({error.strerror})") from None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise DataFileError(
            f"{path}: is no file of marks: {error}. It holds mark_m and mirror_rad, two numbers each, for "
            "every mark; see docs/calibration/galvo.md"
        ) from None
    mine, steered = devices.get("galvo", {}).get("identity"), content.get("galvo")
    if steered and mine and steered != mine:
        raise DataFileError(
            f"{path} is of the mirror '{steered}', the scan is of '{mine}': give files of one rig"
        )
    return marks, hashlib.sha256(data).hexdigest()
