"""Young et al. 2020 (directional light-cone transform): the struct ``nlos`` of its programs, saved by MATLAB.

Fields ``Data`` (x, y, t) rectified confocal counts, ``DeltaT`` bin width, metres of optical path, and
``CameraGridSize`` the wall's side [m]; in the struct ``nlos``, or saved one by one. The axes are taken as
those of O'Toole 2018, whose scans are among its data; spots include both edges.
"""

import numpy as np
from numpy.typing import NDArray

from recon.capture import C_M_PER_S
from rig.errors import DataFileError
from rig.importers.content import Content, as_counts, square_grid
from rig.importers.options import Options, positive
from rig.importers.source import Source

NAME = "Young 2020, D-LCT"
SIGN = "MATLAB with the struct nlos, or its fields Data (x, y, t), DeltaT and CameraGridSize"
PARTS = ("nlos or Data", "nlos or DeltaT", "nlos or CameraGridSize")


def recognise(source: Source) -> bool:
    """Return whether the file has this layout."""
    return source.holds(*PARTS)


def read(source: Source, options: Options) -> Content:
    """Read the file.

    Raises
    ------
    DataFileError
        If a field is missing, or has another shape.
    """
    cube = _field(source, "Data")
    delta_m, sizes_m = (_field(source, name).astype(float).ravel() for name in ("DeltaT", "CameraGridSize"))
    if cube.ndim != 3 or 0 in cube.shape or delta_m.size != 1 or not sizes_m.size or np.ptp(sizes_m):
        raise DataFileError(
            f"{source.path}: Data has shape {cube.shape}, DeltaT {delta_m.shape} and CameraGridSize is "
            f"{sizes_m}; a cube (x, y, t), one bin width and the side of a square are needed"
        )
    nx, ny, bins = cube.shape
    size_m = positive(float(sizes_m[0]), f"{source.path}: CameraGridSize")
    spots_m = square_grid(nx, ny, size_m, y_down=True)
    counts = as_counts(cube.reshape(nx * ny, bins))
    return Content(
        laser_m=spots_m,
        detector_m=spots_m,
        bins=bins,
        bin_width_s=positive(float(delta_m[0]), f"{source.path}: DeltaT") / C_M_PER_S,
        first_bin_s=0.0,
        dtype=counts.dtype,
        blocks=[counts],
        assumed=(
            f"the {nx} x {ny} spots span {size_m:g} m with both edges, x rising, y falling: "
            "the file does not contain this, so the picture may be mirrored or turned",
            "DeltaT is metres of optical path",
            "confocal, rectified: bin 0 starts when the pulse is on the wall",
        ),
    )


def _field(source: Source, name: str) -> NDArray:
    """Return a field of the struct in MATLAB's order, wherever it was saved."""
    value = source.matlab_array(f"nlos/{name}" if source.has("nlos") else name)
    if value.dtype.kind not in "uifb":
        raise DataFileError(f"{source.path}: {name} has type {value.dtype}, not real numbers")
    return value
