"""Rules that hold for every device on a serial or USB wire."""

import inspect
import json

import pytest

from drivers.errors import DeviceError, DeviceNotFoundError, LinkError
from rig.model import devices

DEVICES = {
    "galvo": devices.Galvo,
    "laser": devices.Laser,
    "laser_08hp": devices.Laser,
    "laser_nkt": devices.Laser,
    "spad": devices.GatedSpad,
    "mpd": devices.GatedSpad,
    "dg645": devices.GateDelayer,
    "t560": devices.GateDelayer,
}


@pytest.fixture(params=DEVICES)
def name(request):
    return request.param


def test_it_is_what_the_application_asks_for(rig, name):
    """Every method of the protocol is there, and takes the same parameters."""
    with getattr(rig, name)() as device:
        for member, asked in inspect.getmembers(DEVICES[name], inspect.isfunction):
            if not member.startswith("_"):
                offered = inspect.signature(getattr(device, member))
                assert list(offered.parameters) == list(inspect.signature(asked).parameters)[1:], member


def test_it_identifies_itself_once_connected(rig, name):
    with getattr(rig, name)() as device:
        assert isinstance(device.identity, str)
        assert device.identity.isprintable()
        assert len(device.identity) > 4


def test_its_settings_are_flat_and_go_into_a_file(rig, name):
    with getattr(rig, name)() as device:
        settings = device.settings()
    assert settings["identity"] == device.identity
    assert all(type(value) in (str, int, float, bool) for value in settings.values())
    assert json.loads(json.dumps(settings)) == settings


def test_it_connects_again_after_it_was_left(rig, name):
    device = getattr(rig, name)()
    for _ in range(2):
        with device:
            device.settings()


def test_outside_its_with_block_it_says_so(rig, name):
    device = getattr(rig, name)()
    with pytest.raises(LinkError, match="with block"):
        device.settings()
    with device:
        pass
    with pytest.raises(LinkError, match="with block"):
        device.settings()


def test_an_exception_goes_through_unchanged(rig, name):
    class TheirError(Exception):
        """Raised by whoever uses the device."""

    problem = TheirError()
    with pytest.raises(TheirError) as raised, getattr(rig, name)():
        raise problem
    assert raised.value is problem
    assert not hasattr(problem, "__notes__")


def test_an_absent_device_is_named_with_all_that_helps(rig, name):
    rig.unplug_all()
    with pytest.raises(DeviceNotFoundError) as raised:
        getattr(rig, name)().__enter__()
    error = raised.value
    for part in (error.device, error.asked, error.answered, error.remedy):
        assert len(part) >= 4
        assert part in str(error)


def test_unplugged_is_an_error_of_ours(rig, name):
    def work():
        with getattr(rig, name)() as device:
            rig.unplug_all()
            device.settings()

    with pytest.raises(LinkError):
        work()


@pytest.mark.parametrize(("name", "address"), [("galvo", "laser"), ("laser", "galvo")])
def test_another_device_at_the_address_is_not_mistaken(rig, name, address):
    rig.galvo_address, rig.laser_address = rig.laser_address, rig.galvo_address
    with pytest.raises(DeviceNotFoundError, match="another device"):
        getattr(rig, name)().__enter__()
    assert rig.bench.target_rad == (0.0, 0.0)
    assert not rig.bench.ever_emitted()


@pytest.mark.parametrize("how_many", range(1, 12))
@pytest.mark.parametrize("part", ["board", "head", "instrument"])
def test_an_answer_lost_at_any_moment_of_connecting_breaks_nothing(rig, part, how_many):
    """Either the device connects, or an error of ours says why; in both cases the next attempt works."""
    name = {"board": "galvo", "head": "laser", "instrument": "spad"}[part]
    getattr(rig, part).drop_answers = how_many
    try:
        with getattr(rig, name)():
            pass
    except DeviceError:
        pass
    getattr(rig, part).drop_answers = 0
    with getattr(rig, name)() as device:
        device.settings()
    assert not rig.bench.light.emitting
    assert not rig.bench.light.biased
