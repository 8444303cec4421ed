"""The composition root: opens the devices that a configuration names, real or simulated at their wires."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from drivers.daq.board import SharedBoard
from drivers.harp.library import HarpLibrary
from drivers.video_camera import VideoCamera
from rig.acquire.abilities import tagging_of
from rig.acquire.engine import Devices
from rig.devices.delayed_gate import open_detector
from rig.devices.kinds import GALVOS, POINT_CLOCKS, TIMING, Wires
from rig.devices.shuttered import open_laser
from rig.devices.wires import wires_by_address
from rig.errors import UsageError
from rig.light.attended import BehindItsShutter, SwitchedByHand, TakesWord
from rig.light.guarded import GuardedHere
from rig.light.lock import locked
from rig.light.remote import GuardedElsewhere
from rig.model.config import ExternalLaserConfig, RigConfig
from rig.model.devices import GatedSpad, GuardedLaser, Operator, PointClock, Tcspc, TimeTagger, WallCamera

if TYPE_CHECKING:
    from simulators.bench import Bench


#: Roles whose device may be an object of the caller's.
OWN = ("galvo", "detector", "tcspc", "point_clock")
Own = Mapping[str, AbstractContextManager[Any]]


@dataclass(frozen=True)
class Station:
    """A whole rig for calibration: devices, the person at it, and the cameras that see the wall."""

    devices: Devices
    operator: Operator
    cameras: tuple[WallCamera, ...]


@contextmanager
def open_devices(
    config: RigConfig,
    first: int = 0,
    *,
    tagged: bool = False,
    begin_s: float = 0.0,
    operator: Operator | None = None,
    own: Own | None = None,
) -> Iterator[Devices]:
    """Open and identify all devices; leave all of them safe at the end, the laser first.

    Parameters
    ----------
    config
        Names them.
    first
        Step of the plan with which the scan begins.
    tagged
        Whether the timing instrument is to record each photon, and the point clock to mark positions among
        them, instead of histograms that the instrument makes.
    begin_s
        Time at which the clock of a simulated bench begins.
    operator
        Who sets by hand what has no data interface; None where nobody is there. A simulated rig has its own.
    own
        Devices in place of those that the configuration names, by role (`OWN`), to be entered.

    Raises
    ------
    drivers.errors.DeviceError
        If a device is missing, is another one, or fails.
    RefusedError
        If the timing instrument cannot record so.
    UsageError
        If there is no such role, or its device has to be one of the configuration.
    """
    with ExitStack() as stack:
        if config.simulated:
            wires, _ = stack.enter_context(_simulated(config, begin_s))
        else:
            stack.enter_context(locked(config))
            wires = stack.enter_context(wires_by_address(config, operator))
        yield stack.enter_context(devices_on(config, wires, first, tagged=tagged, own=own))


#: Reaches the wires of one device, named by its section of the configuration.
Reach = Callable[[str], AbstractContextManager[Wires]]


@contextmanager
def wires_of(config: RigConfig) -> Iterator[Reach]:
    """Have a rig alone, and give what reaches the wires of one device after the other; none is opened yet.

    Raises
    ------
    RefusedError
        If another program has the rig.
    """
    with ExitStack() as stack:
        if config.simulated:
            wires, _ = stack.enter_context(_simulated(config))
            yield lambda section: nullcontext(wires)
        else:
            stack.enter_context(locked(config))
            yield lambda section: wires_by_address(_without_others(config, section))


def _without_others(config: RigConfig, section: str) -> RigConfig:
    """Return a configuration in which one device alone has an address: no other one is reached."""
    named = {name: getattr(config, name) for name in type(config).model_fields if name != section}
    others = {name: one for name, one in named.items() if getattr(one, "address", None)}
    return config.model_copy(
        update={name: one.model_copy(update={"address": None}) for name, one in others.items()}
    )


@contextmanager
def devices_on(
    config: RigConfig,
    wires: Wires,
    first: int = 0,
    *,
    tagged: bool = False,
    own: Own | None = None,
) -> Iterator[Devices]:
    """Open and identify the devices at the ends of these wires; leave them safe at the end, the laser first.

    Parameters and errors are those of `open_devices`.
    """
    own = own or {}
    _check_own(own)
    with ExitStack() as stack:
        galvo = stack.enter_context(own.get("galvo") or GALVOS.of(config.galvo).open(config.galvo, wires))
        clock = stack.enter_context(own.get("point_clock") or _point_clock(config, wires, tagged))
        spad = stack.enter_context(own.get("detector") or open_detector(config, wires))
        tcspc = stack.enter_context(own.get("tcspc") or _timing(config, wires, first, tagged))
        guarded = _guarded(config, wires, stack, spad)  # the last, so that it is the first to be made safe
        yield Devices(
            galvo=galvo,
            point_clock=clock,
            spad=spad,
            tcspc=tcspc,
            laser=_attended(config, wires, stack, guarded, lambda: tcspc.rates().sync_hz),
            clock=wires.clock,
        )


def _check_own(own: Mapping[str, object]) -> None:
    """Refuse devices that cannot be given as objects."""
    for role in own:
        if role not in OWN:
            raise UsageError(
                f"the {role} cannot be given as an object, but {', '.join(OWN)} can. "
                "A laser is opened by its guard, in a separate process: provide its driver as a package, "
                "see docs/plug-ins.md"
            )


def _point_clock(config: RigConfig, wires: Wires, tagged: bool) -> AbstractContextManager[PointClock | None]:
    if config.point_clock is None or not tagged:
        return nullcontext()
    return POINT_CLOCKS.of(config.point_clock).open(config.point_clock, wires)


def _timing(
    config: RigConfig, wires: Wires, first: int, tagged: bool
) -> AbstractContextManager[Tcspc | TimeTagger]:
    if tagged:
        return tagging_of(config).open(config, wires)
    return TIMING.of(config.tcspc).open(config, wires, first)


@contextmanager
def open_station(config: RigConfig, operator: Operator, *, tagged: bool = False) -> Iterator[Station]:
    """Open devices and cameras. On the simulated rig the bench takes the place of ``operator``.

    ``tagged`` as of `open_devices`.

    Raises
    ------
    drivers.errors.DeviceError
        If a device is missing, is another one, or fails.
    """
    cameras: tuple[WallCamera, ...] = ()
    with ExitStack() as stack:
        if config.simulated:
            wires, bench = stack.enter_context(_simulated(config))
            from rig.bench.operator import simulated_operator

            operator, cameras = simulated_operator(bench)
        else:
            stack.enter_context(locked(config))
            wires = stack.enter_context(wires_by_address(config, operator))
            cameras = tuple(stack.enter_context(VideoCamera(one)) for one in config.cameras.addresses)
        yield Station(stack.enter_context(devices_on(config, wires, tagged=tagged)), operator, cameras)


@contextmanager
def _simulated(config: RigConfig, begin_s: float = 0.0) -> "Iterator[tuple[Wires, Bench]]":
    """Build the simulated bench and put its devices at the ends of the wires."""
    from rig.bench.operator import SimulatedOperator
    from rig.bench.simulated import simulated_instruments

    bench, instruments = simulated_instruments(config, begin_s)
    bench.warm_up()
    board = SharedBoard(instruments.daq)
    with instruments:
        yield (
            Wires(
                galvo=instruments.galvo_url,
                laser=instruments.laser_url,
                usb_backend=instruments.usb_backend,
                harp=partial(HarpLibrary, instruments.harp),
                daq=lambda device: board,
                clock=bench.clock,
                sync_hz=config.laser.repetition_hz,
                gate_hz=config.gate_hz,
                detector=instruments.detector_url,
                delayer=instruments.delayer_url,
                shutter=instruments.shutter_url,
                operator=SimulatedOperator(bench),
            ),
            bench,
        )


def _guarded(config: RigConfig, wires: Wires, stack: ExitStack, spad: GatedSpad) -> TakesWord:
    """Open the laser behind its guard: a process of its own, unless laser and program end together anyway."""
    if config.simulated:
        laser = stack.enter_context(open_laser(config, wires))
        return GuardedHere(laser, wires.clock)
    guarded = GuardedElsewhere(config)
    guarded.when_hanging.append(spad.disable)
    return stack.enter_context(guarded)


def _attended(
    config: RigConfig, wires: Wires, stack: ExitStack, guarded: TakesWord, sync_hz: Callable[[], float]
) -> GuardedLaser:
    """Put the person in front of a laser without a data interface."""
    if not isinstance(config.laser, ExternalLaserConfig):
        return guarded
    person = (guarded, config, wires.operator, sync_hz, wires.clock)
    if config.shutter is None:
        return stack.enter_context(SwitchedByHand(*person))
    return stack.enter_context(BehindItsShutter(*person))
