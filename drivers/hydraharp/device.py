"""The HydraHarp 400 in histogram mode, as one context manager.

Not implemented: T2, T3 and continuous mode, markers, external start and stop (C1, C2), the stop at a
full bin; `HHLib` has their functions.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock, wait_until
from drivers.errors import DeviceError, DeviceNotFoundError, LinkError, ProtocolError
from drivers.hydraharp import constants as hh
from drivers.hydraharp.errors import ErrorCode, HydraHarpError
from drivers.hydraharp.library import HHLib, histogram_buffers
from drivers.hydraharp.limits import LIMITS, SAME, HydraHarpLimits
from drivers.hydraharp.settings import HydraHarpSettings
from drivers.leaving import leave

#: How often the end of a measurement is asked for, and how late it may come [s]; in addition, the part of
#: the exposure by which the clocks of instrument and computer may differ.
POLL_S = 1e-3
LATE_S = 1.0
CLOCK_ERROR = 1e-3

#: How often the caller is asked during an exposure whether it shall go on.
MEANWHILE_S = 0.05

#: More inputs (a detector of many pixels, simulated), and bin widths of more powers of two, none can have.
MAX_INPUTS, MAX_BINNINGS = 4096, 64


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


@dataclass(frozen=True)
class Rates:
    """Rates in counts a second.

    Attributes
    ----------
    sync_hz
        At the sync input, the divider accounted for.
    inputs_hz
        At each photon input in use, in the order of the counts.
    """

    sync_hz: float
    inputs_hz: tuple[float, ...]

    @property
    def input_hz(self) -> float:
        """Counts a second at all inputs together."""
        return sum(self.inputs_hz)


class HydraHarp:
    """Inputs of a HydraHarp 400 timed against its sync input.

    The histogram inside the instrument is the shortest that holds the bins asked for, since its length
    decides how long a readout takes.

    Parameters
    ----------
    library
        The vendor's library, see `drivers.hydraharp.loading.load_library`.
    clock
        The time to wait by.
    serial
        Serial number of the instrument; None takes the first that can be opened.
    settings
        How it is set.

    Attributes
    ----------
    limits
        What it can be set to: what holds for every HydraHarp, and once it is open, what holds for this one.
    """

    limits: HydraHarpLimits = LIMITS

    def __init__(
        self,
        library: HHLib,
        *,
        clock: Clock,
        serial: str | None = None,
        settings: HydraHarpSettings | None = None,
    ) -> None:
        self._name = f"HydraHarp {serial}" if serial else "HydraHarp"
        self._library = library
        self._clock = clock
        self._serial = serial
        self._settings = settings or HydraHarpSettings()
        self._open_index: int | None = None
        self._identity = ""
        self._bin_width_s = self._settings.bin_width_s
        self._histogram_bins = 0
        self._rows = histogram_buffers(len(self._settings.inputs))
        self._counts = np.ctypeslib.as_array(self._rows)[:, : self._settings.bins]

    def __enter__(self) -> Self:
        """Open, identify, calibrate and set up the instrument, in the order that the manual asks for.

        Raises
        ------
        DeviceNotFoundError
            If the instrument is not connected, or the library is of another release.
        LimitError
            If this instrument has no such input or bin width; no setting is sent then.
        HydraHarpError
            If the library refuses a call.
        ProtocolError
            If a setting reads back other than it was sent.
        """
        release = self._library.get_library_version()
        if release != hh.LIBRARY_VERSION:
            raise DeviceNotFoundError(
                self._name,
                f"use {self._library.name}",
                f"its version is {release}, not {hh.LIBRARY_VERSION}",
                f"Install HHLib {hh.LIBRARY_VERSION}.",
            )
        index, serial = _open_by_serial(self._library, self._serial)
        self._name = f"HydraHarp {serial}"
        try:
            external = self._settings.external_reference
            reference = hh.Reference.EXTERNAL if external else hh.Reference.INTERNAL
            self._library.initialize(index, hh.Mode.HISTOGRAM, reference)
            model, part, version = self._library.get_hardware_info(index)
            self._set_up(index)
            self._clock.sleep(hh.RATE_WAIT_S)
        except BaseException as problem:
            self._close(index, problem)
            raise
        self._identity = (
            f"PicoQuant {model}, part {part}, version {version}, serial {serial}, HHLib {hh.LIBRARY_VERSION}"
        )
        self._open_index = index
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop a measurement that still runs, and close."""
        index, self._open_index = self._open_index, None
        if index is not None:
            self._close(index, problem)

    @property
    def identity(self) -> str:
        """Maker, model, part number, version, serial number and library version."""
        return self._identity

    @property
    def bins(self) -> int:
        """Number of bins of a histogram."""
        return self._settings.bins

    @property
    def bin_width_s(self) -> float:
        """The bin width that the instrument really uses, read back after opening."""
        return self._bin_width_s

    @property
    def first_bin_s(self) -> float:
        """Left edge of the first bin after the sync pulse, the offsets of sync and inputs already applied."""
        return self.limits.offset.nearest(self._settings.offset_s) * 1e-9

    def settings(self) -> dict[str, str | int | float | bool]:
        """Return the settings as last accepted; only the bin width can be read back."""
        read_back = {"bin_width_s": self._bin_width_s, "histogram_bins": self._histogram_bins}
        return self._settings.as_dict() | read_back

    def measure(self, exposure_s: float, meanwhile: Callable[[], bool] = lambda: False) -> Exposure:
        """Clear, expose for ``exposure_s``, and return the histogram of each input.

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
        HydraHarpError
            If the library refuses a call.
        DeviceError
            If the instrument reports a system error.
        """
        duration_ms = self.limits.exposure_ms(exposure_s)
        library, index = self._library, self._index
        library.clear_hist_mem(index)
        try:
            library.start_meas(index, duration_ms)
            whole = self._expose(duration_ms, meanwhile)
        except BaseException:
            with suppress(HydraHarpError):
                library.stop_meas(index)
            raise
        live_s = duration_ms / 1000 if whole else library.get_elapsed_meas_time(index) / 1000
        library.stop_meas(index)
        for row, channel in enumerate(self._settings.inputs):
            library.get_histogram(index, channel, self._rows[row])
        return Exposure(self._counts, live_s, self._sentences(library.get_flags(index)), whole)

    def _expose(self, duration_ms: int, meanwhile: Callable[[], bool]) -> bool:
        """Wait for the end of an exposure; return False if ``meanwhile`` ended it before."""
        until_s = self._clock.now_s() + duration_ms / 1000
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
                "Check the USB link, and switch the HydraHarp off and on.",
            )
        if duration_ms / 1000 > MEANWHILE_S:
            meanwhile()  # a long exposure may take long to read, too
        return True

    def rates(self) -> Rates:
        """Return the rates of sync and photon inputs; the instrument renews them each 100 ms.

        Raises
        ------
        HydraHarpError
            If the library refuses a call.
        ProtocolError
            If a rate is negative.
        """
        library, index = self._library, self._index
        sync_hz = float(library.get_sync_rate(index))
        inputs_hz = tuple(float(library.get_count_rate(index, n)) for n in self._settings.inputs)
        if min(sync_hz, *inputs_hz) < 0:
            raise ProtocolError(
                self._name,
                "tell its count rates",
                f"it says {sync_hz:g} Hz of sync pulses and {', '.join(f'{one:g}' for one in inputs_hz)} Hz",
                "Switch the HydraHarp off and on.",
            )
        return Rates(sync_hz, inputs_hz)

    def warnings(self) -> tuple[str, ...]:
        """Return what the instrument warns about at the present rates, as plain sentences."""
        library, index = self._library, self._index
        library.get_sync_rate(index)  # warnings are computed from the rates that were read last
        for channel in range(self.limits.inputs or 0):
            library.get_count_rate(index, channel)
        raised = library.get_warnings(index)
        if self._settings.bins > self._histogram_bins - self.first_bin_s / self.bin_width_s:
            # the instrument judges by its longest histogram; in the one that is used, the offset is needed
            raised &= ~hh.Warn.OFFSET_UNNECESSARY
        sentences = [text for bit, text in hh.WARNING_SENTENCES.items() if raised & bit]
        unknown = int(raised) & ~sum(hh.WARNING_SENTENCES)
        if unknown:
            sentences.append(" ".join(library.get_warnings_text(index, unknown).split()))
        return tuple(sentences)

    @property
    def _index(self) -> int:
        if self._open_index is None:
            raise DeviceError(self._name, "work", "it is not open", "Use it inside its `with` block.")
        return self._open_index

    def _set_up(self, index: int) -> None:
        """Learn this instrument's limits, then calibrate it and send all settings; see `__enter__`."""
        library, settings = self._library, self._settings
        inputs = library.get_num_of_input_channels(index)
        base_ps, binnings = library.get_base_resolution(index)
        self._require_sane(inputs, base_ps, binnings)
        self.limits = replace(LIMITS, device=self._name, inputs=inputs, base_ps=base_ps, binnings=binnings)
        wire = settings.integers(self.limits)
        library.calibrate(index)
        library.set_sync_div(index, settings.sync_divider)
        library.set_sync_cfd(index, *wire.sync_cfd_mv)
        library.set_sync_channel_offset(index, wire.sync_offset_ps)
        for channel in range(inputs):
            used = channel in settings.inputs
            if used:
                library.set_input_cfd(index, channel, *wire.input_cfd_mv)
                offset_ps = wire.input_offsets_ps[settings.inputs.index(channel)]
                library.set_input_channel_offset(index, channel, offset_ps)
            library.set_input_channel_enable(index, channel, used)
        self._histogram_bins = library.set_histo_len(index, wire.length)
        library.set_binning(index, wire.binning)
        library.set_offset(index, wire.offset_ns)
        self._bin_width_s = library.get_resolution(index) * 1e-12
        library.set_stop_overflow(index, False, hh.MAX_STOP_COUNT)
        library.set_meas_control(index, hh.MeasControl.SINGLESHOT_CTC, hh.Edge.RISING, hh.Edge.FALLING)
        self._require_as_asked()

    def _require_sane(self, inputs: int, base_ps: float, binnings: int) -> None:
        """Refuse an instrument that says of itself what none can be."""
        if 1 <= inputs <= MAX_INPUTS and 0 < base_ps < inf and 1 <= binnings <= MAX_BINNINGS:
            return
        raise ProtocolError(
            self._name,
            "tell its inputs, its finest bin width and its number of bin widths",
            f"it says {inputs}, {base_ps:g} ps and {binnings}",
            "Switch the HydraHarp off and on.",
        )

    def _require_as_asked(self) -> None:
        asked_s, bins = self._settings.bin_width_s, self._settings.bins
        as_wide = abs(self._bin_width_s - asked_s) <= SAME * asked_s  # a width that is no number is not
        if not (as_wide and bins <= self._histogram_bins <= self.limits.max_bins):
            raise ProtocolError(
                self._name,
                f"make histograms of {bins} bins of {asked_s:g} s",
                f"it reports {self._histogram_bins} bins of {self._bin_width_s:g} s",
                "Switch the HydraHarp off and on.",
            )

    def _sentences(self, flags: hh.Flag) -> tuple[str, ...]:
        """Turn state flags into sentences, or into an error where the counts are worthless."""
        if not flags:
            return ()
        if flags & hh.Flag.SYSERROR:
            report = " ".join(self._library.get_hardware_debug_info(self._index).split())
            raise DeviceError(
                self._name,
                "measure",
                f"it reports a system error: {report[:500] or 'no details'}",
                "Switch the HydraHarp off and on; if that does not help, send PicoQuant its debug report.",
            )
        sentences = [text for bit, text in hh.FLAG_SENTENCES.items() if flags & bit]
        if unknown := int(flags) & ~int(hh.Flag.ACTIVE | sum(hh.FLAG_SENTENCES, hh.Flag(0))):
            sentences.append(
                f"The instrument raised flags 0x{unknown:X}, which HHLib {hh.LIBRARY_VERSION} does not "
                "explain: ask PicoQuant what they mean before the counts are used."
            )
        return tuple(sentences)

    def _close(self, index: int, problem: BaseException | None) -> None:
        """Stop and close, whether or not something runs, and whatever ``problem`` is on its way."""

        def stop() -> None:
            with suppress(HydraHarpError):  # there may be nothing to stop
                self._library.stop_meas(index)

        leave([stop, lambda: self._library.close_device(index)], problem)


