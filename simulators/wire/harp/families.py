"""The families that are simulated: what their libraries call things, take and answer. No C.

Transcribed apart from the driver's own table, so that a mistake in one shows in the other. Sources: the
vendor's headers and demos (HydraHarp 400, MultiHarp, TimeHarp 260), the headers as others publish them
(PicoHarp 330), and the libraries, asked without an instrument (all; of the HydraHarp 500 nothing else is
public). How an instrument that is open behaves is the HydraHarp's manual throughout, and the MultiHarp's
where it says something else.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

_ALL = {
    0: "NONE",
    -1: "DEVICE_OPEN_FAIL",
    -2: "DEVICE_BUSY",
    -3: "DEVICE_HEVENT_FAIL",
    -4: "DEVICE_CALLBSET_FAIL",
    -5: "DEVICE_BARMAP_FAIL",
    -6: "DEVICE_CLOSE_FAIL",
    -7: "DEVICE_RESET_FAIL",
    -8: "DEVICE_GETVERSION_FAIL",
    -9: "DEVICE_VERSION_MISMATCH",
    -10: "DEVICE_NOT_OPEN",
    -11: "DEVICE_LOCKED",
    -16: "INSTANCE_RUNNING",
    -17: "INVALID_ARGUMENT",
    -18: "INVALID_MODE",
    -19: "INVALID_OPTION",
    -20: "INVALID_MEMORY",
    -21: "INVALID_RDATA",
    -22: "NOT_INITIALIZED",
    -23: "NOT_CALIBRATED",
    -24: "DMA_FAIL",
    -25: "XTDEVICE_FAIL",
    -26: "FPGACONF_FAIL",
    -27: "IFCONF_FAIL",
    -28: "FIFORESET_FAIL",
    -32: "USB_GETDRIVERVER_FAIL",
    -33: "USB_DRIVERVER_MISMATCH",
    -34: "USB_GETIFINFO_FAIL",
    -35: "USB_HISPEED_FAIL",
    -36: "USB_VCMD_FAIL",
    -37: "USB_BULKRD_FAIL",
    -40: "LANEUP_TIMEOUT",
    -41: "DONEALL_TIMEOUT",
    -43: "MACTIVE_TIMEOUT",
    -44: "MEMCLEAR_FAIL",
    -45: "MEMTEST_FAIL",
    -46: "CALIB_FAIL",
    -47: "REFSEL_FAIL",
    -48: "STATUS_FAIL",
    -49: "MODNUM_FAIL",
    -50: "DIGMUX_FAIL",
    -51: "MODMUX_FAIL",
    -52: "MODFWPCB_MISMATCH",
    -53: "MODFWVER_MISMATCH",
    -54: "MODPROPERTY_MISMATCH",
    -55: "INVALID_MAGIC",
    -56: "INVALID_LENGTH",
    -64: "EEPROM_F01",
    -65: "EEPROM_F02",
    -66: "EEPROM_F03",
    -67: "EEPROM_F04",
    -68: "EEPROM_F05",
    -69: "EEPROM_F06",
    -70: "EEPROM_F07",
    -71: "EEPROM_F08",
    -72: "EEPROM_F09",
    -73: "EEPROM_F10",
    -74: "EEPROM_F11",
}
_USB = {-38: "USB_RESET_FAIL", -57: "RATE_FAIL", -58: "MODFWVER_TOO_LOW", -59: "MODFWVER_TOO_HIGH"}
_NEWER = {
    -12: "DEVICE_DRIVERVER_MISMATCH",
    -29: "THREADSTATE_FAIL",
    -30: "THREADLOCK_FAIL",
    -42: "MB_ACK_TIMEOUT",
    -80: "UNSUPPORTED_FUNCTION",
}
_LATEST = {
    **_ALL,
    **_USB,
    **_NEWER,
    -60: "MB_ACK_FAIL",
    -75: "EEPROM_F12",
    -76: "EEPROM_F13",
    -77: "EEPROM_F14",
    -78: "EEPROM_F15",
    -81: "WRONG_TRGMODE",
    -82: "BULKRDINIT_FAIL",
    -83: "CREATETHREAD_FAIL",
    -84: "FILEOPEN_FAIL",
    -85: "FILEWRITE_FAIL",
    -86: "FILEREAD_FAIL",
    -201: "INVALID_ARGUMENT_1",
    -202: "INVALID_ARGUMENT_2",
    -203: "INVALID_ARGUMENT_3",
    -204: "INVALID_ARGUMENT_4",
    -205: "INVALID_ARGUMENT_5",
    -206: "INVALID_ARGUMENT_6",
    -207: "INVALID_ARGUMENT_7",
    -208: "INVALID_ARGUMENT_8",
}


@dataclass(frozen=True)
class Range:
    """Whole numbers from ``low`` to ``high``, as an argument takes them."""

    low: int
    high: int

    def __contains__(self, value: int) -> bool:
        return self.low <= value <= self.high


@dataclass(frozen=True)
class FlagBits:
    """Bits of GetFlags that are simulated; 0 where the family has none."""

    overflow: int = 0x01
    fifo_full: int = 0x02
    sync_lost: int = 0x04
    reference_lost: int = 0x08
    active: int = 0x20


@dataclass(frozen=True)
class SimulatedFamily:
    """One family, as its library shows it.

    Attributes
    ----------
    prefix, version, model
        Of the functions; of the library; what the instrument calls itself.
    errors, unknown_error
        Names of the codes without ``PREFIX_ERROR_``, and the whole text for those that do not exist.
    says_which_argument
        Whether a wrong argument is answered with -200 and its place (counted from 1), or with -17.
    devices
        Number of indices.
    base_ps, binnings
        Of the simulated instrument; GetBaseResolution.
    longest_code, shortest_code
        Length codes of histograms, and the shortest that GetHistogram reads.
    largest_divider, offset_ns, hold_off_ns, control
        What SetSyncDiv, SetOffset, SetMarkerHoldoffTime and SetMeasControl take; the largest control without
        continuous mode is 3 (4 to 6 are that mode's in a HydraHarp 400).
    cfd_mv, zero_cross_mv, edge_mv
        Levels that the triggers take; None where there is no such trigger. The HydraHarp's are magnitudes.
    triggers
        Those that the instrument has, of those that its library knows: 0 edges, 1 discriminators.
    references
        What Initialize takes as source of the reference clock; None where it is not told.
    modes
        What Initialize takes as mode.
    clears, calibrates, counted_reads, debug
        Whether GetHistogram takes an order to clear, whether there is Calibrate, whether ReadFiFo is told how
        many records there is room for, and the name of the function for reports.
    looks_at_channel, looks_at_enable
        Whether a negative channel, or an enable other than 0 and 1, is refused before the state is looked at.
    fifo_records
        Most records that one read brings.
    warns_sync_hz, warns_inputs_hz
        Divided sync rate, and sum of the input rates, above which it warns.
    warns_divider
        Whether it warns of a divider that is too small, and of one that is not needed.
    flags
        Bits of its flags.
    sync_period_unit_s
        Unit of GetSyncPeriod: 1.0 as the manuals of MultiHarp and TimeHarp say and the vendor's C demo takes
        it, or 1e-12 as the manual of the HydraHarp 400 says. Which a real one gives is unconfirmed.
    """

    prefix: str
    version: str
    model: str
    errors: Mapping[int, str]
    unknown_error: str = ""
    says_which_argument: bool = True
    devices: int = 8
    base_ps: float = 1.0
    binnings: int = 24
    longest_code: int = 6
    shortest_code: int = 2
    largest_divider: int = 16
    offset_ns: int = 100_000_000
    hold_off_ns: int = 25_500
    control: int = 6
    cfd_mv: Range | None = None
    zero_cross_mv: Range | None = None
    edge_mv: Range | None = None
    triggers: tuple[int, ...] = (0,)
    references: Range | None = Range(0, 9)
    modes: tuple[int, ...] = (0, 2, 3, 8)
    clears: bool = False
    calibrates: bool = False
    counted_reads: bool = False
    debug: str = "GetDebugInfo"
    looks_at_channel: bool = False
    looks_at_enable: bool = True
    fifo_records: int = 1 << 20
    warns_sync_hz: float = 75e6
    warns_inputs_hz: float = 80e6
    warns_divider: bool = True
    flags: FlagBits = FlagBits()
    sync_period_unit_s: float = 1.0

    @property
    def longest(self) -> int:
        """Bins of the longest histogram."""
        return 1024 << self.longest_code

    def error_string(self, code: int) -> str:
        """Return the text of GetErrorString; codes that do not exist have one too."""
        if code not in self.errors and self.unknown_error:
            return self.unknown_error
        return f"{self.prefix}_ERROR_{self.errors.get(code, 'UNKNOWN')}"


HYDRAHARP = SimulatedFamily(
    prefix="HH",
    version="3.0",
    model="HydraHarp 400",
    errors={**_ALL, **_USB, -42: "MODACK_TIMEOUT"},
    says_which_argument=False,
    binnings=26,
    shortest_code=0,
    offset_ns=500_000,
    hold_off_ns=524_296,
    cfd_mv=Range(0, 1000),
    zero_cross_mv=Range(0, 40),
    triggers=(1,),
    references=Range(0, 1),
    clears=True,
    calibrates=True,
    counted_reads=True,
    debug="GetHardwareDebugInfo",
    looks_at_channel=True,
    looks_at_enable=False,
    fifo_records=131_072,
    warns_sync_hz=12.5e6,
    warns_inputs_hz=9e6,
    warns_divider=False,
)

MULTIHARP = SimulatedFamily(
    prefix="MH",
    version="4.0",
    model="MultiHarp 150 8P",
    errors={**_LATEST, -90: "SFP_BUSY"},
    base_ps=5.0,
    edge_mv=Range(-1200, 1200),
)

PICOHARP_330 = SimulatedFamily(
    prefix="PH330",
    version="2.0",
    model="PicoHarp 330",
    errors=_LATEST,
    longest_code=9,
    largest_divider=8,
    cfd_mv=Range(-1500, 0),
    zero_cross_mv=Range(-100, 0),
    edge_mv=Range(-1500, 1500),
    triggers=(0, 1),
    references=Range(0, 3),
    modes=(0, 2, 3),
    looks_at_channel=True,
)

TIMEHARP_260_P = SimulatedFamily(
    prefix="TH260",
    version="3.2",
    model="TimeHarp 260 P",
    errors={**_ALL, **_NEWER},
    unknown_error="Unknown Error",
    says_which_argument=False,
    devices=4,
    base_ps=25.0,
    binnings=22,
    longest_code=5,
    shortest_code=0,
    largest_divider=8,
    cfd_mv=Range(-1200, 0),
    zero_cross_mv=Range(-40, 0),
    edge_mv=Range(-1200, 1200),  # the function is there for the other board
    triggers=(1,),
    references=None,
    clears=True,
    counted_reads=True,
    debug="GetHardwareDebugInfo",
    looks_at_channel=True,
    looks_at_enable=False,
    fifo_records=131_072,
    warns_sync_hz=40e6,
    warns_inputs_hz=40e6,
    flags=FlagBits(reference_lost=0, active=0),
)

TIMEHARP_260_N = replace(TIMEHARP_260_P, model="TimeHarp 260 N", base_ps=250.0, triggers=(0,))

HYDRAHARP_500 = replace(
    PICOHARP_330,
    prefix="HH500",
    version="1.0",
    model="HydraHarp 500",
    errors={**_LATEST, -61: "INVALID_DATA", -90: "SFP_BUSY", -209: "INVALID_ARGUMENT_9"},
    longest_code=7,
    largest_divider=16,
    control=9,
    cfd_mv=Range(-1200, 0),
    edge_mv=Range(-1200, 1200),
    references=Range(0, 9),
    modes=(0, 2, 3, 8),
    looks_at_channel=False,
)

#: By the names that the rig's configuration has for them, but that the two boards are two.
FAMILIES = {
    "hydraharp": HYDRAHARP,
    "multiharp": MULTIHARP,
    "picoharp330": PICOHARP_330,
    "timeharp260p": TIMEHARP_260_P,
    "timeharp260n": TIMEHARP_260_N,
    "hydraharp500": HYDRAHARP_500,
}
