"""Opening HDF5 files, also where there are no locks.

HDF5 locks a file that it opens, so that nobody reads what another program writes. Some file systems have no
locks: NFS without its lock daemon, Lustre without its option, some that are mounted by programs. There HDF5
opens nothing at all, unless it is told not to lock.
"""

import errno
import re
from pathlib import Path
from typing import Literal

import h5py

#: What the system says of a file that another program has locked.
HELD = {errno.EAGAIN, errno.EWOULDBLOCK, errno.EACCES}


def hdf5_file(path: str | Path, mode: Literal["r", "r+"]) -> h5py.File:
    """Open a file, and lock it where its file system has locks.

    Raises
    ------
    OSError
        If it cannot be opened, or another program has locked it.
    """
    try:
        return h5py.File(path, mode)
    except OSError as error:
        refused = re.search(r"unable to lock file, errno = (\d+)", str(error))
        if refused is None or int(refused[1]) in HELD:
            raise
    return h5py.File(path, mode, locking=False)
