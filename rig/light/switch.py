"""The switch by which anybody at this computer puts the light out, also while a scan runs.

A guard listens on this computer only, at a port that it writes down where only its user can read it, together
with a word that has to be said. The switch can do one thing: off.
"""

import json
import os
import secrets
import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from rig.light.state import Watchman, announce, watchmen
from rig.model.config import RigConfig

#: Longest question and answer in bytes, and the longest wait for one: a laser may need several tries.
LONGEST = 4096
PATIENCE_S = 15.0

#: What anybody may ask: which guard listens here.
THERE = "there?"


class Switch:
    """The guard's side.

    Parameters
    ----------
    config
        The rig whose light is guarded.
    off
        Called, in a thread, with a message that wants darkness; its ``reply`` is to be called with what came
        of it.
    """

    def __init__(self, config: RigConfig, off: Callable[[dict[str, Any]], None]) -> None:
        self._off = off
        self._token = secrets.token_hex(16)
        self._socket = socket.create_server(("127.0.0.1", 0))
        port = self._socket.getsockname()[1]
        watchman = Watchman(os.getpid(), config.name, config.light_place, port, self._token)
        self._path = announce(watchman)
        threading.Thread(target=self._serve, daemon=True).start()

    def close(self) -> None:
        """Listen no more."""
        self._path.unlink(missing_ok=True)
        self._socket.close()

    def _serve(self) -> None:
        with suppress(OSError):
            while True:
                caller, _ = self._socket.accept()
                try:
                    threading.Thread(target=self._hear, args=(caller,), daemon=True).start()
                except RuntimeError:  # the system has no more threads: callers are heard one by one
                    self._hear(caller)

    def _hear(self, caller: socket.socket) -> None:
        with suppress(OSError), caller:
            caller.settimeout(PATIENCE_S)
            asked = caller.recv(LONGEST).decode("ascii", "replace").strip()
            if asked == THERE:
                caller.sendall(json.dumps({"guard": os.getpid()}).encode())
            if asked != self._token:
                return
            answered = threading.Event()

            def reply(said: dict[str, Any]) -> None:
                with suppress(OSError):
                    caller.sendall(json.dumps(said).encode())
                answered.set()

            self._off({"do": "off", "reply": reply})
            answered.wait(PATIENCE_S)


def present() -> list[Watchman]:
    """Return the guards that were made known and answer; a killed one leaves its file."""
    return [one for one in watchmen() if (_said_by(one, THERE) or {}).get("guard") == one.pid]


def switch_off(watchman: Watchman) -> bool | None:
    """Have a guard put its light out.

    Returns
    -------
    bool or None
        Whether the laser confirmed that it is dark; None if no such guard answers.
    """
    said = _said_by(watchman, str(watchman.token))
    return None if said is None or "dark" not in said else bool(said["dark"])


def _said_by(watchman: Watchman, asked: str) -> dict[str, Any] | None:
    """Return what a guard answers; None if none does."""
    try:
        with socket.create_connection(("127.0.0.1", watchman.port), timeout=2.0) as caller:
            caller.settimeout(PATIENCE_S)
            caller.sendall(asked.encode())
            said = json.loads(caller.recv(LONGEST))
    except (OSError, ValueError, TypeError, OverflowError, RecursionError):  # of what is no guard
        return None
    return said if isinstance(said, dict) else None
