"""The calls for each family, in order, against a scripted library.

Order and arguments: the vendor's demos (MultiHarp, TimeHarp 260), and a beam monitor's program (PicoHarp
330); of the HydraHarp 500 nobody's are public, it is taken to be driven as the PicoHarp 330. The HydraHarp
400 has its own tests, `test_harp_transcript` and `test_harp_stream_transcript`.
"""

import pytest

from drivers.errors import DeviceNotFoundError, LimitError
from drivers.harp.device import Harp
from drivers.harp.families import (
    FAMILIES,
    HYDRAHARP_400,
    HYDRAHARP_500,
    MULTIHARP,
    PICOHARP_330,
    TIMEHARP_260_N,
    TIMEHARP_260_P,
)
from drivers.harp.library import HarpLibrary
from drivers.harp.settings import HarpSettings, Markers
from drivers.harp.stream import HarpStream
from drivers.harp.triggers import CfdTrigger, EdgeTrigger
from support.harp_wire import Returns, ScriptedLibrary

HISTOGRAM, T3 = 0, 3


def opening(prefix, version, *, devices, initialize, model, base):
    """Find the only instrument, at index 1, and ask what it is; it has two inputs."""
    return [
        (f"{prefix}_GetLibraryVersion()", version),
        (f"{prefix}_OpenDevice(0)", Returns(-1)),
        (f"{prefix}_OpenDevice(1)", "1045678"),
        *((f"{prefix}_OpenDevice({other})", Returns(-1)) for other in range(2, devices)),
        (f"{prefix}_{initialize}",),
        (f"{prefix}_GetHardwareInfo(1)", model, "930040", "1.0"),
        (f"{prefix}_GetNumOfInputChannels(1)", 2),
        (f"{prefix}_GetBaseResolution(1)", *base),
    ]


def inputs(prefix, sync, first):
    """Set sync and inputs, the second of which is not used."""
    return [
        (f"{prefix}_SetSyncDiv(1, 1)",),
        *((f"{prefix}_{call}",) for call in sync),
        (f"{prefix}_SetSyncChannelOffset(1, 0)",),
        *((f"{prefix}_{call}",) for call in first),
        (f"{prefix}_SetInputChannelOffset(1, 0, 0)",),
        (f"{prefix}_SetInputChannelEnable(1, 0, 1)",),
        (f"{prefix}_SetInputChannelEnable(1, 1, 0)",),
    ]


def histogram(prefix, length, *, code, width):
    return [
        (f"{prefix}_SetHistoLen(1, {code})", length),
        (f"{prefix}_SetBinning(1, 0)",),
        (f"{prefix}_SetOffset(1, 28)",),
        (f"{prefix}_GetResolution(1)", width),
        (f"{prefix}_SetStopOverflow(1, 0, 4294967295)",),
        (f"{prefix}_SetMeasControl(1, 0, 1, 0)",),
        ("sleep(0.4)",),
    ]


def tagged(prefix, width):
    return [
        (f"{prefix}_GetFeatures(1)", 0x7F),
        (f"{prefix}_SetBinning(1, 0)",),
        (f"{prefix}_SetOffset(1, 28)",),
        (f"{prefix}_GetResolution(1)", width),
        (f"{prefix}_SetMarkerEdges(1, 1, 1, 1, 1)",),
        (f"{prefix}_SetMarkerEnable(1, 1, 1, 1, 1)",),
        (f"{prefix}_SetMarkerHoldoffTime(1, 20000)",),
        ("sleep(0.4)",),
    ]


