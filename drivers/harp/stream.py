"""A timing instrument in time-tagged mode (T3): each photon and each marker as a record, while they come.

    with HarpStream(library, clock=SystemClock(), settings=settings, markers=Markers()) as tcspc:
        tcspc.start(10.0)
        for some in tcspc.records():
            some.batch.tag, some.batch.dtime, some.batch.channel
            ...

A thread of its own (`reader`) empties the instrument's memory, which in a HydraHarp 400 holds no more than
2 million records: 8 s of a usual rate, and 50 ms of the highest. What it read waits in a queue for the
caller. Nothing is dropped in between: if the queue stays full, the measurement ends with an error.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.errors import DeviceError, LimitError, ProtocolError
from drivers.harp import constants as hh
from drivers.harp.instrument import Instrument, Rates
from drivers.harp.library import HarpLibrary
from drivers.harp.limits import TAGGED_BINS
from drivers.harp.reader import QUEUE_PIECES, Fault, Piece, Reader
from drivers.harp.records import T3, Batch, DamagedRecordsError, Decoder
from drivers.harp.settings import HarpSettings, Integers, Markers
from drivers.leaving import leave

__all__ = ["Fault", "HarpStream", "Markers", "Piece", "TaggedRecords"]


@dataclass(frozen=True)
class TaggedRecords:
    """Some records with what they mean; valid until the next are taken.

    Attributes
    ----------
    words
        (n,) uint32, as the instrument gave them.
    batch
        The same, decoded; tags count sync pulses since the start.
    complete_to
        What comes later has this tag or a higher one.
    faults
        What went wrong near these records, as plain sentences.
    """

    words: NDArray[np.uint32]
    batch: Batch
    complete_to: int
    faults: tuple[str, ...]


class HarpStream(Instrument):
    """Records of an instrument in T3 mode.

    Parameters
    ----------
    library, clock, serial
        As `Instrument`.
    settings
        How it is set. Photons beyond the bins asked for are recorded too.
    markers
        How the marker inputs are set.
    queue_pieces
        How many pieces may wait for the caller.

    Raises
    ------
    LimitError
        If records cannot tell so many bins, or such an input, or the markers' hold-off is not possible.
    """

    _mode = hh.Mode.T3

    def __init__(
        self,
        library: HarpLibrary,
        *,
        clock: Clock,
        serial: str | None = None,
        settings: HarpSettings | None = None,
        markers: Markers | None = None,
        queue_pieces: int = QUEUE_PIECES,
    ) -> None:
        super().__init__(library, clock=clock, serial=serial, settings=settings)
        self._markers = markers or Markers()
        self._markers.hold_off_ns(self.limits)
        self._queue_pieces = queue_pieces
        self._span_bins = TAGGED_BINS
        self._reader: Reader | None = None
        Decoder(T3).decode(
            np.empty(0, np.uint32)
        )  # compiled the first time, which must not keep records waiting
        self.limits.check_tagged(self._settings.bins, self._settings.inputs)

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop a measurement that still runs, and close; pieces that nobody took are lost."""
        reader, self._reader = self._reader, None

        def close() -> None:
            if reader is None or reader.ended():
                super(HarpStream, self).__exit__(None, None, None)
            self._open_index = None  # a call that does not return holds the library: it takes no other

        leave([close] if reader is None else [reader.end, close], problem)

    @property
    def bins(self) -> int:
        """Number of bins asked for; photons beyond are recorded too."""
        return self._settings.bins

    def settings(self) -> dict[str, str | int | float | bool]:
        """Return the settings as last accepted; only the bin width can be read back."""
        settings = self._settings.as_dict() | self._markers.as_dict()
        return settings | {"mode": "time-tagged", "bin_width_s": self._bin_width_s}

    def start(self, duration_s: float | None = None) -> None:
        """Begin to measure; pieces of an earlier measurement that nobody took are lost.

        Parameters
        ----------
        duration_s
            Whole milliseconds, 1 ms to 100 h; None measures until `stop`, 100 h at most.

        Raises
        ------
        LimitError
            If the duration is not possible; nothing is sent then.
        DeviceError
            If a measurement runs.
        HarpError
            If the library refuses a call.
        """
        exposure = self.limits.exposure
        duration_ms = exposure.high if duration_s is None else self.limits.exposure_ms(duration_s)
        if self._reader is not None and self._reader.runs:
            raise DeviceError(
                self._name, "start a measurement", "another one still runs", "Stop it, or wait for its end."
            )
        index, before_s = self._index, self._clock.now_s()
        self._library.start_meas(index, duration_ms)
        self._reader = Reader(
            self._library,
            index,
            name=self._name,
            clock=self._clock,
            began_s=before_s,
            duration_s=duration_ms / 1000,
            queue_pieces=self._queue_pieces,
        )

    def stop(self) -> None:
        """End the measurement; what was recorded until now can still be taken.

        Raises
        ------
        LinkError
            If the library does not answer.
        """
        if self._reader is not None:
            self._reader.end()

    def pieces(self) -> Iterator[Piece]:
        """Yield what is recorded, as it comes, until the measurement ends.

        A lost sync or reference is told with the piece in which it was seen, and the measurement goes on:
        what it spoils is the caller's to judge.

        Raises
        ------
        DeviceError
            After the last piece: if the instrument's memory was full, if it reports a system error, or if the
            caller was too slow.
        LinkError
            If the measurement does not end in time, or the library does not answer.
        HarpError
            If the library refuses a call.
        ProtocolError
            If it says that it wrote more records than there is room for, or that the measurement is over when
            it cannot be.
        """
        return iter(()) if self._reader is None else self._reader.pieces()

    def records(self) -> Iterator[TaggedRecords]:
        """Yield what `pieces` yields, decoded; and nothing, many times a second, while nothing comes.

        Raises as `pieces`, and ProtocolError if the records make no sense.
        """
        if self._reader is None:
            return
        decoder = Decoder(T3)
        for piece in self._reader.pieces(idle=True):
            try:
                batch = decoder.decode(piece.records)
            except DamagedRecordsError as error:
                raise ProtocolError(self._name, "record each photon", str(error), self._restart) from None
            yield TaggedRecords(
                piece.records, batch, decoder.base, tuple(fault.sentence for fault in piece.faults)
            )

    def rates(self) -> Rates:
        """Return the rates, as `Instrument.rates`; also while it measures."""
        if self._reader is not None and self._reader.runs:
            rates: Rates = self._reader.ask(super().rates)
            return rates
        return super().rates()

    def warnings(self) -> tuple[str, ...]:
        """Return what it warns about, as `Instrument.warnings`; also while it measures."""
        if self._reader is not None and self._reader.runs:
            sentences: tuple[str, ...] = self._reader.ask(super().warnings)
            return sentences
        return super().warnings()

    @property
    def _held_bins(self) -> int:
        return self._settings.bins

    def _set_up_mode(self, index: int, wire: Integers) -> None:
        library, markers = self._library, self._markers
        self._require_features(library.get_features(index))
        self._set_bins(index, wire)
        m1, m2, m3, m4 = (hh.Edge.RISING if on else hh.Edge.FALLING for on in markers.rising)
        library.set_marker_edges(index, (m1, m2, m3, m4))
        library.set_marker_enable(index, markers.enabled)
        library.set_marker_holdoff_time(index, markers.hold_off_ns(self.limits))
        self._require_as_asked(TAGGED_BINS)

    def _require_features(self, features: hh.Feature) -> None:
        needed = hh.Feature.TTTR | (hh.Feature.MARKERS if any(self._markers.enabled) else hh.Feature(0))
        if missing := needed & ~features:
            raise LimitError(
                self._name,
                "record photons one by one",
                f"it does not have the option {missing.name}",
                "Measure histograms.",
            )
