"""The kinds of detectors."""

from contextlib import AbstractContextManager
from functools import partial

from drivers.errors import LimitError
from drivers.id120 import Id120Settings, Id120Spad
from drivers.mpd.detector import PROGRAM, MpdSpad
from drivers.mpd.settings import MpdSettings
from rig.devices.by_hand import DetectorByHand
from rig.devices.kinds.kind import Kind, Kinds
from rig.devices.kinds.wires import Wires
from rig.model.config import ExternalDetectorConfig, Id120Config, MpdConfig
from rig.model.devices import GatedSpad, Operator, Request
from rig.model.quantities import show


def id120_settings(config: Id120Config) -> Id120Settings:
    """Return how an ID120 is set, or raise `drivers.errors.LimitError`."""
    if config.gated:
        raise LimitError(
            "ID120",
            "be gated",
            "it has no gate that a public command sets",
            "Nothing was sent. Gated kinds: mpd (with a [delayer]), external (docs/detectors.md).",
        )
    return Id120Settings(hold_off_s=config.hold_off_s)


def open_id120(config: Id120Config, wires: Wires) -> AbstractContextManager[GatedSpad]:
    """Return an ID120, to be entered."""
    return Id120Spad(
        serial=config.serial,
        backend=wires.usb_backend,
        clock=wires.clock,
        settings=id120_settings(config),
    )


def mpd_settings(config: MpdConfig, trigger_hz: float = 10e6) -> MpdSettings:
    """Return how a Fast-Gated SPAD is set, or raise `drivers.errors.LimitError`."""
    return MpdSettings(
        gated=config.gated,
        gate_width_s=config.gate_width_s,
        gate_delay_s=config.gate_delay_s,
        hold_off_s=config.hold_off_s,
        trigger_hz=trigger_hz,
    )


def open_mpd(config: MpdConfig, wires: Wires) -> AbstractContextManager[GatedSpad]:
    """Return a Fast-Gated SPAD, to be entered."""
    return MpdSpad(
        wires.detector,
        clock=wires.clock,
        settings=mpd_settings(config, wires.gate_hz),
        person=partial(_ask_hold_off, wires.operator) if wires.operator else None,
    )


def _ask_hold_off(operator: Operator, hold_off_s: float) -> None:
    """Have a person set the hold-off, in the program to which the port belongs meanwhile."""
    words = f"In {PROGRAM}, set the detector's hold-off to {show(hold_off_s, 's', 4)}, and close that program"
    operator.set_by_hand(Request("detector", words, {"hold_off_s": hold_off_s}))


def open_external_detector(config: ExternalDetectorConfig, wires: Wires) -> AbstractContextManager[GatedSpad]:
    """Return a detector that a person sets, to be entered."""
    return DetectorByHand(config, wires.operator, delayed=wires.gate_delayed)


DETECTORS: Kinds[Kind[GatedSpad]] = Kinds(
    "detector",
    Kind(Id120Config, open_id120, id120_settings),
    Kind(MpdConfig, open_mpd, mpd_settings),
    Kind(ExternalDetectorConfig, open_external_detector),
)