#: Of each family: what opens it in a mode, its inputs, and its bins: code of the length and width.
EDGES = {"sync": ["SetSyncEdgeTrg(1, -50, 0)"], "first": ["SetInputEdgeTrg(1, 0, -50, 0)"]}
CFDS = {"sync": ["SetSyncCFD(1, -50, -10)"], "first": ["SetInputCFD(1, 0, -50, -10)"]}
BY_MODE = {
    "sync": ["SetSyncTrgMode(1, 0)", *EDGES["sync"]],
    "first": ["SetInputTrgMode(1, 0, 0)", *EDGES["first"]],
}
SCRIPTS = {
    "MultiHarp": (
        {"version": "3.1", "devices": 8, "model": "MultiHarp 150 8P", "base": (5.0, 24)},
        "Initialize(1, {}, 0)",
        EDGES,
        {"code": 2, "length": 4096, "width": 5.0},
    ),
    "PicoHarp 330": (
        {"version": "2.0", "devices": 8, "model": "PicoHarp 330", "base": (1.0, 24)},
        "Initialize(1, {}, 0)",
        BY_MODE,
        {"code": 2, "length": 4096, "width": 1.0},
    ),
    "TimeHarp 260 P": (
        {"version": "3.2", "devices": 4, "model": "TimeHarp 260 P", "base": (25.0, 22)},
        "Initialize(1, {})",
        CFDS,
        {"code": 0, "length": 1024, "width": 25.0},
    ),
    "TimeHarp 260 N": (
        {"version": "3.2", "devices": 4, "model": "TimeHarp 260 N", "base": (250.0, 22)},
        "Initialize(1, {})",
        EDGES,
        {"code": 0, "length": 1024, "width": 250.0},
    ),
    "HydraHarp 500": (
        {"version": "1.0", "devices": 8, "model": "HydraHarp 500", "base": (1.0, 24)},
        "Initialize(1, {}, 0)",
        BY_MODE,
        {"code": 2, "length": 4096, "width": 1.0},
    ),
}
NAMED = {family.name: family for family in FAMILIES}


def opened(name, mode):
    """The calls until the instrument is ready."""
    info, initialize, triggers, bins = SCRIPTS[name]
    prefix = NAMED[name].prefix
    info = dict(info, initialize=initialize.format(mode))
    begin = [*opening(prefix, info.pop("version"), **info), *inputs(prefix, **triggers)]
    if mode == HISTOGRAM:
        return [*begin, *histogram(prefix, bins["length"], code=bins["code"], width=bins["width"])]
    return [*begin, *tagged(prefix, bins["width"])]


def settings(name, **changes):
    """Settings of three bins of the base resolution."""
    width_s = NAMED[name].limits.base_ps * 1e-12
    asked = {"bins": 3, "offset_s": 28e-9, "bin_width_s": width_s, **changes}
    return HarpSettings(family=NAMED[name], **asked)


def play(name, lines, work=lambda harp: None, **changes):
    script = ScriptedLibrary(lines)
    library = HarpLibrary(script.functions, NAMED[name], name="script")
    try:
        with Harp(library, clock=script, settings=settings(name, **changes)) as harp:
            return work(harp)
    finally:
        script.finish()


def closing(prefix):
    return [(f"{prefix}_StopMeas(1)",), (f"{prefix}_CloseDevice(1)",)]


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_histogram(name):
    prefix, clears = NAMED[name].prefix, NAMED[name].clears_with_histogram
    measured = [
        (f"{prefix}_ClearHistMem(1)",),
        (f"{prefix}_StartMeas(1, 10)",),
        (f"{prefix}_CTCStatus(1)", 0),
        ("sleep(0.01)",),
        (f"{prefix}_CTCStatus(1)", 1),
        (f"{prefix}_StopMeas(1)",),
        (f"{prefix}_GetFlags(1)", 0),
        (f"{prefix}_GetHistogram(1, 0{', 0' if clears else ''})", [5, 0, 7, 9]),
        (f"{prefix}_ClearHistMem(1)",),
    ]
    exposure, identity = play(
        name,
        [*opened(name, HISTOGRAM), *measured, *closing(prefix)],
        lambda harp: (harp.measure(10e-3), harp.identity),
    )
    assert exposure.counts.tolist() == [[5, 0, 7]]
    assert exposure.warnings == ()
    info = SCRIPTS[name][0]
    assert identity == (
        f"PicoQuant {info['model']}, part 930040, version 1.0, serial 1045678, "
        f"{NAMED[name].library} {info['version']}"
    )