def _open_by_serial(library: HHLib, serial: str | None) -> tuple[int, str]:
    """Open the instrument with this serial number, or the first that opens if ``serial`` is None.

    All others that had to be opened to learn their serial numbers are closed again.

    Returns
    -------
    tuple of int and str
        The index of the open instrument, and its serial number.

    Raises
    ------
    HydraHarpError
        If it was not found but an instrument is there that could not be opened, e.g. because another
        program uses it: that may be the one.
    DeviceNotFoundError
        If it is not connected.
    """
    others: list[str] = []
    unopened: HydraHarpError | None = None
    for index in range(hh.MAX_DEVICES):
        try:
            found = library.open_device(index)
        except HydraHarpError as error:
            if error.code != ErrorCode.DEVICE_OPEN_FAIL:
                unopened = unopened or error
            continue
        if serial is None or found == serial:
            return index, found
        others.append(found)
        library.close_device(index)
    if unopened is not None:
        raise unopened
    there = f"only {', '.join(others)} can be opened" if others else "no HydraHarp is there"
    raise DeviceNotFoundError(
        f"HydraHarp {serial}" if serial else "HydraHarp",
        f"open it through {library.name}",
        there,
        "Check serial number, power and USB cable; "
        "on Linux a missing udev permission for USB vendor 0e0d looks the same.",
    )
