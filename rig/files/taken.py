"""Which files are never replaced."""

import os
from pathlib import Path

import h5py

from rig.files.journal import journal_of
from rig.files.volume import is_volume


def is_scan(path: Path) -> bool:
    """Return whether a file may be a scan: it has a journal, or is HDF5 and no volume."""
    return os.path.exists(journal_of(path)) or (path.is_file() and h5py.is_hdf5(path) and not is_volume(path))