@pytest.mark.parametrize("name", SCRIPTS)
def test_records(name):
    prefix = NAMED[name].prefix
    read = f"{prefix}_ReadFiFo(1{', 131072' if NAMED[name].fifo_step else ''})"
    active = NAMED[name].flags.active
    ended = [(read, [], 0), (f"{prefix}_GetFlags(1)", 0), (f"{prefix}_CTCStatus(1)", 1), ("sleep(0.001)",)]
    lines = [
        *opened(name, T3),
        (f"{prefix}_StartMeas(1, 10)",),
        (read, [1, 2], 2),
        (f"{prefix}_GetFlags(1)", active),
        (f"{prefix}_CTCStatus(1)", 0),
        ("sleep(0.01)",),
        *ended * 6,
        (f"{prefix}_StopMeas(1)",),
        *closing(prefix),
    ]
    script = ScriptedLibrary(lines)
    library = HarpLibrary(script.functions, NAMED[name], name="script")
    with HarpStream(
        library, clock=script, settings=settings(name), markers=Markers(hold_off_s=20e-6)
    ) as stream:
        stream.start(0.01)
        pieces = list(stream.pieces())
    script.finish()
    assert [piece.records.tolist() for piece in pieces] == [[1, 2]]
    assert [piece.flags for piece in pieces] == [0]


def test_a_picoharp_is_told_which_trigger_to_use():
    cfd = {
        "sync": ["SetSyncTrgMode(1, 1)", "SetSyncCFD(1, -300, -20)"],
        "first": ["SetInputTrgMode(1, 0, 0)", "SetInputEdgeTrg(1, 0, 250, 1)"],
    }
    changed = {old: (f"PH330_{new}",) for end in cfd for old, new in zip(BY_MODE[end], cfd[end], strict=True)}
    lines = [changed.get(line[0].removeprefix("PH330_"), line) for line in opened("PicoHarp 330", HISTOGRAM)]
    told = play(
        "PicoHarp 330",
        [*lines, *closing("PH330")],
        lambda harp: harp.settings(),
        sync_trigger=CfdTrigger(-0.3, -0.02),
        input_trigger=EdgeTrigger(0.25, rising=True),
    )
    assert (told["sync_level_v"], told["sync_zero_cross_v"]) == (-0.3, -0.02)
    assert (told["input_level_v"], told["input_edge"]) == (0.25, "rising")


def test_the_other_board_is_refused():
    """What a configuration says of bins and triggers is that of one board, and means nothing to the other."""
    lines = opened("TimeHarp 260 P", HISTOGRAM)[:7]
    lines[-1] = (lines[-1][0], "TimeHarp 260 N", "930040", "1.0")
    with pytest.raises(DeviceNotFoundError, match="measure as a TimeHarp 260 P, but it is a TimeHarp 260 N"):
        play("TimeHarp 260 P", [*lines, *closing("TH260")])


def test_a_multiharp_of_80_ps_refuses_finer_bins():
    lines = opened("MultiHarp", HISTOGRAM)
    at = next(n for n, line in enumerate(lines) if "GetBaseResolution" in line[0])
    lines = [*lines[:at], ("MH_GetBaseResolution(1)", 80.0, 20)]
    with pytest.raises(LimitError, match=r"80 ps times a power of two.*nearest are 80 ps and 160 ps"):
        play("MultiHarp", [*lines, *closing("MH")])


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        ([(MULTIHARP, 0x40), (PICOHARP_330, 0x40), (TIMEHARP_260_P, 0x08)], "More pulses came than it can"),
        ([(MULTIHARP, 0x08), (PICOHARP_330, 0x08), (HYDRAHARP_400, 0x08)], "reference clock was lost"),
        ([(HYDRAHARP_400, 0x40), (MULTIHARP, 0x80), (TIMEHARP_260_P, 0x40)], "do not explain"),
    ],
)
def test_the_same_bit_means_another_thing(flags, words):
    for family, raised in flags:
        ((_, sentence),) = family.flags.told(raised)
        assert words in sentence, family.name


def test_a_software_error_spoils_the_counts():
    assert TIMEHARP_260_N.flags.errors == 0x30
    assert PICOHARP_330.flags.errors == HYDRAHARP_500.flags.errors == 0x90
    assert TIMEHARP_260_N.flags.told(0x20) == []  # not an unknown one


