"""Asking each configured device in turn; what becomes of the facts that nobody has confirmed."""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from drivers.errors import DeviceError
from drivers.lines.listening import listening
from rig.acquire.connect import Reach, wires_of
from rig.acquire.probing.private import Placeholders
from rig.acquire.probing.transcript import DeviceTranscript, Recorder, answer_of
from rig.devices.probing.facts import FACTS, Fact, Verdict, verdict
from rig.devices.probing.questions import QUESTIONS
from rig.model.config import RigConfig


@dataclass(frozen=True)
class Settled:
    """What became of an unconfirmed fact.

    Attributes
    ----------
    fact
        What is believed.
    verdict
        What the answers say of it.
    came
        The answer to its question, without private details.
    """

    fact: Fact
    verdict: Verdict
    came: str


def ask_all(config: RigConfig, devices: list[DeviceTranscript]) -> Iterator[DeviceTranscript]:
    """Ask each configured device, and yield it when it was asked; what failed is kept with it.

    Parameters
    ----------
    config
        Names them.
    devices
        Filled while they are asked, so that an interrupt loses nothing.

    Raises
    ------
    RefusedError
        If another program has the rig.
    """
    with wires_of(config) as reach:
        began_s = time.monotonic()
        for section, settings in _configured(config):
            device = DeviceTranscript(section, settings.kind)
            devices.append(device)
            _ask(device, settings, reach, Recorder(device, began_s))
            yield device


def settled(devices: list[DeviceTranscript], hidden: Placeholders) -> list[Settled]:
    """Return what became of the facts about all devices that were asked."""
    found = []
    for device in devices:
        answers = {exchange.question: exchange for exchange in device.exchanges}
        for fact in FACTS:
            if (fact.section, fact.kind) == (device.section, device.kind):
                asked = answers.get(fact.settled_by)
                came = answer_of(asked, hidden) if asked else "not asked"
                found.append(Settled(fact, verdict(fact, answers), came))
    return found


def private_of(config: RigConfig, devices: list[DeviceTranscript]) -> Placeholders:
    """Return what is private in all that was said, to be called when all has been said."""
    hidden = Placeholders()
    hidden.learn_configuration(config)
    hidden.learn_computer()
    for device in devices:
        for exchange in device.exchanges:
            hidden.learn_answer(exchange)
        hidden.learn_text(device.failure)
    return hidden


def _configured(config: RigConfig) -> Iterator[tuple[str, Any]]:
    """Return the sections that are a device of some kind."""
    for name in type(config).model_fields:
        section = getattr(config, name)
        if hasattr(section, "kind"):
            yield name, section


def _ask(device: DeviceTranscript, settings: Any, reach: Reach, recorder: Recorder) -> None:
    questions = QUESTIONS.get((device.section, device.kind))
    if questions is None:
        device.unknown = True
        return
    try:
        with listening(recorder), reach(device.section) as wires:
            for exchange in questions(settings, wires):
                recorder.exchanged(exchange)
    except DeviceError as problem:
        device.failure = str(problem)
    finally:
        recorder.exchanged(None)
