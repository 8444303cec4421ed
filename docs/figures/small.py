"""Make pictures small: 256 colours, where nobody sees the difference.

    python docs/figures/small.py PICTURE.png...

A picture of more colours than that stays as it is where the nearest ones are visibly off.
"""

import io
import sys
from pathlib import Path

import numpy as np
from PIL import Image

COLOURS = 256
#: How far a colour may be off, of 255, in all but 0.1 % of the pixels.
OFF, PART = 12, 0.999


def shrink(source: Path, target: Path | None = None, width: int | None = None) -> None:
    """Write a picture with fewer bytes, in place if no target is named, and not wider than `width` pixels."""
    with Image.open(source) as stored:
        if stored.mode == "P" and width is None:
            return
        full = stored.convert("RGB")
    if width is not None and width < full.width:
        height = round(full.height * width / full.width)
        full = full.resize((width, height), Image.Resampling.LANCZOS)
    (target or source).write_bytes(min((_written(one) for one in (full, *_quantized(full))), key=len))


def _quantized(full: Image.Image) -> list[Image.Image]:
    """Return the picture with fewer colours, or nothing where that is seen."""
    # the other ways of choosing colours make large areas exact and rare colours wrong
    few = full.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, kmeans=4, dither=Image.Dither.NONE)
    off = np.abs(np.asarray(few.convert("RGB"), int) - np.asarray(full, int)).max(axis=2)
    return [few] if np.quantile(off, PART) <= OFF else []


def _written(image: Image.Image) -> bytes:
    held = io.BytesIO()
    image.save(held, "png", optimize=True)
    return held.getvalue()


if __name__ == "__main__":
    for name in sys.argv[1:]:
        shrink(Path(name))
