"""The families of instruments that this driver serves.

Sources, and who else says so (docs/timing-instruments.md has the table):

- HydraHarp 400: the vendor's hhdefin.h, hhlib.h and errorcodes.h 3.0, its demos, its manual.
- MultiHarp 150 and 160: mhdefin.h, mhlib.h and errorcodes.h 3.1, demos, manual 3.0 of MHLib.
- TimeHarp 260: th260defin.h, th260lib.h and errorcodes.h 3.2, demos, manual 3.2 of TH260Lib.
- PicoHarp 330: ph330lib.h and errorcodes.h 2.0, as a beam monitor has them; its constants, as a microscope's
  driver has them.
- HydraHarp 500: no header is public. The names are those of the library (HH500Lib 1.0), the limits those at
  which it refuses arguments; all else is taken from the PicoHarp 330 and UNCONFIRMED.

Later libraries than the headers (MHLib 4.0) were asked for names, error texts and the limits of arguments,
without an instrument. UNCONFIRMED stands where one source or none says a thing.
"""

from dataclasses import replace

from drivers.harp.family import Family, Flags, LibraryFiles, Link
from drivers.harp.limits import HarpLimits, Steps
from drivers.harp.triggers import CfdTrigger, EdgeTrigger

_COMMON_ERRORS = {
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
    **{-63 - n: f"EEPROM_F{n:02}" for n in range(1, 12)},
}
_NEWER_ERRORS = {
    -12: "DEVICE_DRIVERVER_MISMATCH",
    -29: "THREADSTATE_FAIL",
    -30: "THREADLOCK_FAIL",
    -42: "MB_ACK_TIMEOUT",
    -80: "UNSUPPORTED_FUNCTION",
}
_USB_ERRORS = {
    -38: "USB_RESET_FAIL",
    -57: "RATE_FAIL",
    -58: "MODFWVER_TOO_LOW",
    -59: "MODFWVER_TOO_HIGH",
}
_LATEST_ERRORS = {
    -60: "MB_ACK_FAIL",
    **{-63 - n: f"EEPROM_F{n:02}" for n in range(12, 16)},
    -81: "WRONG_TRGMODE",
    -82: "BULKRDINIT_FAIL",
    -83: "CREATETHREAD_FAIL",
    -84: "FILEOPEN_FAIL",
    -85: "FILEWRITE_FAIL",
    -86: "FILEREAD_FAIL",
    **{-200 - n: f"INVALID_ARGUMENT_{n}" for n in range(1, 9)},
}
_LATEST = _COMMON_ERRORS | _NEWER_ERRORS | _USB_ERRORS | _LATEST_ERRORS

#: Raised by the offset where the longest histogram spans the sync period without it.
OFFSET_UNNECESSARY = 0x0800


def _warnings(trigger: str, sync_too_high: str) -> dict[int, str]:
    """Return what the bits of the warnings mean that all families share."""
    return {
        0x0001: f"No sync pulses arrive: check that the laser emits, its cable, and the sync {trigger}.",
        0x0002: "The sync rate is too low for a meaningful measurement.",
        0x0004: sync_too_high,
        0x0010: f"No photons arrive: check the detector, its cable, and the input {trigger}.",
        0x0040: "The input rates together are too high for the link to the computer: attenuate.",
        0x0100: "The input rate is above 5 % of the sync rate, so pile-up distorts: attenuate.",
        0x0200: "The sync divider is above one, which loses sync events in T2 mode.",
        0x0400: "The longest histogram is shorter than the sync period: use wider bins.",
        OFFSET_UNNECESSARY: "The offset is not needed: the histogram spans the sync period without it.",
    }


_DIVIDE = "The divided sync rate is too high: use a larger sync divider."


def _newer_warnings(trigger: str) -> dict[int, str]:
    return _warnings(trigger, "The divided sync rate is near the highest that can be timed.") | {
        0x0200: "The sync divider is larger than the sync rate needs, which adds jitter.",
        0x1000: _DIVIDE,
        0x2000: "More pulses come than the instrument can process, so photons are missing: attenuate.",
    }


def _usb(name: str) -> Link:
    return Link(
        check="Check the USB cable and port",
        restart=f"switch the {name} off and on",
        absent=f"Switch the {name} on and connect it; "
        "on Linux a missing udev permission for USB vendor 0e0d looks the same.",
    )


