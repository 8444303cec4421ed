"""Commands that install what is missing, for the Python that runs."""

import re
import sys
from importlib.metadata import PackageNotFoundError, requires

from rig.errors import in_shell

#: This program, as package.
OWN = "nlos-rig"


def install(*packages: str) -> str:
    """Return the command that installs packages."""
    return in_shell(sys.executable, "-m", "pip", "install", *packages)


def install_extra(extra: str) -> str:
    """Return the command that installs what an optional extra of this program brings.

    The packages are named themselves: this program is in no index, so that ``nlos-rig[...]`` would find
    nothing unless it is installed.
    """
    return install(*packages_of(extra))


def packages_of(extra: str) -> list[str]:
    """Return the requirements of an extra, from what the installed program says of itself."""
    try:
        said = requires(OWN) or []
    except PackageNotFoundError:  # run from a folder that nobody installed
        said = []
    marked = re.compile(rf"""extra\s*==\s*['"]{re.escape(extra)}['"]""")
    found = [one.partition(";")[0].strip() for one in said if marked.search(one)]
    return found or [f".[{extra}]"]
