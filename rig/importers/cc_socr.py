"""Liu X. et al. 2023 (CC-SOCR): MATLAB ``sub_Sig`` with ``C_i.mat`` and ``C_d.mat`` beside it.

``sub_Sig`` (pairs, t) rectified signals. ``C_i`` and ``C_d`` (pairs, 3) whole numbers: grid indices of the
lit and of the seen spot, the second along +x, the third along +y, the first along +z into the room, which
varies where the wall is not flat. Neither the pitches nor the bin width are in the files; the authors keep
them in their programs (``by``, ``bx``, ``delta_t`` of ``experimental_setup.m``).
"""

import numpy as np
from numpy.typing import NDArray

from rig.errors import DataFileError
from rig.importers.content import Content, as_counts
from rig.importers.options import Options
from rig.importers.source import Source, open_source

NAME = "Liu 2023, CC-SOCR"
SIGN = "MATLAB with sub_Sig (pairs, t), and C_i.mat and C_d.mat beside it"
PARTS = ("sub_Sig", "C_i.mat", "C_d.mat")


def recognise(source: Source) -> bool:
    """Return whether the file has this layout."""
    return source.has("sub_Sig")


def read(source: Source, options: Options) -> Content:
    """Read the file and the two beside it.

    Raises
    ------
    UsageError
        If the bin width or the wall's size was not given.
    DataFileError
        If one of the three files is missing, or they do not fit together.
    """
    signal = source.matlab_array("sub_Sig")
    lit, seen = _indices(source, "C_i"), _indices(source, "C_d")
    if signal.ndim != 2 or signal.dtype.kind not in "uif" or not len(signal) == len(lit) == len(seen) > 0:
        raise DataFileError(
            f"{source.path}: sub_Sig has shape {signal.shape}, but C_i has {len(lit)} "
            f"and C_d {len(seen)} rows"
        )
    bin_width_s = options.asked(
        "bin_width_s",
        source.path,
        "how wide its bins are",
        "published: 32ps for the statue, 16ps for the figure 4",
    )
    size_m = options.asked(
        "wall_size_m",
        source.path,
        "how large the scanned square is",
        "published: 2m for the statue, 1.26m for the figure 4",
    )
    scanned = lit if np.ptp(lit[:, :2], axis=0).any() else seen
    low, high = scanned[:, :2].min(axis=0), scanned[:, :2].max(axis=0)
    if (high == low).all():
        raise DataFileError(
            f"{source.path}: C_i and C_d hold a single spot each, so the wall's size does not give the "
            "spacing"
        )
    pitch_m = size_m / (high - low).max()
    depth_pitch_m, told = _depth_pitch(source, options, lit, seen)
    middle = np.array([*(low + high) / 2, 0.0])
    steps_m = np.array([pitch_m, pitch_m, depth_pitch_m])
    laser_m, detector_m = (lit - middle) * steps_m, (seen - middle) * steps_m
    counts = as_counts(signal)
    return Content(
        laser_m=laser_m,
        detector_m=detector_m[:1] if (detector_m == detector_m[0]).all() else detector_m,
        bins=counts.shape[1],
        bin_width_s=bin_width_s,
        first_bin_s=0.0,
        dtype=counts.dtype,
        blocks=[counts],
        assumed=(
            f"the lit spots span {size_m:g} m, one index is {pitch_m * 100:g} cm; their middle is the origin",
            told,
            "rectified: bin 0 starts when the pulse is on the wall",
        ),
    )


def _indices(source: Source, name: str) -> NDArray[np.float64]:
    """Return the (pairs, 3) indices along x, y and z from the file of this name beside the source."""
    with open_source(source.path.with_name(f"{name}.mat")) as beside:
        return beside.matlab_places(name)[:, [1, 2, 0]]


def _depth_pitch(source: Source, options: Options, lit: NDArray, seen: NDArray) -> tuple[float, str]:
    """Return the length of one depth index, 0 for a flat wall, and what was done with it, in words."""
    deepest = int(max(lit[:, 2].max(), seen[:, 2].max()))
    if not deepest and not min(lit[:, 2].min(), seen[:, 2].min()):
        return 0.0, "the wall is flat: all depth indices are 0"
    pitch_m = options.asked(
        "depth_pitch_m",
        source.path,
        f"how deep its wall is: C_i and C_d hold depth indices up to {deepest}",
        "the length of one of them; published: 1cm for the letters N and T",
    )
    return pitch_m, (
        f"one depth index is {pitch_m * 100:g} cm, index 0 is z = 0, and they grow into the room: the wall "
        f"reaches z = {deepest * pitch_m:g} m"
    )
