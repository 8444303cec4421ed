"""What the served bench needs of the system, and Windows does not have."""

import os
import socket
import sys


def local_socket() -> socket.socket:
    """Return a socket for programs on this computer."""
    if sys.platform == "win32":
        raise OSError("Python has no local sockets on Windows")
    return socket.socket(socket.AF_UNIX)


def pseudo_terminal() -> tuple[int, int, str]:
    """Return a raw pseudo-terminal: the near end, which never blocks, the far end, and the far end's name."""
    if sys.platform == "win32":
        raise OSError("Windows has no pseudo-terminals")
    import tty

    near, far = os.openpty()
    tty.setraw(far)
    os.set_blocking(near, False)
    return near, far, os.ttyname(far)
