"""What each kind of device is asked: one entry for each kind of the tables in `rig.devices.kinds`.

An entry holds questions only: identity, state, settings that are read back. What moves, emits, biases, sets
or resets something has no place here, nor has a question of which no source tells.
"""

from drivers.delayers import dg645, psd, t560
from drivers.id120 import ID120
from drivers.katana.line import BAUD as KATANA_BAUD
from drivers.mpd.detector import BAUD as MPD_BAUD
from drivers.nkt import registers as nkt
from drivers.optotune.registers import BAUD as OPTOTUNE_BAUD
from rig.devices.probing.asking import (
    Asking,
    Instrument,
    Registers,
    TextLine,
    ask_board,
    ask_harps,
)

#: By section and kind. A kind without an entry is told as one that cannot be asked: devices without a data
#: interface, a file that is played, and a shutter on a serial port, whose lines move when it is opened.
QUESTIONS: dict[tuple[str, str], Asking] = {
    # START is the handshake: it changes nothing. ACKNOWLEDGE, which clears what is latched, is left out.
    ("galvo", "optotune"): TextLine(
        lambda wires: wires.galvo,
        OPTOTUNE_BAUD,
        b"\r\n",
        ("START", "GETID", "GETVERSION", "GETSN", "GETDEVICESN", "GETTEMP", "STATUS"),
        private=("GETSN", "GETDEVICESN"),
    ),
    ("galvo", "analogue"): ask_board,
    ("laser", "katana"): TextLine(
        lambda wires: wires.laser,
        KATANA_BAUD,
        b"\n",
        ("leg?", "h", "lp?", "lps?", "ltg?", "ltg_freq?", "ltlg?", "let?"),
    ),
    ("laser", "katana-08hp"): TextLine(
        lambda wires: wires.laser,
        KATANA_BAUD,
        b"\n",
        ("lip?", "h", "le?", "lp?", "lpa?", "lps?", "lts?", "lx_freq?", "ltll?"),
    ),
    ("laser", "nkt"): Registers(
        {
            nkt.TYPE: "type",
            nkt.SERIAL: "serial number",
            nkt.EMISSION: "emission",
            nkt.SETUP: "mode",
            nkt.INTERLOCK: "interlock",
            nkt.PULSE_PICKER: "pulse picker",
            nkt.WATCHDOG: "watchdog",
            nkt.STATUS: "status",
            0x37: "power level",
            0x38: "current level",
        },
        private=("serial number",),
    ),
    ("detector", "id120"): Instrument(
        ID120,
        (
            "*IDN?",
            "INFO:PRODUCT_NAME?",
            "INFO:PRODUCT_TYPE?",
            "INFO:PRODUCT_SERIAL_NUMBER?",
            "INFO:APD_TYPE?",
            "INFO:FIRMWARE_VERSION?",
            "INFO:OUTPUT1_STANDARD?",
            "INFO:BIAS_BREAKDOWN_VOLTAGE?",
            "THRESHOLD:CAPABILITY?",
            "THRESHOLD:VOLTAGE?",
            "DEADTIME:CAPABILITY?",
            "DEADTIME:TIME?",
            "BIAS:CAPABILITY?",
            "BIAS:VOLTAGE?",
            "BIAS:ERROR_STATUS?",
            "REG:RUN?",
            "REG:STATE?",
            "REG:TEMP_SET_POINT?",
            "REG:MEASURED_TEMP?",
        ),
        private=("INFO:PRODUCT_SERIAL_NUMBER?",),
    ),
    ("detector", "mpd"): TextLine(lambda wires: wires.detector, MPD_BAUD, b"#", ("AQ;DC",)),
    # With its echo on, as it leaves the factory, the question comes before the answer; it stays as it is.
    ("delayer", "psd"): TextLine(
        lambda wires: wires.delayer, psd.BAUD, b"#", ("RD", "RP", "RH", "RE", "RO", "RT", "RMD")
    ),
    # LERR?, which takes an error out of its memory, is left out.
    ("delayer", "dg645"): TextLine(
        lambda wires: wires.delayer,
        dg645.BAUD,
        b"\n",
        (
            "*IDN?",
            "TSRC?",
            "TLVL?",
            "INHB?",
            "BURM?",
            "ADVT?",
            "LAMP?1",
            "LOFF?1",
            "LPOL?1",
            "DLAY?2",
            "DLAY?3",
        ),
    ),
    ("delayer", "t560"): TextLine(
        lambda wires: wires.delayer,
        t560.BAUD,
        b"\r",
        ("ID", "ASET", "BSET", "CSET", "DSET", "TRIGGER", "TLEVEL", "TDIV"),
    ),
    ("tcspc", "hydraharp"): ask_harps,
    ("tcspc", "multiharp"): ask_harps,
    ("tcspc", "picoharp330"): ask_harps,
    ("tcspc", "timeharp260"): ask_harps,
    ("tcspc", "hydraharp500"): ask_harps,
    ("point_clock", "daq"): ask_board,
    ("shutter", "daq"): ask_board,
}
