"""The picture of an image, drawn by a process that got ready for it while this one read the record.

One core alone works while a program starts, and while it draws. A copy of this process imports what draws
meanwhile, draws the volume that it is sent, and sends the picture back. It writes nothing: whatever it cannot
do is done here, and said here.
"""

import gc
import os
import signal
import sys
import threading
import warnings
from contextlib import suppress
from multiprocessing import current_process, get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import TracebackType
from typing import Self

from rig.files.volume import Volume

#: So long one waits for the other process: the first picture ever draws up a list of the fonts, in 10 s.
WAIT_S = 60.0
#: A larger volume is not copied; it takes much longer to make than its picture.
MOST_BYTES = 2**26


class Drawing:
    """The picture of one image.

    Used as a context, it is drawn beside this process where that can be: enter it before any thread is
    started. Otherwise it is drawn here.

    Parameters
    ----------
    path
        The picture; its format follows the ending.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._process: BaseProcess | None = None
        self._pipe: Connection | None = None
        self._sent = False

    @property
    def beside(self) -> bool:
        """Whether another process is there to draw."""
        return self._process is not None

    def __enter__(self) -> Self:
        # a copy of a process has one thread, and waits for ever for what the others held
        if threading.active_count() == 1 and not current_process().daemon:
            with suppress(OSError):  # there may be too many processes
                self._start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end()

    def begin(self, volume: Volume) -> None:
        """Have a volume drawn by the other process, if there is one."""
        if self._pipe is None:
            return
        if volume.intensity.nbytes > MOST_BYTES:
            self._end()
            return
        with suppress(OSError, EOFError):  # it has ended
            if self._pipe.poll(WAIT_S) and self._pipe.recv_bytes():  # it is ready, and takes what it is sent
                self._pipe.send(volume)
                self._sent = True

    def save(self, volume: Volume) -> None:
        """Write the picture of a volume, of the one that was begun if one was.

        Raises
        ------
        rig.errors.DataFileError
            If it cannot be written.
        """
        drawn = self._drawn()
        self._end()
        from rig.show.saving import save, write

        if drawn:
            write(drawn, self.path)
            return
        from rig.image.picture import picture

        save(picture(volume), self.path)

    def _start(self) -> None:
        if sys.platform != "linux":  # elsewhere what draws may not work in a copy
            return
        context = get_context("fork")
        ours, theirs = context.Pipe()
        process = context.Process(target=_draw, args=(theirs, ours, self.path.suffix), daemon=True)
        # Ctrl-C is for this process, which ends the other
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", DeprecationWarning)  # of native threads: the copy has none
                process.start()
            self._process, self._pipe = process, ours
        finally:
            theirs.close()
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)

    def _drawn(self) -> bytes | None:
        """Return the picture, None if the other process has not drawn it."""
        if self._pipe is None or not self._sent:
            return None
        with suppress(OSError, EOFError):
            if self._pipe.poll(WAIT_S):
                return self._pipe.recv_bytes()
        return None

    def _end(self) -> None:
        if self._process is not None and self._pipe is not None:
            self._process.kill()
            self._process.join()
            self._pipe.close()
        self._process = self._pipe = None


def _draw(pipe: Connection, parents: Connection, ending: str) -> None:
    """Import what draws, say so, and draw a volume that is sent; end if nobody wants it any more."""
    parents.close()
    gc.freeze()
    with suppress(BaseException):  # whatever it is, the parent draws, and says what is wrong
        from rig.image.picture import picture
        from rig.show.saving import packed

        pipe.send_bytes(b"ready")
        pipe.send_bytes(packed(picture(pipe.recv()), ending))
    os._exit(0)
