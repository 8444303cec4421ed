"""Entry of the command ``rig``: runs a verb, and turns every failure into one message and an exit code."""

import json
import math
import os
import signal
import sys
import time
import traceback
from types import FrameType

#: Within so long after Ctrl-C another one means the same: keys are held, and a wrapper sends it again.
SAME_WISH_S = 1.0

STOPPED = "stopped by Ctrl-C"


def main() -> None:
    """Run the command line and exit.

    Exit codes: 0 done, 1 a defect in rig, 2 usage or configuration, 3 device, 4 refused by a limit or for
    safety, 5 invalid data file, 6 stopped but what was measured is safe, 130 stopped by Ctrl-C.
    """
    signal.signal(signal.SIGINT, _Interrupts())
    try:
        code = _to_the_end()
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        code = 130
        _report(STOPPED, code)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it would spoil the interpreter's own end
    sys.exit(code)


class _Interrupts:
    """Ctrl-C, once for as long as it is held."""

    def __init__(self) -> None:
        self._last_s = -math.inf

    def __call__(self, number: int, frame: FrameType | None) -> None:
        now_s = time.monotonic()
        anew, self._last_s = now_s - self._last_s >= SAME_WISH_S, now_s
        if anew:
            raise KeyboardInterrupt


def _to_the_end() -> int | None:
    from rig.commands.streams import dropping

    with dropping() as out:
        code = _run()
        out.flush()
        if out.lost is not None and code in {0, None}:
            code = 2
            _report(
                f"the results cannot be written to stdout ({out.lost}); files that it made are whole", code
            )
        if code == 130:  # the frame of commands takes Ctrl-C without a word
            _report(STOPPED, code)
    return code


def _run() -> int | None:
    """Run a verb; return the exit code."""
    try:
        from rig.commands import app

        app()
    except KeyboardInterrupt:
        return 130
    except SystemExit as ended:
        if ended.code == 2:  # every other failure ends below
            _document("the options or arguments are wrong: stderr says which, and --help has all of them", 2)
        return ended.code if isinstance(ended.code, int) else 0 if ended.code is None else 1
    except Exception as error:
        code = exit_code(error)
        if code is None:
            traceback.print_exc()
            print("rig: this is a defect in rig; please report it with the lines above.", file=sys.stderr)
            return 1
        if os.environ.get("RIG_DEBUG"):
            traceback.print_exc()
        _report(f"{told(error)}{_hint(error)}", code)
        return code
    return 0


def exit_code(error: Exception) -> int | None:
    """Return the exit code of a failure that a person can mend, None for a defect."""
    from drivers.errors import DeviceError, LimitError
    from recon.errors import ReconError
    from rig.errors import RigError

    if isinstance(error, RigError):
        return error.exit_code
    if isinstance(error, LimitError | MemoryError):
        return 4
    if isinstance(error, DeviceError):
        return 3
    if isinstance(error, ReconError) or _is_of_a_file(error):
        return 2
    return None


def _is_of_a_file(error: Exception) -> bool:
    """Return whether the system refused a file: a full disk, a name too long, a permission."""
    return isinstance(error, OSError) and error.errno is not None and error.filename is not None


def told(error: BaseException) -> str:
    """Return what a person reads of a failure: it, and what failed after it, each once."""
    return "\n".join(dict.fromkeys([_in_words(error), *getattr(error, "__notes__", ())]))


def _in_words(error: BaseException) -> str:
    if isinstance(error, MemoryError):
        return "there is not enough memory for this; ask for less: a coarser grid, fewer bins, larger voxels"
    if isinstance(error, OSError):
        return f"{error.filename}: {error.strerror}; choose another file, or mend what the system says"
    return str(error)


def _hint(error: Exception) -> str:
    """Return where to look on, for a device that is missing: it may not be the only one."""
    from drivers.errors import DeviceNotFoundError

    return " What else is missing: rig doctor" if isinstance(error, DeviceNotFoundError) else ""


def _report(message: str, code: int) -> None:
    from rig.errors import printable

    _document(message, code)
    print(f"rig: {printable(message)}", file=sys.stderr)


def _document(message: str, code: int) -> None:
    """Print the failure as the one document that ``--json`` promises."""
    if "--json" in sys.argv[1:]:
        print(json.dumps({"schema_version": 1, "error": message, "exit_code": code}), flush=True)


if __name__ == "__main__":
    main()
