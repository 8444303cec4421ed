"""``rig watch``: look at a scan that another program writes, or that is complete."""

from pathlib import Path
from typing import Annotated

import typer

from rig.commands.options import HERE


def watch(
    scan: Annotated[Path, typer.Argument(metavar="SCAN.h5", help="A scan file that is being written.")],
    web: Annotated[
        str | None,
        typer.Option(
            "--web",
            metavar="HOST:PORT",
            help="Where the page is served; on other computers it needs the token that is printed. "
            f"[dim]\\[default: {HERE}:8642][/dim]",
        ),
    ] = None,
    open_: Annotated[bool, typer.Option("--open", help="Open the page in this computer's browser.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the address as one JSON document.")] = False,
) -> None:
    """Show a scan that is being written as a page in a browser, until Ctrl-C. The file is only read.

    Counts, rates, warnings and a growing image, as by 'rig scan --web', once a second; of the light what the
    file says. Nothing can be stopped from this page.

    [bold]Examples[/bold]

      rig watch scan.h5                        on this computer

      rig watch scan.h5 --web 0.0.0.0:8642     on others, too
    """
    import sys

    from rig.commands import console
    from rig.commands.running import page_at
    from rig.commands.serve import end_in_order
    from rig.live.watching import Watching

    address = page_at(web or HERE)
    assert address is not None
    with Watching(scan, address, lambda trouble: console.warn(f"rig watch: {trouble}")) as watching:
        end_in_order(watching.stop)
        url = watching.address.url
        if as_json:
            console.print_json({"file": str(scan), "page": url})
        else:
            print(url)
        sys.stdout.flush()
        console.say("Watching; press Ctrl-C to end.")
        if open_:
            import webbrowser

            if not webbrowser.open(url):
                console.warn("no browser could be opened: open the address in a browser")
        watching.wait()
