"""``rig sim serve``: the simulated devices in a process of their own."""

import os
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.options import BUILT_IN, Config

if TYPE_CHECKING:
    from rig.model.config import RigConfig

#: First line of the files that are written, by which they are known.
HEAD = "# Written by rig sim serve: valid while that process runs."


def serve(
    config: Config = None,
    log: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Append a line for each change of emission, power, bias, mirror."),
    ] = None,
    write_config: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write a configuration with which rig scan uses these devices."),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Without effect: the result is always one JSON document.")
    ] = False,
) -> None:
    """Serve the simulated galvo, laser, detector and DAQ board to other programs, until Ctrl-C or SIGTERM.

    Their addresses are printed as one JSON document. Galvo and laser are pseudo-terminals, which any program
    opens as a serial port. Time is real time. A program that ends or is killed changes nothing: the laser
    goes on as it was told last.

    [bold]Examples[/bold]

      rig sim serve --write-config served.toml --log changes.log
      # in another terminal
      rig scan --config served.toml --grid 12x9 --spacing 15cm

    A line of the log is `time_s device what value`, e.g. `12.481 laser emission 1`.
    """
    from rig.bench.served import configuration, served
    from rig.commands import console
    from rig.errors import UsageError
    from rig.model.config import built_in, load

    if sys.platform == "win32":
        raise UsageError(
            "rig sim serve needs pseudo-terminals, which this system does not have; "
            "rig scan without --config simulates the devices in its own process"
        )
    rig_config = load(config) if config else built_in()
    if not rig_config.simulated:
        raise UsageError(
            f"{config} has real devices; give the configuration of a simulated rig, or --config {BUILT_IN}"
        )
    if write_config:
        _refuse_foreign(write_config)
    with served(rig_config, log) as server:
        end_in_order(server.stop)
        signal.signal(signal.SIGUSR1, lambda *_: server.switch_interlock())
        if write_config:
            _write(configuration(rig_config, server.addresses), write_config)
        files = {"log": str(log) if log else None, "config": str(write_config) if write_config else None}
        began_unix_s = round(time.time() - server.now_s(), 3)
        console.print_json(
            {**asdict(server.addresses), **files, "pid": os.getpid(), "began_unix_s": began_unix_s}
        )
        sys.stdout.flush()
        console.say("Serving; Ctrl-C ends it.")
        server.run()


def end_in_order(stop: Callable[[], None]) -> None:
    """Let Ctrl-C, SIGTERM and a closed terminal end the server; with nohup it outlives its terminal."""
    if sys.platform == "win32":
        return
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, lambda *_: stop())


def _refuse_foreign(target: Path) -> None:
    """Refuse to write over a file that no earlier server wrote.

    Raises
    ------
    rig.errors.UsageError
        If such a file is there.
    """
    from rig.errors import UsageError, refuse_folder
    from rig.whole import read_whole

    refuse_folder(target, "--write-config ")
    try:
        ours = not target.exists() or read_whole(target).startswith(HEAD.encode("ascii"))
    except OSError:
        ours = False
    if not ours:
        raise UsageError(f"{target} exists and is not overwritten; give another --write-config")


def _write(config: "RigConfig", target: Path) -> None:
    from rig.atomic import appearing
    from rig.errors import UsageError, reason
    from rig.model.written import as_toml

    try:
        with appearing(target) as partial:
            partial.write_text(f"{HEAD}\n\n{as_toml(config)}", encoding="utf-8")
    except OSError as problem:
        raise UsageError(f"{target} cannot be written ({reason(problem)}); give another name") from None
