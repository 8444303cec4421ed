"""What the modes of an instrument share: opening, identifying, inputs, rates, warnings, closing."""

from abc import ABC, abstractmethod
from contextlib import suppress
from dataclasses import dataclass, replace
from math import inf
from types import TracebackType
from typing import ClassVar, Self

from drivers.clock import Clock
from drivers.errors import DeviceError, DeviceNotFoundError, ProtocolError
from drivers.harp import constants as hh
from drivers.harp.errors import DEVICE_OPEN_FAIL, HarpError
from drivers.harp.families import OFFSET_UNNECESSARY
from drivers.harp.library import HarpLibrary
from drivers.harp.limits import SAME
from drivers.harp.settings import HarpSettings, Integers
from drivers.harp.triggers import TriggerMode
from drivers.leaving import leave

#: More inputs (a detector of many pixels, simulated), and bin widths of more powers of two, none can have.
MAX_INPUTS, MAX_BINNINGS = 4096, 64

#: How late the end of a measurement may come [s]; in addition, the part of its duration by which the clocks
#: of instrument and computer may differ.
LATE_S = 1.0
CLOCK_ERROR = 1e-3

#: The vendor's documents name some jitter as all that a divider costs. Were the skipped pulses not counted in
#: again, most photons would lie beyond the histogram: told until somebody has seen it on an instrument.
DIVIDED = (
    "The sync divider is {divider}. That photons are timed against the pulses that it skips too, as the "
    "vendor's documents suggest, was not confirmed on an instrument: hold the counts of a histogram against "
    "the count rate once."
)


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


