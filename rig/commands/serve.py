"""``rig sim serve``: the simulated devices in a process of their own."""

import signal
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.options import Config

if TYPE_CHECKING:
    from rig.model.config import RigConfig
    from simulators.wire.served.server import BenchServer


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
    as_json: Annotated[bool, typer.Option("--json", help="The result is one JSON document anyway.")] = True,
) -> None:
    """Serve the simulated galvo, laser and detector to other programs, until Ctrl-C or SIGTERM.

    Their addresses are printed as one JSON document. Galvo and laser are pseudo-terminals, which any program
    opens as a serial port. Time is real time. A program that ends or is killed changes nothing: the laser
    goes on as it was told last.

    [bold]Examples[/bold]

      rig sim serve --write-config served.toml --log changes.log

      rig scan --config served.toml --grid 12x9 --spacing 15cm         in another terminal

    A line of the log is `time_s device what value`, e.g. `12.481 laser emission 1`.
    """
    import os

    from rig.bench.served import configuration, served
    from rig.commands import console
    from rig.errors import UsageError
    from rig.model.config import built_in, load

    if os.name != "posix":
        raise UsageError(
            "rig sim serve needs pseudo-terminals, which this system does not have; "
            "rig scan without --config simulates the devices in its own process"
        )
    rig_config = load(config) if config else built_in()
    if not rig_config.simulated:
        raise UsageError(f"{config} names real devices; give the configuration of a simulated rig")
    with served(rig_config, log) as server:
        if write_config:
            _write(configuration(rig_config, server.addresses), write_config)
        _print(server, log, write_config)
        console.say("Serving; Ctrl-C ends it.")
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: server.stop())
        server.run()


def _print(server: "BenchServer", log: Path | None, config: Path | None) -> None:
    import os
    import sys
    from dataclasses import asdict

    from rig.commands import console

    files = {"log": str(log) if log else None, "config": str(config) if config else None}
    began = round(time.time() - server.now_s(), 3)
    console.print_json({**asdict(server.addresses), **files, "pid": os.getpid(), "began_unix_s": began})
    sys.stdout.flush()


def _write(config: "RigConfig", target: Path) -> None:
    from rig.atomic import appearing
    from rig.model.written import as_toml

    head = "# Written by rig sim serve: valid while that process runs.\n\n"
    with appearing(target) as partial:
        partial.write_text(head + as_toml(config), encoding="utf-8")