HYDRAHARP_400 = Family(
    name="HydraHarp",
    prefix="HH",
    library="HHLib",
    versions=("3.0",),
    files=LibraryFiles(
        "HHLIB_PATH", "libhhlib.so", ("/usr/local/lib64/hh400/hhlib.so", "libhh400.so"), "hhlib64.dll"
    ),
    link=_usb("HydraHarp"),
    limits=HarpLimits(
        device="HydraHarp",
        base_ps=1.0,
        binnings=26,
        max_bins=65536,
        # the header's comment on the lower limit says ps; the function takes nanoseconds
        offset=Steps(0, 500_000, "ns", 1e-9),
        # the instrument counts it in steps of about 8 ns (header); how it rounds is UNCONFIRMED
        marker_hold_off=Steps(0, 524_296, "ns", 1e-9),
        sync_dividers=(1, 2, 4, 8, 16),
        most_sync_hz=150e6,
        most_divided_hz=12.5e6,
        # both positive, though the signals are negative
        cfd_level=Steps(0, 1000, "mV", 1e-3),
        zero_cross=Steps(0, 40, "mV", 1e-3),
    ),
    trigger=CfdTrigger(0.05, 0.01),
    bin_width_s=4e-12,
    # DEVICE_LOCKED is in the library but missing from its header
    errors=_COMMON_ERRORS | _USB_ERRORS | {-42: "MODACK_TIMEOUT"},
    warnings=_warnings("CFD", _DIVIDE),
    flags=Flags(),
    hardware="HydraHarp 400",
    record_type=0x01010304,
    fifo_records=131_072,
    fifo_step=128,
    debug="GetHardwareDebugInfo",
    calibrates=True,
    clears_with_histogram=True,
)

MULTIHARP = Family(
    name="MultiHarp",
    prefix="MH",
    library="MHLib",
    # 3.0 and 3.1 by their headers and demos; that 4.0 takes the arguments of 3.1 is UNCONFIRMED, but where it
    # refuses them without an instrument, it refuses the same
    versions=("3.0", "3.1", "4.0"),
    files=LibraryFiles(
        "MHLIB_PATH", "libmhlib.so", ("/usr/local/lib64/mh150/mhlib.so", "libmh150.so"), "mhlib64.dll"
    ),
    link=_usb("MultiHarp"),
    limits=HarpLimits(
        device="MultiHarp",
        base_ps=5.0,  # some models have 10 ps, and the 4N 80 ps (manual)
        binnings=24,
        max_bins=65536,
        min_bins=4096,  # GetHistogram takes no length codes 0 and 1 (header)
        offset=Steps(0, 100_000_000, "ns", 1e-9),
        marker_hold_off=Steps(0, 25_500, "ns", 1e-9),
        sync_dividers=(1, 2, 4, 8, 16),
        most_sync_hz=1.2e9,
        most_divided_hz=78e6,
        edge_level=Steps(-1200, 1200, "mV", 1e-3),
    ),
    trigger=EdgeTrigger(-0.05),
    bin_width_s=5e-12,
    errors=_LATEST | {-90: "SFP_BUSY"},
    warnings=_newer_warnings("trigger level and edge"),
    flags=Flags(counts_dropped=0x40),
    hardware="MultiHarp 150",
    record_type=0x00010307,
)

PICOHARP_330 = Family(
    name="PicoHarp 330",
    prefix="PH330",
    library="PH330Lib",
    versions=("2.0",),
    files=LibraryFiles("PH330LIB_PATH", "libph330.so", ("libph330.so",), "PH330Lib.dll"),
    link=_usb("PicoHarp 330"),
    limits=HarpLimits(
        device="PicoHarp 330",
        base_ps=1.0,
        binnings=24,
        max_bins=524_288,
        min_bins=4096,  # as the MultiHarp; whether it takes shorter ones is UNCONFIRMED
        offset=Steps(0, 100_000_000, "ns", 1e-9),
        marker_hold_off=Steps(0, 25_500, "ns", 1e-9),
        sync_dividers=(1, 2, 4, 8),
        most_sync_hz=8 * 81e6,  # UNCONFIRMED: what the largest divider brings below the next
        most_divided_hz=81e6,
        cfd_level=Steps(-1500, 0, "mV", 1e-3),
        zero_cross=Steps(-100, 0, "mV", 1e-3),
        edge_level=Steps(-1500, 1500, "mV", 1e-3),
    ),
    trigger=EdgeTrigger(-0.05),
    bin_width_s=4e-12,
    errors=_LATEST,
    warnings=_newer_warnings("trigger")
    | {0x4000: "It is connected by USB 2.0, which has a tenth of the data rate of USB 3."},
    flags=Flags(counts_dropped=0x40, software_error=0x80),
    hardware="PicoHarp 330",
    record_type=0x00010307,
)

