"""Which files are never replaced."""

import json
from pathlib import Path

import h5py

from rig.errors import RigError
from rig.files.check import open_hdf5, plain
from rig.files.journal import has_journal
from rig.files.volume import is_volume

#: What a scan that is written in another HDF5 layout says of itself: it can be written again.
MADE_OF_A_SCAN = {"original_format": "rig-scan"}


def is_scan(path: Path) -> bool:
    """Return whether a file may be a scan: it has a journal, or is HDF5, and no volume or exported scan."""
    if has_journal(path):
        return True
    return path.is_file() and h5py.is_hdf5(path) and not (is_volume(path) or _is_exported(path))


def _is_exported(path: Path) -> bool:
    try:
        with open_hdf5(path) as file:
            said = json.loads(plain(file["scene_info"][()]))
    except (RigError, OSError, RuntimeError, LookupError, TypeError, ValueError, AttributeError):
        return False
    return isinstance(said, dict) and said.items() >= MADE_OF_A_SCAN.items()
