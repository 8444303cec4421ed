"""A laser whose guard is a process of its own, which outlives the program: what a real laser needs."""

import json
import os
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType
from typing import Any, Self

from drivers.errors import DeviceError, LinkError
from rig.errors import LightLostError
from rig.light.guard import Lost
from rig.light.guarded import BEWARE, FIRST_LEASE_S, raise_lost
from rig.light.words import from_words
from rig.model.config import RigConfig
from rig.model.devices import Settings

#: Longest wait for an answer of the guard: a laser takes up to 10 s to light, and several tries to go dark.
PATIENCE_S = 40.0

#: A beat is sent when it changes by more than this until when the light is granted.
WORTH_SENDING_S = 0.05

#: A program that has not said for so long that all is well hangs, in a call that never returns.
HANGS_S = 10.0


class GuardedElsewhere:
    """A laser behind its guard's process; a context manager.

    Parameters
    ----------
    config
        The rig; its laser is opened by the guard.

    Attributes
    ----------
    when_hanging
        What leaves the other devices safe when the program's main thread hangs, each tried once, in a thread
        of its own; the program is ended then.
    """

    def __init__(self, config: RigConfig) -> None:
        self._config = config
        self._identity = ""
        self._numbers = 0
        self._answers: queue.Queue[dict[str, Any] | None] = queue.Queue()
        self._lost: list[Lost] = []
        self._granted_until_s = 0.0
        self._lit = False
        self._closed = threading.Event()
        self.when_hanging: list[Callable[[], None]] = []

    def __enter__(self) -> Self:
        options: dict[str, Any] = {"start_new_session": True}
        if sys.platform == "win32":
            options = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
        self._process = subprocess.Popen(
            [sys.executable, "-m", "rig.light.process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            **options,
        )
        self._hearing = threading.Thread(target=self._hear, daemon=True)
        self._hearing.start()
        try:
            self._identity = str(self._ask("open", config=self._config.model_dump_json()))
        except BaseException:
            self._hang_up()
            raise
        threading.Thread(target=self._mind_the_program, daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._ask("end")
        except (DeviceError, LightLostError) as failure:
            if problem is None:
                raise
            problem.add_note(f"while leaving: {failure}")
        finally:
            self._hang_up()

    @property
    def identity(self) -> str:
        """As the laser reports it."""
        return self._identity

    def settings(self) -> Settings:
        """Return the settings as read back."""
        answer: Settings = self._ask("settings")
        return answer

    def arm(self) -> None:
        """Prepare the laser; still dark."""
        self._lost.clear()
        self._ask("arm")

    def emit(self) -> None:
        """Light the laser."""
        self._granted_until_s = time.monotonic() + PATIENCE_S
        self._lit = True
        self._ask("emit", until_s=time.monotonic() + FIRST_LEASE_S)
        self.beat(FIRST_LEASE_S)

    def stop(self) -> None:
        """Put the light out."""
        self._lit = False
        self._ask("stop")

    def emitting(self) -> bool:
        """Ask the laser now."""
        return bool(self._ask("emitting"))

    def beat(self, lease_s: float) -> None:
        """Say that all is well for so long.

        Raises
        ------
        LightLostError
            If the light is lost.
        """
        until_s = time.monotonic() + lease_s
        if abs(until_s - self._granted_until_s) > WORTH_SENDING_S:
            self._granted_until_s = until_s
            self._tell({"do": "beat", "until_s": until_s})
        raise_lost(self._lost)

    def _ask(self, what: str, **details: object) -> Any:
        """Ask the guard, and return its answer or raise the failure of the device that it tells."""
        self._numbers += 1
        self._tell({"do": what, "id": self._numbers, **details})
        until_s = time.monotonic() + PATIENCE_S
        while (left_s := until_s - time.monotonic()) > 0:
            try:
                answer = self._answers.get(timeout=left_s)
            except queue.Empty:
                break
            if answer is None:
                self._guard_is_gone()
            elif answer["id"] == self._numbers:
                if "error" in answer:
                    raise from_words(answer["error"])
                return answer["answer"]
        raise LinkError(
            "guard of the laser", f"answer '{what}'", f"nothing came in {PATIENCE_S:g} s", f"{BEWARE}."
        )

    def _tell(self, message: dict[str, Any]) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(message) + "\n")
            self._process.stdin.flush()
        except (OSError, ValueError):
            self._guard_is_gone()

    def _hear(self) -> None:
        """Take in what the guard says, in a thread of its own."""
        assert self._process.stdout is not None
        with suppress(OSError, ValueError), self._process.stdout as lines:
            for line in lines:
                said = json.loads(line)
                if "lost" in said:
                    self._lost.append(Lost(**said["lost"]))
                else:
                    self._answers.put(said)
        self._answers.put(None)

    def _guard_is_gone(self) -> None:
        """Put the light out without the guard, which was killed, and raise."""
        from rig.devices.wires import laser_by_address

        self._hang_up()
        try:
            with laser_by_address(self._config):
                found = "the laser was dark"
        except DeviceError as problem:
            found = str(problem)
        raise LightLostError(f"the guard of the laser has ended, which it never should: {found}")

    def _mind_the_program(self) -> None:
        """End a program whose main thread hangs; the guard has put the light out by then."""
        while not self._closed.wait(0.5):
            if not self._lit or time.monotonic() - self._granted_until_s < HANGS_S:
                continue
            for safe in self.when_hanging:
                helper = threading.Thread(target=_quietly, args=(safe,), daemon=True)
                helper.start()
                helper.join(3.0)
            sys.stderr.write(
                f"\nrig: a device's library has not returned for {HANGS_S:.0f} s. The guard has put the "
                "laser out, and the program ends here. Lines that were finished are safe; switch the timing "
                "instrument off and on, and go on with rig resume.\n"
            )
            sys.stderr.flush()
            os._exit(3)

    def _hang_up(self) -> None:
        self._closed.set()
        with suppress(OSError, ValueError):
            assert self._process.stdin is not None
            self._process.stdin.close()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(2.0)
            self._hearing.join(2.0)


def _quietly(act: Callable[[], None]) -> None:
    with suppress(Exception):
        act()
