"""The simulated devices on one bench, plugged in for the length of a test."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields

from drivers.delayers.dg645 import Dg645, Dg645Settings
from drivers.delayers.psd import Psd, PsdSettings
from drivers.delayers.t560 import T560, T560Settings
from drivers.id120 import Id120Settings, Id120Spad
from drivers.katana.dialects import KATANA_08HP
from drivers.katana.laser import KatanaLaser
from drivers.katana.settings import KatanaSettings
from drivers.mpd.detector import MpdSpad
from drivers.mpd.settings import MpdSettings
from drivers.nkt.laser import NktLaser
from drivers.nkt.settings import NktSettings
from drivers.optotune import OptotuneMirror
from simulators.bench import Bench
from simulators.wire.dg645 import Dg645Box
from simulators.wire.galvo import GalvoBoard
from simulators.wire.laser import Katana08Head, KatanaHead
from simulators.wire.lines import LineFirmware
from simulators.wire.mpd import MpdModule
from simulators.wire.nkt import NktMainboard
from simulators.wire.psd import PsdFirmware
from simulators.wire.serial_url import protocol_sim
from simulators.wire.spad import SpadInstrument
from simulators.wire.t560 import T560Box
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
        self.heads: dict[str, LineFirmware] = {}
        self.unplugged = False
        self.galvo_address = protocol_sim.attach("test/galvo", self.board, self.bench.clock)
        self.laser_address = protocol_sim.attach("test/laser", self.head, self.bench.clock)

    def galvo(self, **options) -> OptotuneMirror:
        return OptotuneMirror(self.galvo_address, clock=self.bench.clock, **options)

    def laser(self, **options) -> KatanaLaser:
        asked = {"power": 7.5, "repetition_hz": 10e6, **settings_in(options, KatanaSettings)}
        return KatanaLaser(
            self.laser_address, clock=self.bench.clock, settings=KatanaSettings(**asked), **options
        )

    def laser_08hp(self, **options) -> KatanaLaser:
        asked = {"power": 0.8, "repetition_hz": 20e6, **settings_in(options, KatanaSettings)}
        settings = KatanaSettings(model=KATANA_08HP, **asked)
        address = self.plug_in("08hp", Katana08Head)
        return KatanaLaser(address, clock=self.bench.clock, settings=settings, **options)

    def laser_nkt(self, **options) -> NktLaser:
        asked = {"level_percent": 40.0, "oscillator_hz": 80e6, "repetition_hz": 10e6}
        settings = NktSettings(**{**asked, **settings_in(options, NktSettings)})
        address = self.plug_in("nkt", NktMainboard)
        return NktLaser(address, clock=self.bench.clock, settings=settings, **options)

    def plug_in(self, name: str, kind: type[LineFirmware]) -> str:
        """Put another device on the bench, once; it is ``heads[name]`` then. Unplugged it stays away."""
        if name not in self.heads:
            self.heads[name] = kind(self.bench)
            if not self.unplugged:
                protocol_sim.attach(f"test/{name}", self.heads[name], self.bench.clock)
        return f"sim://test/{name}"

    def spad(self, **options) -> Id120Spad:
        settings = Id120Settings(**settings_in(options, Id120Settings))
        return Id120Spad(backend=self.usb, clock=self.bench.clock, settings=settings, **options)

    def mpd(self, **options) -> MpdSpad:
        settings = MpdSettings(**settings_in(options, MpdSettings))
        address = self.plug_in("mpd", MpdModule)
        return MpdSpad(address, clock=self.bench.clock, settings=settings, **options)

    def psd(self, **options) -> Psd:
        settings = PsdSettings(**settings_in(options, PsdSettings))
        address = self.plug_in("psd", PsdFirmware)
        return Psd(address, clock=self.bench.clock, settings=settings, **options)

    def dg645(self, **options) -> Dg645:
        settings = Dg645Settings(**{"pulse_width_s": 20e-9, "repetition_hz": 5e6, **options})
        return Dg645(self.plug_in("dg645", Dg645Box), settings=settings)

    def t560(self, **options) -> T560:
        settings = T560Settings(**{"pulse_width_s": 15e-9, "repetition_hz": 10e6, **options})
        return T560(self.plug_in("t560", T560Box), settings=settings)

    def unplug_all(self) -> None:
        self.unplugged = True
        for name in self.heads:
            protocol_sim.detach(f"sim://test/{name}")
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