class Instrument(ABC):
    """One instrument, opened for one of its modes.

    Parameters
    ----------
    library
        The vendor's library, see `drivers.harp.loading.load_library`; it says of which family it is.
    clock
        The time to wait by.
    serial
        Serial number of the instrument; None takes the only one that is there.
    settings
        How it is set; of the library's family.

    Attributes
    ----------
    limits
        What it can be set to: what holds for its whole family, and once it is open, what holds for this one.
    """

    _mode: ClassVar[hh.Mode]

    def __init__(
        self,
        library: HarpLibrary,
        *,
        clock: Clock,
        serial: str | None = None,
        settings: HarpSettings | None = None,
    ) -> None:
        self._family = library.family
        self._settings = settings or HarpSettings(family=self._family)
        if self._settings.family != self._family:
            raise ValueError(f"settings of a {self._settings.family.name} for a {self._family.name}")
        self.limits = self._family.limits
        self._name = f"{self._family.name} {serial}" if serial else self._family.name
        self._library = library
        self._clock = clock
        self._serial = serial
        self._open_index: int | None = None
        self._identity = ""
        self._bin_width_s = self._settings.width_s
        self._span_bins = 0  # that the instrument measures, of which settings.bins are asked for

    def __enter__(self) -> Self:
        """Open, identify, calibrate and set up the instrument, in the order that the manual asks for.

        Raises
        ------
        DeviceNotFoundError
            If the instrument is not connected, none is named and several are, or the library is of another
            release.
        LimitError
            If this instrument has no such input or bin width; no setting is sent then.
        HarpError
            If the library refuses a call.
        ProtocolError
            If a setting reads back other than it was sent.
        """
        family, release = self._family, self._library.get_library_version()
        if release not in family.versions:
            raise DeviceNotFoundError(
                self._name,
                f"use {self._library.name}",
                f"its version is {release}, not {' or '.join(family.versions)}",
                f"Install {family.library} {family.versions[-1]}.",
            )
        index, serial = _open_by_serial(self._library, self._serial)
        self._name = f"{family.name} {serial}"
        try:
            external = self._settings.external_reference
            reference = hh.Reference.EXTERNAL if external else hh.Reference.INTERNAL
            self._library.initialize(index, self._mode, reference)
            model, part, version = self._library.get_hardware_info(index)
            self._require_model(model)
            self._set_up(index)
            self._clock.sleep(hh.RATE_WAIT_S)
        except BaseException as problem:
            self._close(index, problem)
            raise
        self._identity = (
            f"PicoQuant {model}, part {part}, version {version}, serial {serial}, {family.library} {release}"
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
    def bin_width_s(self) -> float:
        """The bin width that the instrument really uses, read back after opening."""
        return self._bin_width_s

    @property
    def first_bin_s(self) -> float:
        """Left edge of the first bin after the sync pulse, the offsets of sync and inputs already applied."""
        return self.limits.offset.nearest(self._settings.offset_s) * 1e-9

    def rates(self) -> Rates:
        """Return the rates of sync and photon inputs; the instrument renews them each 100 ms.

        Raises
        ------
        HarpError
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
                "report its count rates",
                f"it reports {sync_hz:g} Hz of sync pulses and "
                f"{', '.join(f'{one:g}' for one in inputs_hz)} Hz",
                self._restart,
            )
        return Rates(sync_hz, inputs_hz)

    def warnings(self) -> tuple[str, ...]:
        """Return what the instrument warns about at the present rates, as plain sentences."""
        library, index = self._library, self._index
        library.get_sync_rate(index)  # warnings are computed from the rates that were read last
        for channel in range(self.limits.inputs or 0):
            library.get_count_rate(index, channel)
        raised = library.get_warnings(index)
        if self._settings.bins > self._held_bins - self.first_bin_s / self.bin_width_s:
            # the instrument judges by its longest histogram; in the one that is used, the offset is needed
            raised &= ~OFFSET_UNNECESSARY
        meanings = self._family.warnings
        sentences = [text for bit, text in meanings.items() if raised & bit]
        unknown = raised & ~sum(meanings)
        if unknown:
            sentences.append(" ".join(library.get_warnings_text(index, unknown).split()))
        if self._settings.sync_divider > 1:
            sentences.append(DIVIDED.format(divider=self._settings.sync_divider))
        return tuple(sentences)

    @property
    def _held_bins(self) -> int:
        """How many bins of each photon's time are kept."""
        return self._span_bins

    @property
    def _index(self) -> int:
        if self._open_index is None:
            raise DeviceError(self._name, "work", "it is not open", "Use it inside its `with` block.")
        return self._open_index

    @abstractmethod
    def _set_up_mode(self, index: int, wire: Integers) -> None:
        """Send the settings of this mode."""

    def _set_up(self, index: int) -> None:
        """Learn this instrument's limits, then calibrate it and send all settings; see `__enter__`."""
        library = self._library
        inputs = library.get_num_of_input_channels(index)
        base_ps, binnings = library.get_base_resolution(index)
        self._require_sane(inputs, base_ps, binnings)
        self.limits = replace(
            self._family.limits, device=self._name, inputs=inputs, base_ps=base_ps, binnings=binnings
        )
        wire = self._settings.integers(self.limits)
        if self._family.calibrates:
            library.calibrate(index)
        self._set_up_inputs(index, wire, inputs)
        self._set_up_mode(index, wire)

    def _set_up_inputs(self, index: int, wire: Integers, inputs: int) -> None:
        library, settings = self._library, self._settings
        library.set_sync_div(index, settings.sync_divider)
        self._set_sync_trigger(index, wire)
        library.set_sync_channel_offset(index, wire.sync_offset_ps)
        for channel in range(inputs):
            used = channel in settings.inputs
            if used:
                self._set_input_trigger(index, channel, wire)
                offset_ps = wire.input_offsets_ps[settings.inputs.index(channel)]
                library.set_input_channel_offset(index, channel, offset_ps)
            library.set_input_channel_enable(index, channel, used)

    def _set_sync_trigger(self, index: int, wire: Integers) -> None:
        library, trigger = self._library, wire.sync_trigger
        if self.limits.has_both_triggers:
            library.set_sync_trg_mode(index, trigger.mode)
        send = library.set_sync_cfd if trigger.mode is TriggerMode.CFD else library.set_sync_edge_trg
        send(index, trigger.level_mv, trigger.second)

    def _set_input_trigger(self, index: int, channel: int, wire: Integers) -> None:
        library, trigger = self._library, wire.input_trigger
        if self.limits.has_both_triggers:
            library.set_input_trg_mode(index, channel, trigger.mode)
        send = library.set_input_cfd if trigger.mode is TriggerMode.CFD else library.set_input_edge_trg
        send(index, channel, trigger.level_mv, trigger.second)

    def _set_bins(self, index: int, wire: Integers) -> None:
        """Set width and beginning of the bins, and read the width back."""
        self._library.set_binning(index, wire.binning)
        self._library.set_offset(index, wire.offset_ns)
        self._bin_width_s = self._library.get_resolution(index) * 1e-12

    def _require_model(self, model: str) -> None:
        """Refuse another model than the one that was asked for, where a family's models differ."""
        asked = self._family.model
        if asked and model != asked:
            raise DeviceNotFoundError(
                self._name,
                f"measure as a {asked}",
                f"it is a {model}",
                "Configure the board that is installed.",
            )

    @property
    def _restart(self) -> str:
        restart = self._family.link.restart
        return f"{restart[0].upper()}{restart[1:]}."

    def _require_sane(self, inputs: int, base_ps: float, binnings: int) -> None:
        """Refuse an instrument that says of itself what none can be."""
        if 1 <= inputs <= MAX_INPUTS and 0 < base_ps < inf and 1 <= binnings <= MAX_BINNINGS:
            return
        raise ProtocolError(
            self._name,
            "report its inputs, its finest bin width and its number of bin widths",
            f"it reports {inputs}, {base_ps:g} ps and {binnings}",
            self._restart,
        )

    def _require_as_asked(self, longest: int) -> None:
        """Refuse an instrument that counts in other bins than those that it was asked for."""
        asked_s, bins = self._settings.width_s, self._settings.bins
        as_wide = abs(self._bin_width_s - asked_s) <= SAME * asked_s  # a width that is no number is not
        if not (as_wide and bins <= self._span_bins <= longest):
            raise ProtocolError(
                self._name,
                f"count in {bins} bins of {asked_s:g} s",
                f"it reports {self._span_bins} bins of {self._bin_width_s:g} s",
                self._restart,
            )

    def _close(self, index: int, problem: BaseException | None) -> None:
        """Stop and close, whether or not something runs, and whatever ``problem`` is on its way."""

        def stop() -> None:
            with suppress(HarpError):  # there may be nothing to stop
                self._library.stop_meas(index)

        leave([stop, lambda: self._library.close_device(index)], problem)


def system_error(library: HarpLibrary, index: int, name: str) -> DeviceError:
    """Return what to raise where counts are worthless, with the instrument's own report."""
    report, restart = " ".join(library.get_debug_info(index).split()), library.family.link.restart
    return DeviceError(
        name,
        "measure",
        f"it reports a system error: {report[:500] or 'no details'}",
        f"{restart[0].upper()}{restart[1:]}; if that does not help, send PicoQuant its debug report.",
    )


def _open_by_serial(library: HarpLibrary, serial: str | None) -> tuple[int, str]:
    """Open the instrument with this serial number, or the only one if ``serial`` is None.

    All others that had to be opened to learn their serial numbers are closed again.

    Returns
    -------
    tuple of int and str
        The index of the open instrument, and its serial number.

    Raises
    ------
    HarpError
        If it was not found but an instrument is there that could not be opened, e.g. because another
        program uses it: that may be the one.
    DeviceNotFoundError
        If it is not connected, or none is named and several are there.
    """
    chosen: tuple[int, str] | None = None
    others: list[str] = []
    unopened: HarpError | None = None
    for index in range(library.family.devices):
        try:
            found = library.open_device(index)
        except HarpError as error:
            if error.code != DEVICE_OPEN_FAIL:
                unopened = unopened or error
            continue
        if found == serial:
            return index, found
        if serial is None and chosen is None:
            chosen = index, found
            continue
        others.append(found)
        library.close_device(index)
    if chosen is not None and not others and unopened is None:
        return chosen
    if chosen is not None:
        library.close_device(chosen[0])
        raise _several([chosen[1], *others], library, unopened)
    if unopened is not None:
        raise unopened
    raise _none(library, serial, others)


def _none(library: HarpLibrary, serial: str | None, others: list[str]) -> DeviceNotFoundError:
    """Return what to raise where the instrument is not there."""
    name = library.family.name
    return DeviceNotFoundError(
        f"{name} {serial}" if serial else name,
        f"open it through {library.name}",
        f"only {', '.join(others)} can be opened" if others else f"no {name} was found",
        f"Check its serial number. {library.family.link.absent}",
    )


def _several(serials: list[str], library: HarpLibrary, unopened: HarpError | None) -> DeviceNotFoundError:
    """Return what to raise where it is not said which of several instruments is meant."""
    one_more = f", and one that cannot be opened ({unopened.code_name})" if unopened else ""
    return DeviceNotFoundError(
        library.family.name,
        f"open the only one through {library.name}",
        f"several were found: {', '.join(serials)}{one_more}",
        "Give the serial number of the one to use (tcspc.serial).",
    )
