"""Multi-page TIFF of a volume: a 32-bit floating-point page for each plane, as the virtual camera sees it.

Rows go from the top down and columns from +x to -x, so that pictures read right. ImageJ finds the voxel's
size: pixels a metre in the resolution tags, and the distance of planes in the description (ImageJ,
"TIFF files").
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from rig.exporters.arrays import pitches_m
from rig.files import Volume

NAME = "TIFF, a page for each plane"
ENDINGS = (".tif", ".tiff")
_DESCRIPTION, _X_RESOLUTION, _Y_RESOLUTION, _RESOLUTION_UNIT = 270, 282, 283, 296


def write(path: Path, volume: Volume) -> None:
    """Write the file; frames of the transient camera follow one another, plane by plane in each.

    Raises
    ------
    UsageError
        If the volume is not evenly spaced.
    """
    x_pitch_m, y_pitch_m, z_pitch_m = pitches_m(volume)
    shape = volume.intensity.shape
    frames = 1 if volume.t_s is None else len(volume.t_s)
    planes = int(np.prod(shape[:-2])) // frames
    tags = ImageFileDirectory_v2()
    tags[_DESCRIPTION] = (
        f"ImageJ=1.54f\nimages={frames * planes}\nslices={planes}\nframes={frames}\nhyperstack=true\n"
        f"unit=m\nspacing={z_pitch_m!r}\nloop=false\n"
        f"min={float(volume.intensity.min())!r}\nmax={float(volume.intensity.max())!r}\n"
    )
    tags[_X_RESOLUTION], tags[_Y_RESOLUTION] = 1 / x_pitch_m, 1 / y_pitch_m
    tags[_RESOLUTION_UNIT] = 1  # none: the unit is in the description
    pages = _pages(volume)
    next(pages).save(path, format="TIFF", save_all=True, append_images=pages, tiffinfo=tags)


def _pages(volume: Volume) -> Iterator[Image.Image]:
    for plane in volume.intensity.reshape(-1, *volume.intensity.shape[-2:]):
        yield Image.fromarray(np.ascontiguousarray(plane[::-1, ::-1], np.float32))
