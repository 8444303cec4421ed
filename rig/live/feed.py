"""What the scanning program does for those who look on: it hands messages to a process of their own.

A scan has a millisecond a position, and may not wait. So all that happens here, in the engine's thread, is
to copy photons; a thread writes them to the other process, as fast as that reads. What waits is bounded: of
photons that do not fit only the steps are remembered, and who looks on reads them from the scan file.
"""

import pickle
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO

from rig.acquire.events import (
    Ended,
    Event,
    Grown,
    LightChanged,
    LineDone,
    Noticed,
    PhaseChanged,
    Ready,
    StepDone,
)
from rig.apart import apart
from rig.files.description import ScanDescription
from rig.live.messages import PLAIN, Begun, Block, BlockBuilder, Film, Gap, Message, Next
from rig.live.web.address import Address

#: Photons that wait for the view at most.
WAITING_BYTES = 2**25
#: Messages other than photons that wait at most: a handful in a pass, and the newest warnings.
WAITING_WORDS = 256
#: A block goes on its way with the end of a line, with so many bytes, or after so long.
BLOCK_BYTES, BLOCK_S = 2**19, 0.25
#: How long the last picture may take before the program ends without it.
LAST_PICTURE_S = 60.0
#: And where a video is to be written.
LAST_VIDEO_S = 600.0
#: How long a view that is told to end may take.
ENDING_S = 10.0


