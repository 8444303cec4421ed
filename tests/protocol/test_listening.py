"""A listener hears what passes at the wire of lines that are opened while it listens, and of no others."""

from types import SimpleNamespace

import pytest

from drivers.harp.families import HYDRAHARP_400
from drivers.harp.library import HarpLibrary, prototypes
from drivers.lines.listening import listening
from simulators.bench import Bench
from simulators.wire.harp import HarpSimulator
from support.simulated_rig import simulated_rig
from support.wire_script import read_transcript


class Heard:
    def __init__(self):
        self.lines, self.transfers, self.calls = [], [], []

    def serial(self, sent, data):
        self.lines.append((sent, data))

    def usb(self, sent, data, request=()):
        self.transfers.append((sent, data, request))

    def call(self, name, arguments, answer):
        self.calls.append((name, [getattr(one, "_obj", one) for one in arguments], answer))

    def said(self, sent):
        return b"".join(data for way, data in self.lines if way == sent)


@pytest.fixture
def rig():
    with simulated_rig() as rig:
        yield rig


def test_bytes_of_a_serial_line_are_those_of_the_transcript(rig):
    heard = Heard()
    steps = read_transcript("galvo_session.txt")[:8]
    with listening(heard), rig.galvo():
        pass
    assert heard.said(True).startswith(b"".join(step.data for step in steps if step.kind == ">"))
    assert heard.said(False).startswith(b"".join(step.data for step in steps if step.kind == "<"))


def test_a_line_that_is_opened_while_nobody_listens_is_not_heard(rig):
    heard = Heard()
    with listening(heard):
        pass
    with rig.galvo() as mirror, listening(heard):
        mirror.point(0.1, 0.0)
    assert heard.lines == []


def test_transfers_of_usb(rig):
    heard = Heard()
    with listening(heard), rig.spad():
        pass
    questions = [data[12:] for sent, data, _ in heard.transfers if sent and data[0] == 1]
    assert questions[0].startswith(b"*IDN?\n")
    answers = [data[12:] for sent, data, request in heard.transfers if not sent and not request]
    assert answers[0].startswith(b"ID Quantique")
    controls = [request for _, _, request in heard.transfers if request]
    assert (0xA1, 7, 0, 0, 24) in controls


def test_calls_of_a_library_with_what_they_wrote():
    heard = Heard()
    with listening(heard):
        library = HarpLibrary(HarpSimulator(Bench()).functions, HYDRAHARP_400)
    library.open_device(0)
    with pytest.raises(Exception, match="NOT_INITIALIZED"):
        library.get_features(0)
    opened, asked = heard.calls
    assert opened[0] == "HH_OpenDevice"
    assert opened[1][0] == 0
    assert opened[1][1].value == b"1000001"
    assert (asked[0], asked[2]) == ("HH_GetFeatures", -22)


class Function:
    """What ctypes gives for a function of a loaded library: types are set on it, and it is called."""

    argtypes, restype = None, None

    def __call__(self, *arguments):
        return 0


def test_types_are_set_on_the_library_s_own_function():
    expected = {f"HH_{name}": types for name, types in prototypes(HYDRAHARP_400).items()}
    functions = SimpleNamespace(**{name: Function() for name in expected})
    with listening(Heard()):
        HarpLibrary(functions, HYDRAHARP_400)
    assert {name: one.argtypes for name, one in vars(functions).items()} == expected
