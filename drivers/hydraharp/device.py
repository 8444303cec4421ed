"""The HydraHarp 400 in histogram mode, as one context manager.

Not implemented: T2, T3 and continuous mode, markers, external start and stop (C1, C2); `HHLib` has their
functions.
"""

from contextlib import nullcontext, suppress
from types import TracebackType
from typing import Self

import numpy as np

from drivers.clock import Clock, wait_until
from drivers.errors import DeviceError, DeviceNotFoundError, LimitError, LinkError, ProtocolError
from drivers.hydraharp import constants as hh
from drivers.hydraharp.errors import HydraHarpError
from drivers.hydraharp.library import HHLib, histogram_buffer
from drivers.hydraharp.limits import whole, within
from drivers.hydraharp.measured import Exposure, Rates
from drivers.hydraharp.opening import open_by_serial
from drivers.hydraharp.setup import Accepted, Setup

#: How often the end of a measurement is asked for, and how late it may come [s]; in addition, the part of
#: the exposure by which the clocks of instrument and computer may differ.
POLL_S = 1e-3
LATE_S = 1.0
CLOCK_ERROR = 1e-3


class HydraHarp:
    """One input of a HydraHarp 400 timed against its sync input.

    The histogram inside the instrument is the shortest that holds ``bins`` bins, since its length decides how
    long a readout takes; where ``sync_period_s`` is given it also covers the whole period. It is not derived
    from the measured sync rate, because then it would depend on whether the laser was on when connecting.

    Parameters
    ----------
    library
        The vendor's library, see `drivers.hydraharp.load_library`.
    clock
        The time to wait by.
    serial
        Serial number of the instrument; None takes the first that can be opened.
    sync_divider
        1, 2, 4, 8 or 16; the divided sync rate may be up to 12.5 MHz (source: manual).
    sync_cfd_mv, input_cfd_mv
        Discriminator level (0 to 1000) and zero crossing (0 to 40) in mV, both positive though the signals
        are negative. The defaults suit no detector in particular.
    input_channel
        The photon input, counted from 0; the front panel counts from 1. All others are switched off.
    sync_offset_s, input_offset_s
        Time shifts in whole picoseconds up to 99.999 ns, in place of longer or shorter cables.
    bin_width_s
        The base resolution (1 ps) times a power of two.
    bins
        Number of bins that a measurement returns.
    offset_s
        Left edge of the first bin in whole nanoseconds, 0 to 500 us.
    stop_overflow
        End a measurement when a bin reaches this count; None never does.
    external_reference
        Take the 10 MHz reference from the external input.
    sync_period_s
        The known time between sync pulses, if the histogram shall cover all of it.

    Raises
    ------
    LimitError
        If a setting is outside the instrument's limits; nothing is sent then.
    """

    def __init__(
        self,
        library: HHLib,
        *,
        clock: Clock,
        serial: str | None = None,
        sync_divider: int = 1,
        sync_cfd_mv: tuple[int, int] = (50, 10),
        input_channel: int = 0,
        input_cfd_mv: tuple[int, int] = (50, 10),
        sync_offset_s: float = 0.0,
        input_offset_s: float = 0.0,
        bin_width_s: float = 4e-12,
        bins: int = 15000,
        offset_s: float = 0.0,
        stop_overflow: int | None = None,
        external_reference: bool = False,
        sync_period_s: float | None = None,
    ) -> None:
        self._name = f"HydraHarp {serial}" if serial else "HydraHarp"
        if sync_divider not in hh.SYNC_DIVIDERS:
            raise LimitError(
                self._name,
                f"divide the sync by {sync_divider}",
                "it divides by 1, 2, 4, 8 or 16",
                "Choose one of these.",
            )
        if stop_overflow is not None:
            within(self._name, "count that stops a measurement", stop_overflow, "", hh.STOP_COUNT)
        picoseconds = (1e-12, "ps", hh.CHANNEL_OFFSET_PS)
        self._setup = Setup(
            reference=hh.Reference.EXTERNAL if external_reference else hh.Reference.INTERNAL,
            sync_divider=sync_divider,
            sync_cfd_mv=self._cfd("sync", sync_cfd_mv),
            sync_offset_ps=whole(self._name, "sync offset", sync_offset_s, *picoseconds),
            input_channel=within(self._name, "input channel", input_channel, "", (0, hh.MAX_INPUTS - 1)),
            input_cfd_mv=self._cfd("input", input_cfd_mv),
            input_offset_ps=whole(self._name, "input offset", input_offset_s, *picoseconds),
            bin_width_s=bin_width_s,
            bins=within(self._name, "number of bins", bins, "", (1, hh.MAX_HISTOGRAM_BINS)),
            span_s=max((sync_period_s or 0.0) - offset_s, 0.0),
            offset_ns=whole(self._name, "histogram offset", offset_s, 1e-9, "ns", hh.OFFSET_NS),
            stop_overflow=stop_overflow,
        )
        self._library = library
        self._clock = clock
        self._serial = serial
        self._open_index: int | None = None
        self._identity = ""
        self._accepted = Accepted(inputs=0, bin_width_s=bin_width_s, histogram_bins=0)
        self._buffer = histogram_buffer()
        self._counts = np.ctypeslib.as_array(self._buffer)[:bins]

    def __enter__(self) -> Self:
        """Open, identify, calibrate and set up the instrument, in the order that the manual asks for."""
        release = self._library.get_library_version()
        if release != hh.LIBRARY_VERSION:
            raise DeviceNotFoundError(
                self._name,
                f"use {self._library.name}",
                f"its version is {release}, not {hh.LIBRARY_VERSION}",
                f"Install HHLib {hh.LIBRARY_VERSION}.",
            )
        index, serial = open_by_serial(self._library, self._serial)
        self._name = f"HydraHarp {serial}"
        try:
            self._library.initialize(index, hh.Mode.HISTOGRAM, self._setup.reference)
            model, part, version = self._library.get_hardware_info(index)
            self._accepted = self._setup.send(self._library, index, self._name)
            self._clock.sleep(hh.RATE_WAIT_S)
        except BaseException:
            self._close(index, quietly=True)
            raise
        self._identity = (
            f"PicoQuant {model}, part {part}, version {version}, serial {serial}, HHLib {hh.LIBRARY_VERSION}"
        )
        self._open_index = index
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop a measurement that still runs, and close."""
        index, self._open_index = self._open_index, None
        if index is not None:
            self._close(index, quietly=error is not None)

    @property
    def identity(self) -> str:
        """Maker, model, part number, version, serial number and library version."""
        return self._identity

    @property
    def bin_width_s(self) -> float:
        """The bin width that the instrument really uses, read back after opening."""
        return self._accepted.bin_width_s

    @property
    def first_bin_s(self) -> float:
        """Left edge of the first bin after the sync pulse, both input offsets already applied."""
        return self._setup.offset_ns * 1e-9

    def settings(self) -> dict[str, str | int | float | bool]:
        """Return the settings as last accepted; only the bin width can be read back."""
        accepted = self._accepted
        read_back = {"bin_width_s": accepted.bin_width_s, "histogram_bins": accepted.histogram_bins}
        return self._setup.as_dict() | read_back

    def measure(self, exposure_s: float) -> Exposure:
        """Clear, expose for ``exposure_s``, and return the histogram.

        A lost sync is a warning and not an error: the counts then cover an unknown part of the exposure, and
        a dark measurement has no sync by intention, so the caller decides. After a system error the counts
        are worthless, and it is raised.

        Parameters
        ----------
        exposure_s
            Whole milliseconds, 1 ms to 100 h.

        Raises
        ------
        LimitError
            If the exposure is not whole milliseconds; nothing is sent then.
        LinkError
            If the measurement does not end in time.
        HydraHarpError
            If the library refuses a call.
        DeviceError
            If the instrument reports a system error.
        """
        duration_ms = whole(self._name, "exposure", exposure_s, 1e-3, "ms", hh.ACQUISITION_MS)
        library, index = self._library, self._index
        library.clear_hist_mem(index)
        try:
            library.start_meas(index, duration_ms)
            self._clock.sleep(duration_ms / 1000)
            late_s = LATE_S + CLOCK_ERROR * duration_ms / 1000
            if not wait_until(
                self._clock, lambda: library.ctc_ended(index), timeout_s=late_s, every_s=POLL_S
            ):
                raise LinkError(
                    self._name,
                    f"measure for {duration_ms} ms",
                    f"the measurement still runs {late_s:.3g} s after its end",
                    "Check the USB link, and switch the HydraHarp off and on.",
                )
        except BaseException:
            with suppress(HydraHarpError):
                library.stop_meas(index)
            raise
        library.stop_meas(index)
        library.get_histogram(index, self._setup.input_channel, self._buffer)
        flags = library.get_flags(index)
        if not flags:
            return Exposure(self._counts, duration_ms / 1000)
        return self._flagged(flags, duration_ms / 1000)

    def rates(self) -> Rates:
        """Return the rates of sync and photon input; the instrument renews them each 100 ms."""
        index = self._index
        sync_hz = self._library.get_sync_rate(index)
        return Rates(float(sync_hz), float(self._library.get_count_rate(index, self._setup.input_channel)))

    def warnings(self) -> tuple[str, ...]:
        """Return what the instrument warns about at the present rates, as plain sentences."""
        library, index = self._library, self._index
        library.get_sync_rate(index)  # warnings are computed from the rates that were read last
        for channel in range(self._accepted.inputs):
            library.get_count_rate(index, channel)
        raised = library.get_warnings(index)
        if self._setup.bins > self._accepted.histogram_bins - self._setup.offset_ns * 1e-9 / self.bin_width_s:
            # the instrument judges by its longest histogram; in the one that is used, the offset is needed
            raised &= ~hh.Warn.OFFSET_UNNECESSARY
        sentences = [text for bit, text in hh.WARNING_SENTENCES.items() if raised & bit]
        unknown = int(raised) & ~sum(hh.WARNING_SENTENCES)
        if unknown:
            sentences.append(" ".join(library.get_warnings_text(index, unknown).split()))
        return tuple(sentences)

    def sync_period_s(self) -> float:
        """Return the sync period as measured during the last `measure`.

        The manual gives its unit as ps and the vendor's C demo takes it as seconds, so that the unit is
        found by comparison with the sync rate.

        Raises
        ------
        ProtocolError
            If neither unit agrees with the sync rate within 10 %.
        """
        raw, rate_hz = self._library.get_sync_period(self._index), self._library.get_sync_rate(self._index)
        for unit_s in (1.0, 1e-12):
            if rate_hz and abs(raw * unit_s * rate_hz - 1) < 0.1:
                return raw * unit_s
        raise ProtocolError(
            self._name,
            "tell the sync period",
            f"it answered {raw:g}, which is neither in s nor in ps the inverse of its sync rate {rate_hz} Hz",
            "Check that the laser emits, measure once, and ask again.",
        )

    @property
    def _index(self) -> int:
        if self._open_index is None:
            raise DeviceError(self._name, "work", "it is not open", "Use it inside its `with` block.")
        return self._open_index

    def _flagged(self, flags: hh.Flag, live_time_s: float) -> Exposure:
        """Turn state flags into sentences, or into an error where the counts are worthless."""
        if flags & hh.Flag.SYSERROR:
            report = " ".join(self._library.get_hardware_debug_info(self._index).split())
            raise DeviceError(
                self._name,
                "measure",
                f"it reports a system error: {report[:500] or 'no details'}",
                "Switch the HydraHarp off and on; if that does not help, send PicoQuant its debug report.",
            )
        if flags & hh.Flag.OVERFLOW and self._setup.stop_overflow is not None:
            live_time_s = self._library.get_elapsed_meas_time(self._index) / 1000
        sentences = tuple(text for bit, text in hh.FLAG_SENTENCES.items() if flags & bit)
        return Exposure(self._counts, live_time_s, sentences)

    def _close(self, index: int, *, quietly: bool) -> None:
        """Stop and close; quietly after an error, which must not be hidden by another."""
        with suppress(HydraHarpError):
            self._library.stop_meas(index)
        with suppress(HydraHarpError) if quietly else nullcontext():
            self._library.close_device(index)

    def _cfd(self, which: str, level_zero_cross_mv: tuple[int, int]) -> tuple[int, int]:
        level_mv, zero_cross_mv = level_zero_cross_mv
        return (
            within(self._name, f"{which} CFD level", level_mv, "mV", hh.CFD_LEVEL_MV),
            within(self._name, f"{which} CFD zero crossing", zero_cross_mv, "mV", hh.CFD_ZERO_CROSS_MV),
        )
