"""A scan file in place of a timing instrument: its counts come again, step by step, for rehearsals.

Mirror, laser and detector are moved and asked as ever; only the photons are those of the file, in its order.
"""

from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from drivers.harp.device import MEANWHILE_S, Exposure
from drivers.harp.instrument import Rates
from rig.errors import RefusedError
from rig.files.scan import ScanFile
from rig.model.devices import Clock


class Playback:
    """Plays a scan file; a context manager.

    Parameters
    ----------
    path
        The file.
    channels
        How many channels the rig has.
    clock
        The time to wait by; an exposure takes as long as it is asked to.
    first
        Step of the file to begin with.

    Raises
    ------
    DataFileError
        If the file cannot be read.
    RefusedError
        If it has another number of channels, or holds no photons.
    """

    def __init__(self, path: Path, *, channels: int, clock: Clock, first: int = 0) -> None:
        self._scan = ScanFile(path)
        self._clock = clock
        self._next = first
        has, kind = len(self._scan.channels), "expectations" if self._scan.expectation else "photons"
        if has != channels or kind != "photons":
            self._scan.close()
            raise RefusedError(
                f"{path} holds {has} channels of {kind}, but the rig has {channels} of photons: "
                "play a scan with the same number"
            )
        self.bins, self.bin_width_s = self._scan.bins, self._scan.bin_width_s
        self.first_bin_s = self._scan.first_bin_s

    @property
    def identity(self) -> str:
        """What is played."""
        return f"playback of {self._scan.path.name} (SHA-256 {self._scan.digest[:16]})"

    def settings(self) -> dict[str, str | int | float | bool]:
        """Return the time axis and how much there is to play."""
        return {
            "bins": self.bins,
            "bin_width_s": self.bin_width_s,
            "first_bin_s": self.first_bin_s,
            "steps": self._scan.steps,
        }

    def measure(self, exposure_s: float, meanwhile: Callable[[], bool] = lambda: False) -> Exposure:
        """Return the next step of the file, after as long as was asked for.

        Where ``meanwhile`` ends the exposure, the step is said not to be whole, and is played again.

        Raises
        ------
        RefusedError
            If the file has no more measured steps.
        """
        step = self._step()
        until_s = self._clock.now_s() + exposure_s
        whole = True
        while whole and (left_s := until_s - self._clock.now_s()) > 0:
            self._clock.sleep(min(left_s, MEANWHILE_S))
            whole = left_s <= MEANWHILE_S or not meanwhile()
        self._next = step + whole
        live_s = float(self._scan.live_time_s[step])
        warnings: tuple[str, ...] = ()
        if abs(live_s - exposure_s) > 1e-3 * exposure_s:
            warnings = (f"the file that is played was exposed for {live_s:g} s, not {exposure_s:g} s.",)
        counts = self._scan.counts(range(step, step + 1))[0]
        return Exposure(counts.astype(np.uint32, copy=False), live_s, warnings, whole)

    def rates(self) -> Rates:
        """Return the sync rate of the laser that the file names, and the count rate of the next step.

        After the last step it is that of the last.
        """
        config = self._scan.config
        sync_hz = config.laser.repetition_hz if config else 1.0
        measured = np.flatnonzero(self._scan.done)
        step = int(measured[min(int(np.searchsorted(measured, self._next)), len(measured) - 1)])
        live_s = float(self._scan.live_time_s[step])
        photons = float(self._scan.counts(range(step, step + 1)).sum(dtype=np.float64))
        return Rates(sync_hz, (photons / live_s if live_s > 0 else 0.0,))

    def warnings(self) -> tuple[str, ...]:
        """Return what has to be said of all that is measured."""
        return (f"the photons are those of {self._scan.path}, played back.",)

    def _step(self) -> int:
        """Return the next step that was measured."""
        measured = np.flatnonzero(self._scan.done[self._next :])
        if not len(measured):
            raise RefusedError(
                f"{self._scan.path} has no more measured steps to play after {self._next}: "
                "plan a scan with as many steps as the file has, or play a longer one"
            )
        return self._next + int(measured[0])

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._scan.close()
