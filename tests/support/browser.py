"""A browser without a window: what a page shows, and what it becomes."""

import re
import shutil
import subprocess
from html import unescape
from pathlib import Path

from matplotlib.image import imread
from numpy.typing import NDArray

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FOUND = next(filter(None, map(shutil.which, NAMES)), None)
MISSING = f"no browser to look at pages with: none of {', '.join(NAMES)} is installed"
#: Graphics by the processor; nothing is fetched, asked or kept.
_OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--hide-scrollbars",
    "--virtual-time-budget=8000",
)
#: A busy machine starts a browser slowly.
_TIMEOUT_S = 200


def _run(page: str, folder: Path, *options: str) -> str:
    assert FOUND
    told = subprocess.run(
        [FOUND, *_OPTIONS, f"--user-data-dir={folder / 'browser'}", *options, page],
        capture_output=True,
        text=True,
        timeout=_TIMEOUT_S,
        check=True,
    )
    return told.stdout


def screenshot(path: Path, at: str = "", size: tuple[int, int] = (1000, 700), *options: str) -> NDArray:
    """Return what the browser shows of a page, (height, width, 3) from 0 to 1."""
    picture = path.with_suffix(".shot.png")
    _run(
        path.as_uri() + at,
        path.parent,
        f"--screenshot={picture}",
        f"--window-size={size[0]},{size[1]}",
        *options,
    )
    return imread(picture)[..., :3]


def became(path: Path, *options: str, at: str = "") -> str:
    """Return the page's elements after its program ran, as text.

    The browser does not wait for what another thread of it unpacks, so it may have to look again.
    """
    elements = ""
    for _ in range(3):
        elements = _run(path.as_uri() + at, path.parent, "--dump-dom", *options)
        if "data-shown=" in elements:
            break
    return elements


def attribute(elements: str, name: str) -> str:
    """Return the value of the first attribute of this name."""
    found = re.search(rf'{name}="([^"]*)"', elements)
    assert found, f"no element has {name}"
    return unescape(found[1])
