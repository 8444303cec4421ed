"""``rig devices``: what the connected devices answer."""

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.options import AsJson, Config

if TYPE_CHECKING:
    from rig.acquire.probing.private import Placeholders
    from rig.acquire.probing.run import Settled
    from rig.acquire.probing.transcript import DeviceTranscript

#: Longest answer on the terminal; the transcripts have all of it.
LONGEST = 60

devices = typer.Typer(no_args_is_help=True, rich_markup_mode="rich")


@devices.callback()
def _devices() -> None:
    """See what the connected devices answer."""


@devices.command("probe")
def probe(
    config: Config = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FOLDER",
            help="Folder for the transcripts. [dim]\\[default: probe-DATE-TIME][/dim]",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Ask each configured device harmless questions, and keep all that passes on its wire.

    Nothing moves, emits, is biased or set: devices are asked who they are, how they are, and what they are
    set to. One that fails is told, and the next one asked. The transcripts, for people and for programs, have
    neither serial numbers nor names nor paths in them. At the end it is told which unconfirmed facts the
    answers settle; docs/bench.md has them all. Exit code 3 if a device could not be asked.

    [bold]Examples[/bold]

      rig devices probe --config lab.toml --out first-look
      # how it looks, on the simulated rig
      rig devices probe
    """
    from rig.acquire.probing import files
    from rig.acquire.probing.run import ask_all, private_of, settled
    from rig.commands import console
    from rig.model.config import built_in, load

    rig = load(config) if config else built_in()
    folder = out or Path(f"probe-{datetime.now():%Y%m%d-%H%M%S}")
    files.refuse_existing(folder)
    asked: list[DeviceTranscript] = []
    simulated = rig.simulated or rig.served
    try:
        for device in ask_all(rig, asked):
            console.say(f"{device.section}, kind {device.kind}: {in_short(device)}")
    finally:  # also what was asked before an interrupt
        hidden = private_of(rig, asked)
        facts = settled(asked, hidden)
        if asked:
            files.write(folder, asked, facts, hidden, simulated=simulated)
            console.say(f"Transcripts: {folder / files.TEXT}, {folder / files.LINES}. {files.LEFT_OUT}")
    if as_json:
        told = [_as_dict(device, hidden) for device in asked]
        found = [files.as_dict(one) for one in facts]
        console.print_json({"folder": str(folder), "simulated": simulated, "devices": told, "facts": found})
    else:
        _print(facts, "unconfirmed facts" + (", as the simulators answer" if simulated else ""))
    if simulated:
        console.say(files.SIMULATED)
    if any(device.failure for device in asked):
        raise typer.Exit(3)


def in_short(device: "DeviceTranscript") -> str:
    """Return how many questions a device answered, and what went wrong."""
    if device.unknown:
        return "no questions are known for this kind"
    if not device.exchanges:
        return device.failure
    answered = sum(exchange.answer is not None for exchange in device.exchanges)
    told = f"{answered} of {len(device.exchanges)} questions answered"
    return f"{told}; {device.failure}" if device.failure else told


def _as_dict(device: "DeviceTranscript", hidden: "Placeholders") -> dict[str, object]:
    return {
        "device": device.section,
        "kind": device.kind,
        "asked": len(device.exchanges),
        "answered": sum(exchange.answer is not None for exchange in device.exchanges),
        "failure": hidden.hidden(device.failure),
    }


def _print(facts: "list[Settled]", title: str) -> None:
    """Print what became of the facts on stdout."""
    from rig.commands import console

    console.print_facts(
        title,
        {one.fact.name: f"{one.verdict.value}, {one.fact.settled_by}: {_short(one.came)}" for one in facts},
    )


def _short(came: str) -> str:
    return came if len(came) <= LONGEST else f"{came[:LONGEST]}..."