class Outbox:
    """What waits to be sent: messages in order, in bounded memory. One thread puts, another takes."""

    def __init__(self) -> None:
        self._waiting: deque[Message] = deque()
        self._changed = threading.Condition()
        self._closed = False
        self._nbytes = 0
        self._words = 0
        self.full = False  # whether photons had to be left out

    def put(self, message: Message) -> None:
        """Add a message; of photons that do not fit, only which steps they are of."""
        with self._changed:
            if isinstance(message, Block):
                self._put_block(message)
            else:
                self._waiting.append(message)
                self._words += 1
                if self._words > WAITING_WORDS:
                    self._drop_words()
            self._changed.notify()

    def _put_block(self, block: Block) -> None:
        if self._nbytes + block.nbytes <= WAITING_BYTES:
            self._nbytes += block.nbytes
            self._waiting.append(block)
            return
        self.full = True
        first, stop = block.steps.start, block.steps.stop
        for number in range(len(self._waiting) - 1, -1, -1):  # the newest gap, if this goes on with it
            waiting = self._waiting[number]
            if isinstance(waiting, Gap) and waiting.stop == first:
                self._waiting[number] = Gap(waiting.first, stop)
                return
            if isinstance(waiting, Block):
                break
        self._waiting.append(Gap(first, stop))

    def _drop_words(self) -> None:
        """Drop the oldest warning, or else the oldest message that holds no steps."""
        for kinds in (Noticed, PhaseChanged | Ready | LightChanged):
            for number, waiting in enumerate(self._waiting):
                if isinstance(waiting, kinds):
                    del self._waiting[number]
                    self._words -= 1
                    return

    def take(self) -> Message | None:
        """Wait for the next message and take it; None when there will be no more."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._closed)
            if not self._waiting:
                return None
            message = self._waiting.popleft()
            if isinstance(message, Block):
                self._nbytes -= message.nbytes
            elif not isinstance(message, Gap):
                self._words -= 1
            return message

    @property
    def nbytes(self) -> int:
        """Photons that wait, in bytes."""
        return self._nbytes

    def close(self) -> None:
        """Say that nothing more will come."""
        with self._changed:
            self._closed = True
            self._changed.notify()


@dataclass(frozen=True)
class Page:
    """A page in a browser that shows the scan, and can stop it.

    Attributes
    ----------
    address
        Where it is served.
    stop
        Called, in another thread, with why the scan is to stop, when somebody asks for that on the page.
    then
        Which commands follow the scan, as the page says at its end.
    """

    address: Address
    stop: Callable[[str], None]
    then: Next


class LiveFeed:
    """A consumer of scan events that shows them in a process of its own; nothing of that stops a scan.

    Parameters
    ----------
    scan
        The scan file; pictures go to a folder beside it.
    tell
        Called, once, with what became of the view if it did not go well.
    inform
        Called, from another thread too, with what the view found out, a sentence each.
    window
        Whether there is somebody who would look at a window.
    film
        How frames are shown, if there are several.
    page
        A page that shows it, too; None for none.
    command
        What shows it, reading messages from its standard input.
    """

    def __init__(
        self,
        scan: Path,
        tell: Callable[[str], None],
        *,
        inform: Callable[[str], None] = lambda sentence: None,
        window: bool = False,
        film: Film = PLAIN,
        page: Page | None = None,
        command: tuple[str, ...] = (sys.executable, "-m", "rig.live.process"),
    ) -> None:
        self._scan, self._tell, self._inform = scan, tell, inform
        self._window, self._film, self._page, self._command = window, film, page, command
        self.folder = folder_of(scan)
        self._outbox = Outbox()
        self._block = BlockBuilder()
        self._block_since_s = self._newest_s = 0.0
        self._facts: list[str] = []
        self._noticed: dict[str, Noticed] = {}
        self._expected = 0  # the step that comes next
        self._frame_steps = 1
        self._process: subprocess.Popen[bytes] | None = None
        self._threads: list[threading.Thread] = []
        self._trouble = ""
        self._told = False
        self._pictured = threading.Event()  # the last picture is there, or never will be

    def begun(self, description: ScanDescription) -> None:
        """Take what is known before the first photon, and begin to show."""
        try:
            self._process = subprocess.Popen(
                self._command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                **apart(),
            )
        except OSError as error:
            self._fail(f"it cannot be started ({error})")
            return
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._frame_steps = description.steps // (description.plan.frames if description.plan else 1)
        begun = Begun(description, self._scan.absolute(), self.folder.absolute(), self._window, self._film)
        if self._page is not None:
            begun = replace(begun, web=self._page.address, then=self._page.then)
        self._outbox.put(begun)
        for what, pipe in ((self._send, self._process.stdin), (self._hear, self._process.stdout)):
            thread = threading.Thread(target=what, args=(pipe,), daemon=True)
            try:
                thread.start()
            except RuntimeError as error:  # the system has no more threads
                self._fail(f"it cannot be followed ({error})")
                self._end(self._process)
                self._process = None
                return
            self._threads.append(thread)

    def __call__(self, event: Event) -> None:
        """Take an event."""
        if self._process is None:
            return
        self._tell_once()
        match event:
            case StepDone(step=step, exposure=exposure):
                self._add(step.index, event)
                for sentence in exposure.warnings:
                    before = self._noticed.get(sentence)
                    self._noticed[sentence] = (
                        replace(before, last=step.index)
                        if before
                        else Noticed(sentence, step.index, step.index, when_s=time.time())
                    )
            case LineDone():
                self._flush()
            case Noticed():
                self._flush()
                self._outbox.put(replace(event, when_s=time.time()))
            case PhaseChanged() | Ready() | LightChanged() | Grown():
                self._flush()
                self._outbox.put(event)
            case Ended():
                self._flush()
                self._outbox.put(event)
                self._outbox.close()

    def _add(self, step: int, done: StepDone) -> None:
        if step != self._expected:  # a scan that is taken up again: what was measured before is in its file
            self._flush()
            self._outbox.put(Gap(self._expected, step))
        if not len(self._block):
            self._block_since_s = time.monotonic()
        self._block.add(step, done.exposure)
        self._newest_s = time.time()
        self._expected = step + 1
        now_s = time.monotonic()
        whole = (step + 1) % self._frame_steps == 0
        if whole or self._block.nbytes > BLOCK_BYTES or now_s - self._block_since_s > BLOCK_S:
            self._flush()

    def _flush(self) -> None:
        """Send the photons at hand, and what was warned of."""
        if len(self._block):
            self._outbox.put(self._block.take(self._newest_s))
        for noticed in self._noticed.values():
            self._outbox.put(noticed)
        self._noticed.clear()
        if self._outbox.full and not self._trouble:
            self._trouble = "it is too slow; the missing part will be read from the scan file"

    def _send(self, pipe: IO[bytes]) -> None:
        """Write messages to the view, in a thread of its own."""
        try:
            with pipe:
                while (message := self._outbox.take()) is not None:
                    pipe.write(pickle.dumps(message, pickle.HIGHEST_PROTOCOL))
                    pipe.flush()
        except OSError:
            self._fail("its process has ended")
        while self._outbox.take() is not None:  # nobody reads any more
            pass

    def _hear(self, pipe: IO[bytes]) -> None:
        """Read what the view says, a line each, in a thread of its own."""
        with pipe, suppress(OSError, ValueError):
            for line in pipe:
                word, _, rest = line.decode(errors="replace").strip().partition(" ")
                if word == "pictured":
                    self._pictured.set()
                elif word == "trouble":
                    self._fail(rest)
                elif word == "fact":
                    self._facts.append(rest)
                elif word == "serving" and self._page is not None:
                    self._inform(f"Live page: {self._page.address.at(int(rest)).url}")
                elif word == "stop" and self._page is not None:
                    self._page.stop(f"stopped by a viewer of the page in a browser, at {rest}")
        if not self._pictured.is_set():
            self._fail("its process has ended")
        self._pictured.set()

    def _fail(self, why: str) -> None:
        self._trouble = self._trouble or why

    def _tell_once(self) -> None:
        if self._trouble and not self._told:
            self._told = True
            self._tell(f"live view: {self._trouble}. The scan goes on without waiting for it")

    def close(self) -> None:
        """Wait for the last picture, if there will be one; a window stays until the person closes it."""
        self._outbox.close()
        process = self._process
        if process is None:
            self._tell_once()
            return
        try:
            if not self._pictured.wait(LAST_PICTURE_S if self._film.video is None else LAST_VIDEO_S):
                self._fail("its last picture was not ready in time")
                self._end(process)
            self._tell_once()
            for sentence in self._facts:
                self._inform(f"live view: {sentence}")
            if not self._window:
                process.wait(ENDING_S)
        except subprocess.TimeoutExpired:
            self._end(process)
        except BaseException:  # Ctrl-C: nobody waits for it
            self._end(process)
            raise
        if process.poll() is not None:  # the threads end with the process that they speak with
            for thread in self._threads:
                thread.join(ENDING_S)

    @staticmethod
    def _end(process: "subprocess.Popen[bytes]") -> None:
        process.kill()
        process.wait()


def folder_of(scan: Path) -> Path:
    """Return the folder with the live pictures of a scan file."""
    return scan.with_name(f"{scan.stem}-live")
