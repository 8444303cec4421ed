"""The settings of histogram mode in the instrument's own integers, and how they are sent."""

from dataclasses import dataclass

from drivers.errors import ProtocolError
from drivers.hydraharp import constants as hh
from drivers.hydraharp.library import HHLib
from drivers.hydraharp.limits import SAME, binning_code, length_code, within


@dataclass(frozen=True)
class Accepted:
    """What the instrument made of a `Setup`.

    Attributes
    ----------
    inputs
        Number of inputs it has.
    bin_width_s
        The bin width, read back.
    histogram_bins
        Length of its histograms.
    """

    inputs: int
    bin_width_s: float
    histogram_bins: int


@dataclass(frozen=True, kw_only=True)
class Setup:
    """Everything that is set once, already checked against the fixed limits; see `HydraHarp` for the meaning.

    ``span_s`` is the time that the histogram must cover, if only by bins that nobody reads.
    """

    reference: hh.Reference
    sync_divider: int
    sync_cfd_mv: tuple[int, int]
    sync_offset_ps: int
    input_channel: int
    input_cfd_mv: tuple[int, int]
    input_offset_ps: int
    bin_width_s: float
    bins: int
    span_s: float
    offset_ns: int
    stop_overflow: int | None

    def send(self, library: HHLib, index: int, device: str) -> Accepted:
        """Calibrate and set up an initialised instrument, in the order that the manual asks for.

        Raises
        ------
        LimitError
            If this instrument has no such input or bin width; no setting is sent then.
        ProtocolError
            If a setting reads back other than it was sent.
        """
        inputs = library.get_num_of_input_channels(index)
        within(device, "input channel", self.input_channel, "", (0, inputs - 1))
        base_ps, steps = library.get_base_resolution(index)
        binning = binning_code(device, self.bin_width_s, base_ps, steps)
        length = length_code(self.bins, self.span_s, self.bin_width_s)
        library.calibrate(index)
        library.set_sync_div(index, self.sync_divider)
        library.set_sync_cfd(index, *self.sync_cfd_mv)
        library.set_sync_channel_offset(index, self.sync_offset_ps)
        for channel in range(inputs):
            if channel == self.input_channel:
                library.set_input_cfd(index, channel, *self.input_cfd_mv)
                library.set_input_channel_offset(index, channel, self.input_offset_ps)
            library.set_input_channel_enable(index, channel, channel == self.input_channel)
        histogram_bins = library.set_histo_len(index, length)
        library.set_binning(index, binning)
        library.set_offset(index, self.offset_ns)
        bin_width_s = library.get_resolution(index) * 1e-12
        stop_count = self.stop_overflow or hh.STOP_COUNT[1]
        library.set_stop_overflow(index, self.stop_overflow is not None, stop_count)
        library.set_meas_control(index, hh.MeasControl.SINGLESHOT_CTC, hh.Edge.RISING, hh.Edge.FALLING)
        if abs(bin_width_s - self.bin_width_s) > SAME * self.bin_width_s or histogram_bins < self.bins:
            raise ProtocolError(
                device,
                f"make histograms of {self.bins} bins of {self.bin_width_s:g} s",
                f"it reports {histogram_bins} bins of {bin_width_s:g} s",
                "Switch the HydraHarp off and on.",
            )
        return Accepted(inputs, bin_width_s, histogram_bins)

    def as_dict(self) -> dict[str, str | int | float | bool]:
        """Return the settings in SI units; discriminators in mV."""
        return {
            "mode": "histogram",
            "reference": self.reference.name.lower(),
            "sync_divider": self.sync_divider,
            "sync_cfd_level_mv": self.sync_cfd_mv[0],
            "sync_cfd_zero_cross_mv": self.sync_cfd_mv[1],
            "sync_offset_s": self.sync_offset_ps * 1e-12,
            "input_channel": self.input_channel,
            "input_cfd_level_mv": self.input_cfd_mv[0],
            "input_cfd_zero_cross_mv": self.input_cfd_mv[1],
            "input_offset_s": self.input_offset_ps * 1e-12,
            "bin_width_s": self.bin_width_s,
            "bins": self.bins,
            "offset_s": self.offset_ns * 1e-9,
            "stop_overflow": self.stop_overflow is not None,
            "stop_count": self.stop_overflow or hh.STOP_COUNT[1],
        }
