"""Entry of the command ``rig``: runs a verb, and turns every failure into one message and an exit code."""

import _thread
import gc
import json
import math
import os
import signal
import sys
import threading
import time
import traceback
from errno import EAGAIN, EDQUOT, EFBIG, EIO, ENOENT, ENOSPC, EROFS
from types import FrameType

#: Within so long after Ctrl-C another one means the same: keys are held, and a wrapper sends it again.
SAME_WISH_S = 1.0
#: So often a Ctrl-C that was dropped is sent again, until it is heard.
AGAIN_S = 0.01

STOPPED = "stopped by Ctrl-C"


def main() -> None:
    """Run the command line and exit.

    Exit codes: 0 done, 1 a defect in rig, 2 usage or configuration, 3 device, 4 refused by a limit or for
    safety, 5 invalid data file, 6 stopped but what was measured is safe, 130 stopped by Ctrl-C; 129 and 143
    by a closed terminal and by SIGTERM.
    """
    interrupts = Interrupts()
    signal.signal(signal.SIGINT, interrupts)
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, signal.SIGTERM)  # Windows has no closed terminal
        if signal.getsignal(number) is signal.SIG_DFL:  # with nohup it is ignored
            signal.signal(number, _end)
    sys.unraisablehook = interrupts.lost
    os.environ.pop("MPLBACKEND", None)  # pictures need none, and one that is gone stops the import
    try:
        code = _to_the_end()
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        code = 130
        _report(STOPPED, code)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it would spoil the interpreter's own end
    # a Ctrl-C within a text that was executed (a dataclass is made of one) is taken for one that nobody
    # heard: Python ends by the signal in place of the code, until another text is evaluated
    eval("0")
    gc.freeze()  # at its end it would look for garbage among a million objects, three times
    sys.exit(code)


def _end(number: int, frame: FrameType | None) -> None:
    """End in order: no half file is left."""
    signal.signal(number, signal.SIG_IGN)
    raise SystemExit(128 + number)


