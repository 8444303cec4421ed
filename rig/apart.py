"""Processes that no terminal reaches: neither its Ctrl-C, which is for the program, nor its end."""

import subprocess
import sys
from typing import Any


def apart() -> dict[str, Any]:
    """Return the options of `subprocess.Popen` for such a process."""
    if sys.platform == "win32":  # a console that is closed ends all that is attached to it
        return {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP | subprocess.CREATE_NO_WINDOW}
    return {"start_new_session": True}