TIMEHARP_260_P = Family(
    name="TimeHarp 260 P",
    prefix="TH260",
    library="TH260Lib",
    versions=("3.2",),  # before, the N had its edges the other way round (manual)
    files=LibraryFiles(
        "TH260LIB_PATH",
        "libth260lib.so",
        ("/usr/local/lib64/th260/th260lib.so", "libth260.so"),
        "th260lib64.dll",
    ),
    link=Link(
        check="Check that the board sits firmly in its slot",
        restart="restart the computer, which resets the board",
        absent="Check that the board sits firmly in its slot and that its driver is installed "
        "(on Linux the kernel module th260pcie).",
    ),
    limits=HarpLimits(
        device="TimeHarp 260 P",
        base_ps=25.0,
        binnings=22,
        max_bins=32_768,
        offset=Steps(0, 100_000_000, "ns", 1e-9),
        marker_hold_off=Steps(0, 25_500, "ns", 1e-9),
        sync_dividers=(1, 2, 4, 8),
        most_sync_hz=100e6,  # UNCONFIRMED: one dealer
        most_divided_hz=40e6,
        cfd_level=Steps(-1200, 0, "mV", 1e-3),
        zero_cross=Steps(-40, 0, "mV", 1e-3),
    ),
    trigger=CfdTrigger(-0.05, -0.01),
    bin_width_s=25e-12,
    errors=_COMMON_ERRORS | _NEWER_ERRORS,
    warnings=_newer_warnings("CFD"),
    flags=Flags(reference_lost=0, active=0, counts_dropped=0x08, software_error=0x20),
    hardware="TimeHarp 260 PICO",
    record_type=0x00010306,
    model="TimeHarp 260 P",
    devices=4,
    fifo_records=131_072,
    fifo_step=128,
    debug="GetHardwareDebugInfo",
    takes_reference=False,
    clears_with_histogram=True,
)

TIMEHARP_260_N = replace(
    TIMEHARP_260_P,
    name="TimeHarp 260 N",
    limits=replace(
        TIMEHARP_260_P.limits,
        device="TimeHarp 260 N",
        base_ps=250.0,  # boards of before 2016 have 1 ns, which is four of these
        cfd_level=None,
        zero_cross=None,
        edge_level=Steps(-1200, 1200, "mV", 1e-3),
    ),
    trigger=EdgeTrigger(-0.05),
    bin_width_s=250e-12,
    warnings=_newer_warnings("trigger level and edge"),
    hardware="TimeHarp 260 NANO",
    record_type=0x00010305,
    model="TimeHarp 260 N",
)

HYDRAHARP_500 = replace(
    PICOHARP_330,
    name="HydraHarp 500",
    prefix="HH500",
    library="HH500Lib",
    versions=("1.0",),
    files=LibraryFiles("HH500LIB_PATH", "libhh500lib.so", ("libhh500.so",), "HH500Lib.dll"),
    link=_usb("HydraHarp 500"),
    limits=replace(
        PICOHARP_330.limits,
        device="HydraHarp 500",
        max_bins=131_072,
        sync_dividers=(1, 2, 4, 8, 16),
        most_sync_hz=float("inf"),  # nobody says; the instrument itself warns
        most_divided_hz=float("inf"),
        cfd_level=Steps(-1200, 0, "mV", 1e-3),
        edge_level=Steps(-1200, 1200, "mV", 1e-3),
    ),
    errors=_LATEST | {-61: "INVALID_DATA", -90: "SFP_BUSY", -209: "INVALID_ARGUMENT_9"},
    hardware="HydraHarp 500",
)

FAMILIES = (HYDRAHARP_400, MULTIHARP, PICOHARP_330, TIMEHARP_260_P, TIMEHARP_260_N, HYDRAHARP_500)