class Interrupts:
    """Ctrl-C, once for as long as it is held, and again where Python had to drop it."""

    def __init__(self) -> None:
        self._last_s = -math.inf
        self._dropping = False  # what is raised now would be dropped as well
        self._owed = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Interrupt what runs, unless the same wish did so just before."""
        if self._dropping:
            return
        now_s = time.monotonic()
        anew, self._last_s = now_s - self._last_s >= SAME_WISH_S, now_s
        if anew:
            self._owed = False
            raise KeyboardInterrupt

    def lost(self, what: "sys.UnraisableHookArgs") -> None:
        """Hear of an exception that Python drops, as in a destructor: Ctrl-C is then sent until heard."""
        if what.exc_type is not KeyboardInterrupt:
            sys.__unraisablehook__(what)
            return
        self._dropping = self._owed = True
        self._last_s = -math.inf
        threading.Thread(target=self._send, name="Ctrl-C", daemon=True).start()
        self._dropping = False

    def _send(self) -> None:
        time.sleep(AGAIN_S)
        while self._owed:
            if signal.getsignal(signal.SIGINT) is not self:  # a scan's: it hears the first, and drops none
                self._owed = False
            _interrupt()
            time.sleep(AGAIN_S)


def _interrupt() -> None:
    """Send Ctrl-C to the main thread, which may wait for something."""
    if sys.platform == "win32":
        _thread.interrupt_main()
    else:
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)


def _to_the_end() -> int:
    from rig.commands.streams import dropping
    from rig.commands.voice import voice

    with dropping() as out:
        voice.begin()
        code = _run()
        out.flush()
        if out.lost is not None and code == 0:
            code = 2
            _report(
                f"the results cannot be written to stdout ({out.lost}); "
                "the files that were written are complete",
                code,
            )
        if code == 130:  # the frame of commands takes Ctrl-C without a word
            _report(STOPPED, code)
        voice.end(code)
    return code


def _run() -> int:
    """Run a verb; return the exit code."""
    try:
        from rig.commands import command

        return command()(prog_name="rig", standalone_mode=False) or 0
    except KeyboardInterrupt:
        return 130
    except SystemExit as ended:
        return ended.code if isinstance(ended.code, int) else 0 if ended.code is None else 1
    except Exception as error:
        code = exit_code(error)
        if code is None:
            return _defect(error)
        if os.environ.get("RIG_DEBUG"):
            traceback.print_exc()
        _report(told(error, _hint(error)), code)
        return code


def _defect(error: Exception) -> int:
    """Report a failure that nobody foresaw."""
    from rig.commands.voice import voice

    voice.note("defect", traceback.format_exc())
    traceback.print_exc()
    _report(f"this is a defect in rig ({type(error).__name__}); please report it with the lines above.", 1)
    return 1


def exit_code(error: Exception) -> int | None:
    """Return the exit code of a failure that a person can mend, None for a defect."""
    from drivers.errors import DeviceError, LimitError
    from recon.errors import ReconError
    from rig.commands.usage import is_of_usage
    from rig.errors import RigError

    if isinstance(error, RigError):
        return error.exit_code
    if is_of_usage(error):
        return 2
    if (
        isinstance(error, LimitError | MemoryError)
        or type(error).__name__ == "Abort"
        or _is_of_threads(error)
    ):
        return 4
    if isinstance(error, DeviceError):
        return 3
    if isinstance(error, ReconError) or _is_of_a_file(error):
        return 2
    return None


def _is_of_threads(error: BaseException) -> bool:
    """Return whether the system refused a thread, or a process."""
    if isinstance(error, OSError):
        return error.errno == EAGAIN and error.filename is None
    return isinstance(error, RuntimeError) and "can't start new thread" in str(error)


def _is_of_a_file(error: Exception) -> bool:
    """Return whether the system refused a file: a full disk, a name too long, a permission."""
    if not isinstance(error, OSError) or error.errno is None:
        return False
    if error.filename is not None or error.errno in (ENOSPC, EDQUOT, EFBIG, EROFS, EIO):
        return True  # without a name: what is written to an open file
    return error.errno == ENOENT and _nowhere()


def _nowhere() -> bool:
    """Return whether the working folder is gone."""
    try:
        os.getcwd()
    except OSError:
        return True
    return False


def told(error: BaseException, hint: str = "") -> str:
    """Return what a person reads of a failure: it with a hint, and what failed after it, each once."""
    first, *after = dict.fromkeys([_in_words(error), *getattr(error, "__notes__", ())])
    return "\n".join([first + hint, *after])


def _in_words(error: BaseException) -> str:
    from rig.commands import usage
    from rig.errors import reason

    if isinstance(error, Exception) and usage.is_of_usage(error):
        return usage.in_words(error)
    if type(error).__name__ == "Abort":
        return "a question was not answered, so rig stops here; --yes answers the questions that allow it"
    if isinstance(error, MemoryError):
        return "there is not enough memory for this; ask for less: a coarser grid, fewer bins, larger voxels"
    if _is_of_threads(error):
        return (
            "the system lets this program start no more threads or processes: end other programs, or raise "
            "the limit (ulimit -u, or that of the container)"
        )
    if isinstance(error, OSError) and error.filename is None:
        return (
            f"a file cannot be written, or a folder is gone: {reason(error)}; "
            "check free space, quota, and the folder where you are"
        )
    if isinstance(error, OSError):
        return f"{error.filename}: {error.strerror}; choose another file, or correct what the system reports"
    return str(error)


def _hint(error: Exception) -> str:
    """Return where to look on, for a device that is missing: it may not be the only one."""
    from drivers.errors import DeviceNotFoundError

    return " What else is missing: rig doctor" if isinstance(error, DeviceNotFoundError) else ""


def _report(message: str, code: int) -> None:
    from rig.commands.voice import voice
    from rig.errors import printable

    voice.note("error", message)
    _document(message, code)
    print(f"rig: {printable(message)}", file=sys.stderr)


def _document(message: str, code: int) -> None:
    """Print the failure as the one document that ``--json`` promises, unless a result was printed as it.

    A scan that was stopped, or a laser that is not dark, has a result that says so.
    """
    from rig.commands.voice import voice

    if "--json" in sys.argv[1:] and not voice.documented:
        voice.documented = True
        print(json.dumps({"schema_version": 1, "error": message, "exit_code": code}), flush=True)


if __name__ == "__main__":
    main()
