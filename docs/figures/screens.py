"""Pictures of the program's pages in a browser: a scan that runs, its report, and its volume in 3-D.

    python docs/figures/screens.py docs/images [FOLDER]

It scans the simulated rig in FOLDER (a temporary one without), looks at the page meanwhile, makes report and
3-D page of the scan, and writes each as it is seen on a desk and on a phone. It needs Chromium, playwright
and axe-core-python, and takes two minutes. It ends with 1 where axe finds something that keeps people from
using a page.
"""

import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from axe_core_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, sync_playwright
from small import shrink

sys.path.append(str(Path(__file__).parents[2] / "tests"))
from support.browser import FOUND, MISSING, OPTIONS

SCAN = ("--grid", "90x65", "--spacing", "2cm", "--exposure", "10ms")
NOTES = ("--operator", "Ada", "--sample", "two letters of white card", "--purpose", "first night")
#: Part of the positions at which the page is looked at.
PART = 60
DESK, PHONE = (1280, 900), (360, 740)
#: A busy machine shows a page late.
PATIENCE_MS = 300_000
#: Least of what axe calls a finding that is told of as bad.
BAD = ("serious", "critical")


def shoot(
    browser: Browser, url: str, picture: Path, *, ready: Callable[[Page], object], whole: bool = True
) -> list[str]:
    """Write how a page looks on a desk and on a phone; return what is bad about it."""
    bad = []
    for name, (width, height) in (("desk", DESK), ("phone", PHONE)):
        page = browser.new_page(viewport={"width": width, "height": height})
        page.set_default_timeout(PATIENCE_MS)
        page.goto(url)
        ready(page)
        found = Axe().run(page)["violations"]
        bad += [f"{url} on a {name}: {one['id']}: {one['nodes'][0]['html']}" for one in found
                if one["impact"] in BAD]  # fmt: skip
        if page.evaluate("document.documentElement.scrollWidth > innerWidth"):
            bad.append(f"{url} on a {name}: wider than the screen")
        write(page.screenshot(full_page=whole), picture.with_name(f"{picture.name}_{name}.png"))
        page.close()
    return bad


def write(png: bytes, path: Path) -> None:
    """Write a picture, small."""
    path.write_bytes(png)
    shrink(path)


def measured(page: Page) -> None:
    """Wait until enough is measured, and its image is there."""
    page.wait_for_function(
        f"() => parseInt(document.getElementById('bar').ariaValueNow) >= {PART} && "
        "document.getElementById('front-title').textContent.includes('positions')"
    )


def rig(folder: Path, *words: str) -> None:
    """Run a command in a folder."""
    subprocess.run([sys.executable, "-m", "rig", *words], cwd=folder, check=True)


def main(images: Path, folder: Path) -> list[str]:
    """Make the pictures; return what is bad about the pages."""
    command = [sys.executable, "-m", "rig", "scan", *SCAN, *NOTES, "--web", "--out", "night.h5"]
    with sync_playwright() as starting:
        browser = starting.chromium.launch(executable_path=FOUND, args=OPTIONS)
        with subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True) as scan:
            url = next(found[1] for line in scan.stderr if (found := re.search(r"Live page: (\S+)", line)))
            bad = shoot(browser, url, images / "web", ready=measured)
            scan.stderr.read()
        rig(folder, "recon", "night.h5")
        rig(folder, "export", "night-volume.h5", "night-volume.html")
        rig(folder, "report", "night.h5")
        for file, name in (("night-report.html", "report"), ("night-volume.html", "page")):
            bad += shoot(
                browser,
                (folder / file).as_uri(),
                images / name,
                ready=lambda page: page.wait_for_timeout(2000),
                whole=name == "page",
            )
        browser.close()
    return bad


if __name__ == "__main__":
    if FOUND is None:
        sys.exit(MISSING)
    to = Path(sys.argv[1]).absolute()
    with tempfile.TemporaryDirectory() as temporary:
        bad = main(to, Path(sys.argv[2]) if len(sys.argv) > 2 else Path(temporary))
    sys.exit("\n".join(bad) or 0)
