"""Files that are read whole, as settings and lists are: real files, and none that would fill the memory."""

import os
import stat
from errno import EFBIG, EINVAL
from pathlib import Path

#: What such a file may have, where nothing else is said [bytes].
MOST_BYTES = 10_000_000


def read_whole(path: Path, most_bytes: int = MOST_BYTES) -> bytes:
    """Return the content of a file that fits into memory.

    Parameters
    ----------
    path
        The file; links are followed.
    most_bytes
        Its size at most.

    Raises
    ------
    OSError
        If it cannot be read; also of a pipe or a device, which may never end, and of a longer file.
    ValueError
        If no file can have such a name.
    """
    mode = os.stat(path).st_mode
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):  # to open a pipe is to wait for who writes to it
        raise OSError(EINVAL, "it is a pipe or a device, not a file", str(path))
    with open(path, "rb") as file:
        content = file.read(most_bytes + 1)
    if len(content) > most_bytes:
        raise OSError(EFBIG, f"it has more than {most_bytes / 1e6:g} MB, too much for such a file", str(path))
    return content
