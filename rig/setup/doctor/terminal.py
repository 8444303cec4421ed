"""Whether the terminal can show what is printed."""

import sys
from collections.abc import Iterator

from rig.setup.doctor.finding import Finding

#: Signs that messages have: units, bars, names of people.
SIGNS = "µ°²━⠹ü"


def check() -> Iterator[Finding]:
    """Return the encoding of what is printed."""
    encoding = getattr(sys.stdout, "encoding", None) or "ascii"
    try:
        SIGNS.encode(encoding)
    except (UnicodeEncodeError, LookupError):
        remedy = "chcp 65001" if sys.platform == "win32" else "export PYTHONUTF8=1 LANG=C.UTF-8"
        yield Finding("terminal", "warning", f"{encoding}, which lacks signs such as {SIGNS[0]!a}", remedy)
    else:
        yield Finding("terminal", "ok", encoding)
