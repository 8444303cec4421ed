"""``rig init``: a configuration for the devices that are here."""

import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.options import AsJson

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rig.model.config import RigConfig
    from rig.setup.found import Connected
    from rig.setup.interview import Question

#: First lines of what is written.
_HEAD = (
    "Written by rig init. A line '# key = value' has the default; remove the '#' to change it. "
    "Quantities are text with a unit. Positions are in the relay wall's frame: origin at the wall's centre, "
    "x to the right and y up for one who faces the wall, z out of the wall towards the hardware."
)


def init(
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FILE", help="The configuration to write.")
    ] = Path("lab.toml"),
    answers: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="A configuration file with your answers; the rest gets defaults. No questions.",
        ),
    ] = None,
    defaults: Annotated[
        bool, typer.Option("--defaults", help="Write the built-in simulated rig, without questions.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Look for what is connected, ask which device is which, and write a configuration with comments.

    Nothing is sent to a device, until you agree at the end that those that you chose are asked harmless
    questions. A file that is there is not overwritten.

    [bold]Examples[/bold]

      rig init --out lab.toml                       questions

      rig init --answers mine.toml --out lab.toml   for scripts: mine.toml says galvo.address and so on

      rig init --defaults --out rehearsal.toml      the simulated rig, with every key explained
    """
    from rig.commands import console
    from rig.commands.results import require_free
    from rig.errors import UsageError
    from rig.setup.fitting import refused, within_reach

    if defaults and answers:
        raise UsageError(
            "--defaults writes the built-in rig, --answers one with your answers: leave one of them out"
        )
    require_free([out])
    found: list[Connected] = []
    if not answers and not defaults:
        from rig.setup.found import connected

        found = connected()
        _show(found)
    rig = within_reach(_rig(answers, found, simulated=defaults))
    wrong = refused(rig, out.parent)
    _write(rig, out)
    if wrong:
        console.warn(f"a dry run refuses this rig: {wrong}. Correct it in {out}")
    if rig.laser.fraction_of_full == 0:
        console.announce(
            f"The laser's power is the lowest, 0: set it in {out} when the rig is ready for light."
        )
    if not as_json:
        console.print_facts(str(out), _next(rig, out))
    else:
        told = {"file": str(out), "name": rig.name, "simulated": rig.simulated, "refused": wrong}
        console.print_json({**told, "found": [asdict(one) for one in found]})
    if not (rig.rehearsed or answers):
        _offer_questions(rig)


def _rig(answers: Path | None, found: "Sequence[Connected]", *, simulated: bool) -> "RigConfig":
    """Return the rig that is asked for, or the built-in one."""
    from rig.commands import console
    from rig.model.config import built_in
    from rig.model.config.inherited import read
    from rig.setup.interview import Interview

    if answers:
        return Interview(lambda question: "", console.say, (), read(answers).table).rig()
    if simulated or _simulated_will_do(any(one.speaks for one in found)):
        return built_in()
    return Interview(_ask, console.say, found).rig()


def _simulated_will_do(something: bool) -> bool:
    from rig.commands import console

    if not something:
        console.announce(
            "No device of a rig was found. Switch it on and connect it, or type its address below."
        )
    return _yes("Write the simulated rig instead, to try with?", usually=not something)


def _show(found: "Sequence[Connected]") -> None:
    from rig.commands import console

    console.announce("Connected devices, found without sending anything:")
    for one in found:
        console.announce(f"  {one.way}: {one.address} ({one.said})")
    if not found:
        console.announce("  nothing")


def _ask(question: "Question") -> str:
    """Ask on stderr, and return a line of stdin."""
    from rig.commands import console

    for number, (choice, words) in enumerate(question.choices, 1):
        console.announce(f"  {number}: {choice}  {words}")
    while True:
        given = _line(f"{question.words} [{question.default or 'an answer is needed'}]")
        if given.strip() or question.default:
            return given


def _yes(words: str, *, usually: bool) -> bool:
    given = _line(f"{words} (y/n) [{'y' if usually else 'n'}]").strip().lower()
    return given in ("y", "yes") or (usually and not given)


def _line(words: str) -> str:
    from rig.commands import console
    from rig.errors import UsageError, printable

    console.err.print(f"{printable(words)}: ", end="", markup=False)
    given = sys.stdin.readline()
    if not given.endswith("\n"):
        console.announce("")
        raise UsageError(
            f"there was no answer to: '{words}'. Nothing was written. Without questions: --answers FILE, "
            "--defaults"
        )
    return given


def _write(rig: "RigConfig", out: Path) -> None:
    from rig.atomic import appearing
    from rig.errors import UsageError, reason
    from rig.setup.commented import commented

    try:
        with appearing(out) as partial:
            partial.write_text(commented(rig, _HEAD), encoding="utf-8")
    except OSError as problem:
        raise UsageError(f"{out} cannot be written ({reason(problem)}); give another --out") from None


def _next(rig: "RigConfig", out: Path) -> dict[str, str]:
    """Return what to do with a new configuration."""
    from rig.errors import in_shell

    where = in_shell("--config", out)
    look = {"what is missing": f"rig doctor {where}", "what a scan would do": f"rig scan {where} --dry-run"}
    if rig.rehearsed:
        return {**look, "a scan": f"rig scan {where}"}
    return {
        **look,
        "what the devices answer": f"rig devices probe {where}",
        "measure the rig": f"rig calibrate all {where}",
    }


def _offer_questions(rig: "RigConfig") -> None:
    """Ask the devices that were chosen who they are, if the person agrees."""
    from rig.commands import console
    from rig.errors import UsageError

    try:
        agreed = _yes(
            "Ask these devices for their identity now? Nothing moves, emits or is set.", usually=False
        )
    except UsageError:  # the file is written, and there are no more lines
        return
    if agreed:
        from rig.acquire.probing.run import ask_all
        from rig.commands.devices import in_short

        for device in ask_all(rig, []):
            console.announce(f"{device.section}, kind {device.kind}: {in_short(device)}")
