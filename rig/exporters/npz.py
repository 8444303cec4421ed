"""NumPy's ``.npz`` of a volume: ``intensity`` (z, y, x), its axes, and its parameters as JSON text."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from rig.exporters.arrays import volume_arrays
from rig.files import Volume

NAME = "NumPy archive"
ENDINGS = (".npz",)


def write(path: Path, volume: Volume) -> None:
    """Write the file."""
    arrays: dict[str, Any] = {
        **volume_arrays(volume),
        "parameters": np.array(json.dumps(dict(volume.parameters))),
    }
    np.savez_compressed(path, **arrays)
