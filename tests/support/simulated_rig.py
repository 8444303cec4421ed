"""The three simulated devices on one bench, plugged in for the length of a test."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields

from drivers.id120 import Id120Settings, Id120Spad
from drivers.katana.laser import KatanaLaser
from drivers.katana.settings import KatanaSettings
from drivers.optotune import OptotuneMirror
from simulators.bench import Bench
from simulators.wire.galvo import GalvoBoard
from simulators.wire.laser import KatanaHead
from simulators.wire.serial_url import protocol_sim
from simulators.wire.spad import SpadInstrument
from simulators.wire.usb import UsbBackend


class WatchedBench(Bench):
    """A bench that remembers every change of its light."""

    def __init__(self) -> None:
        super().__init__()
        self.changes: list[dict] = []

    def change_light(self, **changes):
        self.changes.append(changes)
        super().change_light(**changes)

    def ever_emitted(self) -> bool:
        return any(change.get("emitting") for change in self.changes)


def settings_in(options: dict, kind: type) -> dict:
    """Take those options out that are settings of this kind."""
    return {field.name: options.pop(field.name) for field in fields(kind) if field.name in options}


class Rig:
    def __init__(self) -> None:
        self.bench = WatchedBench()
        self.board = GalvoBoard(self.bench)
        self.head = KatanaHead(self.bench)
        self.instrument = SpadInstrument(self.bench)
        self.usb = UsbBackend([self.instrument])
        self.galvo_address = protocol_sim.attach("test/galvo", self.board, self.bench.clock)
        self.laser_address = protocol_sim.attach("test/laser", self.head, self.bench.clock)

    def galvo(self, **options) -> OptotuneMirror:
        return OptotuneMirror(self.galvo_address, clock=self.bench.clock, **options)

    def laser(self, **options) -> KatanaLaser:
        asked = {"power": 7.5, "repetition_hz": 10e6, **settings_in(options, KatanaSettings)}
        return KatanaLaser(
            self.laser_address, clock=self.bench.clock, settings=KatanaSettings(**asked), **options
        )

    def spad(self, **options) -> Id120Spad:
        settings = Id120Settings(**settings_in(options, Id120Settings))
        return Id120Spad(backend=self.usb, clock=self.bench.clock, settings=settings, **options)

    def unplug_all(self) -> None:
        protocol_sim.detach(self.galvo_address)
        protocol_sim.detach(self.laser_address)
        self.usb.unplug(self.instrument)


@contextmanager
def simulated_rig() -> Iterator[Rig]:
    rig = Rig()
    try:
        yield rig
    finally:
        rig.unplug_all()
