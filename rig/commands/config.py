"""``rig config``: what a configuration says in all."""

from dataclasses import asdict

import typer

from rig.commands.options import AsJson, Config

config = typer.Typer(no_args_is_help=True, rich_markup_mode="rich")


@config.callback()
def _config() -> None:
    """See what a configuration says, with all that it extends."""


@config.command("show")
def show(config: Config = None, as_json: AsJson = False) -> None:
    """Print all values of a rig, and where each comes from: a file, or the program's default.

    What is wrong in a configuration is named with its file, and exit code 2.
    """
    from rig.commands import console
    from rig.model.config import built_in
    from rig.model.config.inherited import read
    from rig.model.config.reading import resolved
    from rig.setup.origins import values

    written = read(config) if config else None
    rig = resolved(written, {}) if written else built_in()
    found = list(values(rig, written))
    if as_json:
        console.print_json({"name": rig.name, "values": [asdict(one) for one in found]})
    else:
        rows = [(one.key, one.text or "not set", one.origin) for one in found]
        console.print_table(("key", "value", "from"), rows, words=("value", "from"))
