"""Entry of the command ``rig``: runs a verb, and turns every failure into one message and an exit code."""

import json
import os
import sys
import traceback
from contextlib import suppress
from io import TextIOWrapper


def main() -> None:
    """Run the command line and exit.

    Exit codes: 0 done, 1 a defect in rig, 2 usage or configuration, 3 device, 4 refused by a limit or for
    safety, 5 invalid data file, 6 stopped but what was measured is safe, 130 stopped at once.
    """
    from rig.commands import app

    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # a file's name need not be text
            stream.reconfigure(errors="backslashreplace")
    try:
        app()
    except Exception as error:
        code = _exit_code(error)
        if code is None:
            traceback.print_exc()
            print("rig: this is a defect in rig; please report it with the lines above.", file=sys.stderr)
            sys.exit(1)
        if os.environ.get("RIG_DEBUG"):
            traceback.print_exc()
        _report(f"{error}{_hint(error)}", code)
        sys.exit(code)


def _exit_code(error: Exception) -> int | None:
    """Return the exit code of a failure that a person can mend, None for a defect."""
    from drivers.errors import DeviceError, LimitError
    from recon.errors import ReconError
    from rig.errors import RigError

    if isinstance(error, RigError):
        return error.exit_code
    if isinstance(error, LimitError):
        return 4
    if isinstance(error, DeviceError):
        return 3
    if isinstance(error, ReconError):
        return 2
    return None


def _hint(error: Exception) -> str:
    """Return where to look on, for a device that is missing: it may not be the only one."""
    from drivers.errors import DeviceNotFoundError

    return " What else is missing: rig doctor" if isinstance(error, DeviceNotFoundError) else ""


def _report(message: str, code: int) -> None:
    with suppress(OSError):  # nobody may be listening any more; the exit code says it still
        if "--json" in sys.argv[1:]:
            print(json.dumps({"error": message, "exit_code": code}), flush=True)
    with suppress(OSError):
        print(f"rig: {message}", file=sys.stderr)


if __name__ == "__main__":
    main()
