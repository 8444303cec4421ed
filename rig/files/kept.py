"""What is kept of scans for a while, so that it is not read again: data of a bounded size, never an order.

It is in the folder ``nlos-rig`` under the user's folder for such things (``XDG_CACHE_HOME``), or where the
environment variable ``RIG_CACHE`` says, and may be removed at any time. A file is named by the digest of the
scan that it was made of; one that is damaged, or of another program's version, is made again.
"""

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.atomic import appearing
from rig.errors import RigError
from rig.model.npz import read_npz

#: Most bytes of all that is kept; what was used longest ago goes first.
MOST_BYTES = 512_000_000


def folder() -> Path:
    """Return the folder; it need not exist."""
    usual = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "nlos-rig"
    return Path(os.environ.get("RIG_CACHE") or usual)


def kept(name: str) -> tuple[dict[str, NDArray], dict[str, Any]] | None:
    """Return arrays and facts that were kept under a name; None where there are none that can be read."""
    path = _path(name)
    try:
        arrays = read_npz(path)
        facts = json.loads(arrays.pop("facts").tobytes())
        os.utime(path)  # used now
    except (OSError, ValueError, KeyError, RecursionError):
        return None
    return (arrays, facts) if isinstance(facts, dict) else None


def keep(name: str, arrays: Mapping[str, NDArray], facts: Mapping[str, Any]) -> None:
    """Keep arrays and facts, if the disk allows it; what was used longest ago makes room."""
    path, said = _path(name), np.frombuffer(json.dumps(facts).encode(), np.uint8)
    with suppress(OSError, RigError):
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        with appearing(path) as partial:
            np.savez(partial, **{**arrays, "facts": said})  # type: ignore[arg-type]
        _make_room(path)


def _path(name: str) -> Path:
    return folder() / f"{name}.npz"


def _make_room(newest: Path) -> None:
    """Remove what was used longest ago until the rest is small enough."""
    found = sorted(folder().glob("*.npz"), key=lambda path: path.stat().st_mtime, reverse=True)
    held = 0
    for path in [newest, *(path for path in found if path != newest)]:
        held += path.stat().st_size
        if held > MOST_BYTES:
            path.unlink(missing_ok=True)