@pytest.mark.parametrize("name", SCRIPTS)
def test_several_instruments_and_none_named(name):
    info, *_ = SCRIPTS[name]
    prefix = NAMED[name].prefix
    lines = [
        (f"{prefix}_GetLibraryVersion()", info["version"]),
        (f"{prefix}_OpenDevice(0)", "1045678"),
        (f"{prefix}_OpenDevice(1)", "1045679"),
        (f"{prefix}_CloseDevice(1)",),
        *((f"{prefix}_OpenDevice({other})", Returns(-1)) for other in range(2, info["devices"])),
        (f"{prefix}_CloseDevice(0)",),
    ]
    with pytest.raises(
        DeviceNotFoundError, match=r"several were found: 1045678, 1045679\. Give the serial number"
    ):
        play(name, lines)


@pytest.mark.parametrize(
    ("family", "changes", "words"),
    [
        (MULTIHARP, {"bin_width_s": 4e-12}, "5 ps times a power of two.*nearest are 5 ps and 10 ps"),
        (MULTIHARP, {"sync_trigger": CfdTrigger(0.05, 0.01)}, "its inputs have edge triggers"),
        (MULTIHARP, {"sync_trigger": EdgeTrigger(1.3)}, "sync trigger level to 1300 mV.*-1200 to 1200"),
        (MULTIHARP, {"bins": 65537}, "from 1 to 65536"),
        (PICOHARP_330, {"sync_divider": 16}, "it divides by 1, 2, 4 or 8"),
        (PICOHARP_330, {"input_trigger": CfdTrigger(0.05, -0.01)}, "input CFD level to 50 mV.*-1500 to 0"),
        (PICOHARP_330, {"bins": 524_289}, "from 1 to 524288"),
        (TIMEHARP_260_P, {"bin_width_s": 250e-12}, "nearest are 200 ps and 400 ps"),
        (TIMEHARP_260_P, {"bins": 40_000}, "from 1 to 32768"),
        (TIMEHARP_260_P, {"input_trigger": EdgeTrigger(-0.05)}, "have constant-fraction discriminators"),
        (TIMEHARP_260_N, {"bin_width_s": 25e-12}, "nearest are 250 ps and 500 ps"),
        (TIMEHARP_260_N, {"external_reference": True}, "no function for this"),
        (HYDRAHARP_500, {"bins": 131_073}, "from 1 to 131072"),
    ],
)
def test_what_a_family_cannot_do_is_refused_without_an_instrument(family, changes, words):
    with pytest.raises(LimitError, match=f"{family.name}.*{words}"):
        HarpSettings(family=family, **changes)


@pytest.mark.parametrize(
    ("family", "sync_hz", "divider", "words"),
    [
        (HYDRAHARP_400, 80e6, 1, "12.5 MHz after the divider.*divider to 8"),
        (MULTIHARP, 77e6, 1, None),
        (MULTIHARP, 80e6, 1, "78 MHz after the divider.*divider to 2"),
        (MULTIHARP, 1.3e9, 16, "1200 MHz before it.*slower laser rate"),
        (PICOHARP_330, 80e6, 1, None),
        (PICOHARP_330, 160e6, 1, "81 MHz after the divider.*divider to 2"),
        (TIMEHARP_260_P, 80e6, 1, "40 MHz after the divider.*divider to 2"),
        (TIMEHARP_260_N, 40e6, 1, None),
        (HYDRAHARP_500, 1e9, 1, None),
    ],
)
def test_sync_rates(family, sync_hz, divider, words):
    if words is None:
        family.limits.check_sync_rate(sync_hz, divider)
        return
    with pytest.raises(LimitError, match=words):
        family.limits.check_sync_rate(sync_hz, divider)


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)
def test_the_usual_settings_of_a_family_are_possible(family):
    HarpSettings(family=family, bins=round(60e-9 / family.bin_width_s))
    assert family.limits.device == family.name


def test_settings_of_another_family_are_a_mistake():
    library = HarpLibrary(ScriptedLibrary([]).functions, MULTIHARP)
    with pytest.raises(ValueError, match="settings of a HydraHarp for a MultiHarp"):
        Harp(library, clock=ScriptedLibrary([]), settings=HarpSettings(family=HYDRAHARP_400))
