"""Plain HDF5: ``counts`` or ``transient`` (positions, bins), with positions and bin centres beside it.

``laser_position_m`` (positions, 3), ``detector_position_m`` (1 or positions, 3), ``time_s`` (bins,) bin
centres; attributes ``bin_width_s``, ``gate_start_s``, ``simulated``. Rectified, and in this program's frame.
"""

from collections.abc import Iterator

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.errors import DataFileError
from rig.files.check import reading
from rig.importers.content import Content, Options, stored_dtype
from rig.importers.source import Source

NAME = "neutral HDF5"
SIGN = "HDF5 with counts or transient (positions, bins), laser_position_m, detector_position_m, time_s"
_BLOCK_POSITIONS = 256


def recognise(source: Source) -> bool:
    """Return whether the file has this layout."""
    placed = source.has("laser_position_m", "detector_position_m", "time_s")
    return not source.matlab5 and placed and (source.has("counts") or source.has("transient"))


def read(source: Source, options: Options) -> Content:
    """Read the file, block by block.

    Raises
    ------
    DataFileError
        If arrays do not fit together.
    """
    assert source.hdf5 is not None
    if source.has("counts", "transient"):
        raise DataFileError(f"{source.path} holds both counts and transient; keep the one that is meant")
    name = "counts" if source.has("counts") else "transient"
    laser_m = source.numbers("laser_position_m", -1, 3)
    detector_m = source.numbers("detector_position_m", -1, 3)
    time_s = source.numbers("time_s", -1)
    shape = source.shapes[name]
    if shape != (len(laser_m), len(time_s)) or len(detector_m) not in {1, len(laser_m)}:
        raise DataFileError(
            f"{source.path}: {name} has shape {shape}, but there are {len(laser_m)} laser positions, "
            f"{len(detector_m)} detector positions and {len(time_s)} bin centres"
        )
    bin_width_s = source.attribute("bin_width_s", (time_s[-1] - time_s[0]) / max(1, len(time_s) - 1))
    # a thousandth of a bin: far above rounding, far below what an image shows
    even = np.abs(time_s - time_s[0] - np.arange(len(time_s)) * bin_width_s) < 1e-3 * bin_width_s * len(
        time_s
    )
    if not bin_width_s > 0 or not even.all():
        raise DataFileError(f"{source.path}: time_s is not evenly spaced by bin_width_s = {bin_width_s:g} s")
    gate_start_s = float(source.attribute("gate_start_s", 0.0))
    dataset = source.hdf5[name]
    return Content(
        laser_m=laser_m,
        detector_m=detector_m,
        bins=len(time_s),
        bin_width_s=float(bin_width_s),
        first_bin_s=float(time_s[0] - bin_width_s / 2),
        dtype=stored_dtype(dataset),
        blocks=_blocks(source, dataset),
        fade_from_s=gate_start_s if gate_start_s > 0 else None,
        simulated=bool(source.attribute("simulated", False)),
    )


def _blocks(source: Source, dataset: h5py.Dataset) -> Iterator[NDArray]:
    for start in range(0, len(dataset), _BLOCK_POSITIONS):
        with reading(source.path):
            block = dataset[start : start + _BLOCK_POSITIONS]
        yield block
