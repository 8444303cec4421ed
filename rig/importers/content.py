"""What an importer finds in a file."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.files.blocks import read, spans
from rig.files.check import reading
from rig.importers.wall import WallFrame
from rig.model.delays import PathDelays
from rig.model.quantities import show_length

#: Bytes of a dataset read at once.
_BLOCK_BYTES = 2**24


@dataclass(frozen=True)
class Content:
    """A capture in the program's frame, as found in a file.

    Attributes
    ----------
    laser_m, detector_m
        (P, 3), and (1, 3) or (P, 3).
    bins, bin_width_s, first_bin_s
        The time axis; ``first_bin_s`` is the left edge of bin 0.
    dtype
        Type of the counts; floating where they are no photon numbers.
    blocks
        (n, bins) arrays that together give the P positions in order.
    delays, delay_s
        None where time is rectified; else the path delays, or the (P,) delay of each position.
    fade_from_s
        Rectified time before which the record holds the wall's own light.
    instrument_response_s
        Full width at half maximum of the instrument response, where the file says it.
    simulated
        Whether the file says that it was computed.
    frame
        How the file's places were brought into this program's frame, where the file has places of its own.
    assumed
        What was taken for granted, as plain sentences.
    pixels
        Of an exhaustive capture, how many pixels each laser spot has: positions are laser by laser, the
        pixels of each alike, and blocks hold whole lasers. 0 for others.
    """

    laser_m: NDArray[np.float64]
    detector_m: NDArray[np.float64]
    bins: int
    bin_width_s: float
    first_bin_s: float
    dtype: np.dtype
    blocks: Iterable[NDArray]
    delays: PathDelays | None = None
    fade_from_s: float | None = None
    instrument_response_s: float | None = None
    delay_s: NDArray[np.float64] | None = None
    simulated: bool = False
    frame: WallFrame | None = None
    assumed: Sequence[str] = ()
    pixels: int = 0

    @property
    def time_origin(self) -> str:
        """``wall`` or ``laser``."""
        return "wall" if self.delays is None and self.delay_s is None else "laser"


def as_counts(array: NDArray) -> NDArray:
    """Return photon numbers as unsigned integers, and everything else as float32.

    Many programs keep counts as signed integers or floating point: whole numbers that are not negative are
    taken as counts.
    """
    if array.dtype.kind == "u":
        return array
    with np.errstate(invalid="ignore", over="ignore"):  # what is not finite is refused when it is written
        return array.astype(np.uint32 if _are_counts(array) else np.float32)


def stored_dtype(dataset: h5py.Dataset) -> np.dtype:
    """Return the type in which a dataset's values go into the scan file: `as_counts`, of a dataset.

    What is no unsigned integer is read until a value is none, as that decides it.

    Parameters
    ----------
    dataset
        Of `Source.dataset`, which has looked at it.

    Raises
    ------
    DataFileError
        If it is damaged.
    """
    if dataset.dtype.kind == "u":
        return dataset.dtype.newbyteorder("<")
    with reading(Path(dataset.file.filename)):
        return np.dtype("<u4" if all(map(_are_counts, _parts(dataset))) else "<f4")


def _parts(dataset: h5py.Dataset) -> Iterator[NDArray]:
    """Yield a dataset in parts: of chunks one at a time, as each has to be unpacked whole."""
    if not dataset.size:
        return
    for some in dataset.iter_chunks() if dataset.chunks else spans(dataset, 0, _BLOCK_BYTES):
        yield read(dataset, *(some if isinstance(some, tuple) else (some,)))


def _are_counts(array: NDArray) -> bool:
    """Return whether all are whole numbers that are not negative and fit 32 bits."""
    with np.errstate(invalid="ignore"):
        whole = array.dtype.kind in "ib" or bool((np.trunc(array) == array).all())
    return whole and bool(array.min() >= 0 and float(array.max()) < 2**32)


def square_grid(nx: int, ny: int, size_m: float, y_down: bool) -> NDArray[np.float64]:
    """Return the (nx * ny, 3) spots of a square, x slowest, from -x to +x; edges included.

    One line of spots lies in the middle.

    Parameters
    ----------
    nx, ny
        Spots along x and y.
    size_m
        From the first to the last spot.
    y_down
        Whether the second index goes from top to bottom.
    """
    x_m, y_m = (np.linspace(-size_m / 2, size_m / 2, n) if n > 1 else np.zeros(1) for n in (nx, ny))
    grid_x, grid_y = np.meshgrid(x_m, y_m[::-1] if y_down else y_m, indexing="ij")
    return np.column_stack([grid_x.ravel(), grid_y.ravel(), np.zeros(nx * ny)])


def grid_in_words(nx: int, ny: int, size_m: float, y_down: bool) -> str:
    """Return what `square_grid` takes for granted, and both spacings where they differ."""
    told = (
        f"the {nx} x {ny} spots span {size_m:g} m with both edges, x rising, y "
        f"{'falling' if y_down else 'rising'}"
    )
    if nx == ny or 1 in {nx, ny}:
        return told
    return (
        f"{told}, so that they are {show_length(size_m / (nx - 1))} apart along x and "
        f"{show_length(size_m / (ny - 1))} along y: if that is not so, the picture is stretched"
    )
