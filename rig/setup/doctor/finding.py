"""What a check finds."""

from dataclasses import dataclass
from typing import Literal

#: What a check says: all is well, something to look at, something without which nothing works, or something
#: that this rig does not need.
Verdict = Literal["ok", "warning", "missing", "optional"]


@dataclass(frozen=True)
class Finding:
    """The result of one check.

    Attributes
    ----------
    what
        What was looked at.
    verdict
        What comes of it.
    found
        What is there.
    remedy
        What to do, in words or as a command to paste; empty where nothing is to be done.
    """

    what: str
    verdict: Verdict
    found: str
    remedy: str = ""
