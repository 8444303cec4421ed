"""A browser without a window: pages are opened, and looked at once what is waited for is there."""

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FOUND = next(filter(None, map(shutil.which, NAMES)), None)
MISSING = f"no browser to look at pages with: none of {', '.join(NAMES)} is installed"
#: Graphics by the processor.
OPTIONS = (
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
)
#: A busy machine starts a browser slowly, and draws its first picture late.
PATIENCE_MS = 60_000


@contextmanager
def opening() -> "Iterator[Callable[..., Page]]":
    """Give what opens a page in a browser; no error of a page's program is passed over.

    What is given takes an address, width and height of the window in pixels, and options of the browser. A
    browser is started once for each choice of options.
    """
    from playwright.sync_api import sync_playwright

    errors: list[str] = []
    with sync_playwright() as starting:

        @cache
        def started(*options: str) -> "Browser":
            return starting.chromium.launch(
                executable_path=FOUND, args=[*OPTIONS, *options], timeout=PATIENCE_MS
            )

        def opened(url: str, width: int = 1280, height: int = 900, *options: str) -> "Page":
            page = started(*options).new_page(viewport={"width": width, "height": height})
            page.set_default_timeout(PATIENCE_MS)
            page.on("pageerror", lambda error: errors.append(str(error)))
            page.goto(url)
            return page

        yield opened
    assert not errors, errors
