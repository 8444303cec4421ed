"""TAL (the y-tal library), HDF5: ``H`` with time as its first axis, lengths and times in metres.

TAL scans the sensor and keeps the laser still; by Helmholtz reciprocity that is our scanned laser before a
still detector, so the two change places, heads included. Positions on a full, even grid are written as
``T_Sx_Sy``, others as ``T_Si``. Enums are datasets of shape (1,), None is an empty dataset, and
``scene_info`` is YAML, of which JSON is a part.
"""

import json
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from recon.aperture import recognise
from recon.capture import C_M_PER_S, Capture
from recon.errors import GeometryError
from rig.errors import UsageError
from rig.exporters.rectified import rectified
from rig.files import ScanFile
from rig.files.fresh import FreshFile
from rig.files.inspection import CHUNK_BYTES
from rig.files.taken import MADE_OF_A_SCAN

NAME = "TAL"
ENDINGS = (".hdf5",)
_H_FORMAT = {"T_Sx_Sy": 1, "T_Lx_Ly_Sx_Sy": 2, "T_Si": 3, "T_Li_Si": 4}
_GRID_FORMAT = {"N_3": 1, "X_Y_3": 2}
#: Bins in a chunk of H; fewer where there are so many positions that the chunk could not be read again.
CHUNK_BINS = 16
#: Bytes of H in memory at once. The scan file keeps positions together and TAL bins, so each such part is a
#: pass over the scan.
PART_BYTES = 2**29


def write(path: Path, scan: ScanFile, rectify: bool = False, part_bytes: int = PART_BYTES) -> None:
    """Write the file: measured positions only.

    With ``rectify``, time begins when the pulse is on the wall, for all positions, and no legs are in it.
    ``part_bytes`` of the signal are held in memory at once.

    Raises
    ------
    UsageError
        If each position has its own detector spot apart from the laser's, or its own delay: TAL has no form
        for either.
    """
    capture, delays = scan.capture(), scan.delays
    if len(capture.detector_m) > 1 and not capture.confocal:
        raise UsageError(
            f"{scan.path} has pairs of laser and detector spots, for which TAL has no form; export it to .mat"
        )
    if rectify:
        capture, delays = rectified(capture), None
    if len(capture.first_bin_s) > 1 and delays is None:
        raise UsageError(
            f"{scan.path} has a delay for each position, for which TAL has no form; export it with "
            "--rectified, or to .mat"
        )
    place, shape = _grid(capture)
    ordered_m = np.empty_like(capture.laser_m)
    ordered_m[place] = capture.laser_m
    scanned_m = ordered_m.reshape(*shape, 3)
    still_m = scanned_m if capture.confocal else capture.detector_m.reshape(*[1] * len(shape), 3)
    on_grid = len(shape) == 2
    with FreshFile(path) as file:
        _enum(file, "H_format", _H_FORMAT, "T_Sx_Sy" if on_grid else "T_Si")
        for side, spots_m in (("sensor", scanned_m), ("laser", still_m)):
            file[f"{side}_grid_xyz"] = spots_m.astype("<f8")
            file[f"{side}_grid_normals"] = np.broadcast_to(np.array([0, 0, 1], "<f8"), spots_m.shape)
            _enum(file, f"{side}_grid_format", _GRID_FORMAT, "X_Y_3" if on_grid else "N_3")
        # y-tal's solvers want places for the heads even where they do not use them: the wall's centre then
        nowhere = (np.zeros(3), np.zeros(3))
        heads_m = nowhere if delays is None else (delays.laser_head_m, delays.detector_head_m)
        for side, head_m in zip(("sensor", "laser"), heads_m, strict=True):
            file[f"{side}_xyz"] = head_m.astype("<f8")
        file["volume_format"] = h5py.Empty(float)
        file["delta_t"] = capture.bin_width_s * C_M_PER_S
        first_bin_s = capture.first_bin_s[0]
        if delays is not None:
            (channel,) = scan.channels
            first_bin_s = scan.first_bin_s - delays.electronics_delay_s - channel.delay_s
        file["t_start"] = first_bin_s * C_M_PER_S
        file["t_accounts_first_and_last_bounces"] = delays is not None
        file["scene_info"] = json.dumps({**MADE_OF_A_SCAN, "file": scan.path.name})
        part = max(1, min(capture.bins, part_bytes // (4 * capture.positions)))
        _write_signal(file, capture, place, shape, part)


def _grid(capture: Capture) -> tuple[NDArray[np.intp], tuple[int, ...]]:
    """Return each position's place in the flat array of spots, and that array's shape: (x, y), or (n,)."""
    try:
        aperture = recognise(capture.laser_m)
    except GeometryError:
        return np.arange(capture.positions), (capture.positions,)
    shape = (aperture.x.count, aperture.y.count)
    place = aperture.column * shape[1] + aperture.row
    if capture.positions != shape[0] * shape[1] or len(np.unique(place)) != capture.positions:
        return np.arange(capture.positions), (capture.positions,)
    return place, shape


def _enum(file: h5py.File, name: str, codes: dict[str, int], value: str) -> None:
    dataset = file.create_dataset(name, (1,), h5py.enum_dtype(codes, basetype="i"))
    dataset[0] = codes[value]


def bins_of_a_chunk(positions: int, part: int) -> int:
    """Return how many bins of all positions a chunk has, where ``part`` bins are written at once."""
    return max(1, min(part, CHUNK_BINS, CHUNK_BYTES // (4 * positions)))


def _write_signal(
    file: h5py.File, capture: Capture, place: NDArray[np.intp], shape: tuple[int, ...], part: int
) -> None:
    """Write H, ``part`` bins at a time."""
    signal = file.create_dataset(
        "H",
        (capture.bins, *shape),
        "<f4",
        chunks=(bins_of_a_chunk(capture.positions, part), *shape),
        compression="gzip",
        compression_opts=1,
        shuffle=True,
    )
    for start in range(0, capture.bins, part):
        bins = slice(start, min(start + part, capture.bins))
        held = np.empty((bins.stop - bins.start, capture.positions), np.float32)
        for block, counts in capture.histograms.blocks(bins):
            held[:, place[block]] = counts.T
        signal[bins] = held.reshape(-1, *shape)
