"""Ahn et al. 2019 (convolutional approximations): MATLAB v5 with the struct ``NLOSDATA``.

``transient`` (nx, ny, bins) and the spots ``l``, ``s`` (nx * ny, 3) with the first axis of
``transient`` fastest; ``times`` bin centres and ``delta`` bin width, both metres of optical path from the
wall. Of a spot's coordinates the first points up and the second along -x: the file does not say so, but only
so are the published digits legible.
"""

import numpy as np

from recon.capture import C_M_PER_S
from rig.errors import DataFileError
from rig.importers.content import Content, as_counts
from rig.importers.options import Options
from rig.importers.places import zeros_as_missing
from rig.importers.source import Source

NAME = "Ahn 2019"
SIGN = "MATLAB v5 with the struct NLOSDATA"
PARTS = ("NLOSDATA",)


def recognise(source: Source) -> bool:
    """Return whether the file has this layout."""
    return source.matlab5 and source.holds(*PARTS)


def read(source: Source, options: Options) -> Content:
    """Read the file.

    Raises
    ------
    DataFileError
        If the struct lacks a field, or its arrays are not consistent.
    """
    needed = ("transient", "l", "s", "times", "delta")
    if missing := [name for name in needed if not source.has(f"NLOSDATA/{name}")]:
        raise DataFileError(
            f"{source.path}: NLOSDATA lacks {', '.join(missing)}, or is not a struct of one element"
        )
    transient, laser, sensor, times_m, delta_m = (
        _numbers(source, name, finite=name not in {"l", "s"}) for name in needed
    )
    bins, spots = times_m.size, len(laser)
    fits = transient.ndim == 3 and transient.shape[0] * transient.shape[1] == spots and delta_m.size == 1
    if not fits or transient.shape[2] != bins or laser.shape != (spots, 3) or sensor.shape != laser.shape:
        raise DataFileError(
            f"{source.path}: transient {transient.shape}, l {laser.shape}, s {sensor.shape} and times "
            f"{times_m.shape} are not consistent"
        )
    step_m = float(delta_m.ravel()[0])
    if not step_m > 0:
        raise DataFileError(f"{source.path}: delta is {step_m} m; it must be positive")
    counts = as_counts(transient.transpose(1, 0, 2).reshape(spots, bins))
    (laser, sensor), unmeasured = zeros_as_missing(laser, sensor)
    return Content(
        laser_m=_in_our_frame(laser),
        detector_m=_in_our_frame(sensor),
        bins=bins,
        bin_width_s=step_m / C_M_PER_S,
        first_bin_s=(float(times_m.ravel()[0]) - step_m / 2) / C_M_PER_S,
        dtype=counts.dtype,
        blocks=[counts],
        assumed=(
            "the first coordinate points up and the second to the left, for a person who faces the wall",
            *unmeasured,
        ),
    )


def _numbers(source: Source, name: str, finite: bool) -> np.ndarray:
    value = source.matlab_array(f"NLOSDATA/{name}")
    if value.dtype.kind not in "uif" or value.size == 0 or (finite and not np.isfinite(value).all()):
        raise DataFileError(f"{source.path}: NLOSDATA.{name} does not hold finite numbers")
    return value


def _in_our_frame(spots: np.ndarray) -> np.ndarray:
    """Return (n, 3) spots on z = 0: x = -second, y = first; the third is the target's distance."""
    return np.column_stack([-spots[:, 1].astype(float), spots[:, 0].astype(float), np.zeros(len(spots))])
