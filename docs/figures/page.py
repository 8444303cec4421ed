"""Draw docs/images/page.png: the page of a volume in a browser. It needs Chromium, and takes seconds.

rig scan --exposure 10ms --out scan.h5
rig recon scan.h5
PYTHONPATH=tests python docs/figures/page.py scan-volume.h5 docs/images/page.png
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from rig.exporters import page
from rig.files import read_volume
from support.browser import screenshot

SIZE = 1200, 1090


def main(volume: Path, picture: Path) -> None:
    """Write the page, and what a browser shows of it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "page.html"
        page.save(read_volume(volume), path)
        shown = screenshot(path, size=SIZE)
    pixels = Image.fromarray((shown * 255).round().astype(np.uint8))
    pixels.save(picture, optimize=True)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
