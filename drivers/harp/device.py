"""A timing instrument in histogram mode, as one context manager.

Time-tagged streams (T3) are in `stream`. Not implemented: T2 and continuous mode, external start and stop
(C1, C2), the stop at a full bin.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock, wait_until
from drivers.errors import LinkError, ProtocolError
from drivers.harp import constants as hh
from drivers.harp.errors import HarpError
from drivers.harp.instrument import CLOCK_ERROR, LATE_S, Instrument, Rates, system_error
from drivers.harp.library import HarpLibrary, histogram_buffers
from drivers.harp.settings import HarpSettings, Integers

__all__ = ["Exposure", "Harp", "Rates"]

#: How often the end of a measurement is asked for [s].
POLL_S = 1e-3

#: How often the caller is asked during an exposure whether it shall go on.
MEANWHILE_S = 0.05


@dataclass(frozen=True)
class Exposure:
    """What one timed measurement gave.

    Attributes
    ----------
    counts
        (channels, bins) uint32, photons a bin, a row for each input; valid until the next measurement.
    live_time_s
        How long the instrument measured.
    warnings
        Plain sentences about this measurement; empty when all is well.
    whole
        Whether it lasted as long as was asked for.
    """

    counts: NDArray[np.uint32]
    live_time_s: float
    warnings: tuple[str, ...] = ()
    whole: bool = True

    @cached_property
    def photons(self) -> int:
        """Number of photons in all bins of all channels; summed once, when it is first asked for."""
        return int(self.counts.sum(dtype=np.int64))


class Harp(Instrument):
    """Inputs of an instrument timed against its sync input, their histograms made by the instrument.

    The histogram inside the instrument is the shortest that holds the bins asked for, since its length
    decides how long a readout takes. Parameters and attributes are those of `Instrument`.
    """

    _mode = hh.Mode.HISTOGRAM

    def __init__(
        self,
        library: HarpLibrary,
        *,
        clock: Clock,
        serial: str | None = None,
        settings: HarpSettings | None = None,
    ) -> None:
        super().__init__(library, clock=clock, serial=serial, settings=settings)
        self._rows = histogram_buffers(len(self._settings.inputs), self.limits.max_bins)
        self._counts = np.ctypeslib.as_array(self._rows)[:, : self._settings.bins]

    @property
    def bins(self) -> int:
        """Number of bins of a histogram."""
        return self._settings.bins

    def settings(self) -> dict[str, str | int | float | bool]:
        """Return the settings as last accepted; only the bin width can be read back."""
        read_back = {"bin_width_s": self._bin_width_s, "histogram_bins": self._span_bins}
        return self._settings.as_dict() | read_back

    def measure(self, exposure_s: float, meanwhile: Callable[[], bool] = lambda: False) -> Exposure:
        """Clear, expose for ``exposure_s``, and return the histogram of each input.

        A call that does nothing and reports no error, or is executed twice, spoils no counts. Histograms are
        cleared when they were read, too, by a call of its own: one lost clearing leaves no counts of this
        exposure in the next one, and what is read twice is the same. That the measurement runs is asked right
        after it was started; the vendor's demos rely on that answer, too.

        A lost sync is a warning and not an error: the counts then cover an unknown part of the exposure, and
        a dark measurement has no sync by intention, so the caller decides. After a system error the counts
        are worthless, and it is raised.

        Parameters
        ----------
        exposure_s
            Whole milliseconds, 1 ms to 100 h.
        meanwhile
            Called each `MEANWHILE_S` of an exposure that is longer; when it returns True the exposure ends
            at once, and its live time is what the instrument says has passed.

        Raises
        ------
        LimitError
            If the exposure is not whole milliseconds; nothing is sent then.
        LinkError
            If the measurement does not end in time.
        ProtocolError
            If it did not start, although there was no error.
        HarpError
            If the library refuses a call.
        DeviceError
            If the instrument reports a system error.
        """
        duration_ms = self.limits.exposure_ms(exposure_s)
        library, index = self._library, self._index
        library.clear_hist_mem(index)
        try:
            before_s = self._clock.now_s()
            library.start_meas(index, duration_ms)
            until_s = self._clock.now_s() + duration_ms / 1000
            self._require_started(before_s, duration_ms)
            whole = self._expose(until_s, duration_ms, meanwhile)
        except BaseException:
            with suppress(HarpError):
                library.stop_meas(index)
            raise
        live_s = duration_ms / 1000 if whole else library.get_elapsed_meas_time(index) / 1000
        library.stop_meas(index)
        # before histograms are cleared, and perhaps flags with them
        warnings = self._sentences(library.get_flags(index))
        for row, channel in enumerate(self._settings.inputs):
            library.get_histogram(index, channel, self._rows[row])
        library.clear_hist_mem(index)
        return Exposure(self._counts, live_s, warnings, whole)

    def _require_started(self, before_s: float, duration_ms: int) -> None:
        """Raise if no measurement runs that cannot be over yet; one that can tells nothing."""
        ended = self._library.ctc_ended(self._index)
        if ended and self._clock.now_s() - before_s < (1 - CLOCK_ERROR) * duration_ms / 1000:
            raise ProtocolError(
                self._name,
                f"start to measure for {duration_ms} ms",
                "none runs, and no error was reported",
                self._restart,
            )

    def _expose(self, until_s: float, duration_ms: int, meanwhile: Callable[[], bool]) -> bool:
        """Wait for the end of an exposure; return False if ``meanwhile`` ended it before."""
        while (left_s := until_s - self._clock.now_s()) > MEANWHILE_S:
            self._clock.sleep(MEANWHILE_S)
            if meanwhile():
                return False
        self._clock.sleep(max(left_s, 0.0))
        late_s = LATE_S + CLOCK_ERROR * duration_ms / 1000
        ended = wait_until(
            self._clock, lambda: self._library.ctc_ended(self._index), timeout_s=late_s, every_s=POLL_S
        )
        if not ended:
            raise LinkError(
                self._name,
                f"measure for {duration_ms} ms",
                f"the measurement still runs {late_s:.3g} s after its end",
                f"{self._family.link.check}, and {self._family.link.restart}.",
            )
        if duration_ms / 1000 > MEANWHILE_S:
            meanwhile()  # a long exposure may take long to read, too
        return True

    def _set_up_mode(self, index: int, wire: Integers) -> None:
        library = self._library
        self._span_bins = library.set_histo_len(index, wire.length)
        self._set_bins(index, wire)
        library.set_stop_overflow(index, False, hh.MAX_STOP_COUNT)
        library.set_meas_control(index, hh.MeasControl.SINGLESHOT_CTC, hh.Edge.RISING, hh.Edge.FALLING)
        self._require_as_asked(self.limits.max_bins)

    def _sentences(self, raised: int) -> tuple[str, ...]:
        """Turn state flags into sentences, or into an error where the counts are worthless."""
        flags = self._family.flags
        if raised & flags.errors:
            raise system_error(self._library, self._index, self._name)
        return tuple(text for _, text in flags.told(raised))
