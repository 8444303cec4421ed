"""What the two forms of a scan file have in common: histograms, and the bin of each photon.

A form gathers steps, packs them for the journal, writes them to the HDF5 file, reads them back, and takes
them back. Writer, journal and mending know no form.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from math import prod
from typing import Any, ClassVar

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.files.description import ScanDescription
from rig.files.journal import Chunk


class Form(ABC):
    """How a scan file holds its photons, and what is gathered of it while it is written.

    An exception may come between any two lines: nothing is counted as written before it is, and what is done
    twice gives the same. How many steps there are is counted by the writer, not here.

    Parameters
    ----------
    file
        A scan file that is open for writing.

    Attributes
    ----------
    DATASETS
        Those of ``/transients`` that only this form has; the first tells the form.
    steps
        Number of steps S.
    shape
        (channels, bins) of a step; (bins,) in version 1.
    at
        What is gathered and not yet in the HDF5 file, with its place there; replaced as a whole.
    sums
        Checksums of what was written to the HDF5 file, to be held against `stored_sums`.
    """

    DATASETS: ClassVar[tuple[str, ...]]

    steps: int
    shape: tuple[int, ...]
    at: Any
    sums: Any

    @abstractmethod
    def __init__(self, file: h5py.File) -> None: ...

    @staticmethod
    @abstractmethod
    def create(transients: h5py.Group, description: ScanDescription) -> None:
        """Make the datasets of ``/transients`` in a new scan file."""

    @staticmethod
    @abstractmethod
    def copy_empty(old: h5py.Group, new: h5py.Group) -> None:
        """Make the form's datasets as in another scan file, without photons."""

    @staticmethod
    @abstractmethod
    def written_here(transients: h5py.Group) -> bool:
        """Return whether photons are stored as this program stores them, so that it can add to them."""

    @staticmethod
    @abstractmethod
    def chunks(file: h5py.File, measured: int) -> Iterator[Chunk]:
        """Yield the first ``measured`` steps of a scan file as a journal holds them."""

    @staticmethod
    @abstractmethod
    def unpacked(
        transients: h5py.Group, chunk: Chunk, first: int
    ) -> tuple[NDArray[np.unsignedinteger], NDArray[np.int64]]:
        """Return the photons of a journal's chunk.

        Parameters
        ----------
        transients
            Of a scan file of the same scan; its photons are not read.
        chunk
            The chunk.
        first
            The first step that is wanted of it.

        Returns
        -------
        The bin of each photon, and how many each measured step and channel has.
        """

    @staticmethod
    @abstractmethod
    def stored_sums(file: h5py.File) -> Any:
        """Return the checksums that a scan file holds."""

    @staticmethod
    @abstractmethod
    def altered(file: h5py.File, sums: Any) -> NDArray[np.bool_]:
        """Return (S,) which steps are marked as measured though they are not what was written.

        Parameters
        ----------
        file
            The scan file.
        sums
            `stored_sums` of it, or the `sums` of who wrote it.
        """

    def fitting(self, counts: NDArray) -> NDArray:
        """Return a step's counts in the file's shape.

        Raises
        ------
        ValueError
            If they have another shape.
        """
        alone = prod(self.shape[:-1]) == 1
        if np.shape(counts) != self.shape and not (
            alone and np.shape(counts) in {self.shape[-1:], (1, *self.shape[-1:])}
        ):
            raise ValueError(f"counts must be {self.shape}, not {np.shape(counts)}")
        return np.reshape(counts, self.shape)

    @property
    @abstractmethod
    def room_bytes(self) -> int:
        """Bytes that must be free on the disk so that what is gathered, and as much again, can be written."""

    @abstractmethod
    def put(self, step: int, counts: NDArray) -> None:
        """Gather a step that was counted.

        Raises
        ------
        ValueError, TypeError
            If the shape or type does not fit.
        """

    @abstractmethod
    def full(self, appended: int) -> bool:
        """Return whether what is gathered must be written before a further step comes."""

    @abstractmethod
    def turn(self, appended: int) -> None:
        """Go on after what was gathered is written."""

    @abstractmethod
    def due(self, written: int, appended: int, *, last: bool) -> bool:
        """Return whether something is to be written to the HDF5 file."""

    @abstractmethod
    def packed(self, journaled: int, appended: int, live_time_s: NDArray[np.float32]) -> Chunk:
        """Return a chunk for the journal that holds the steps which it does not hold yet."""

    @abstractmethod
    def write(self, chunk: Chunk, written: int, appended: int, *, last: bool) -> int:
        """Write to the HDF5 file what is due: all that is whole, or all if it is the last.

        Parameters
        ----------
        chunk
            What `packed` gave.
        written, appended
            Steps in the HDF5 file, and in all.
        last
            Whether nothing will follow.

        Returns
        -------
        How many steps are in the HDF5 file now.
        """

    @abstractmethod
    def before(self, first: int) -> tuple[Any, int]:
        """Return ``at`` without the steps from ``first`` on, and how many steps are in the HDF5 file then."""

    @abstractmethod
    def take_up(self, measured: int) -> int:
        """Read back the first steps of a file; return how many of them are not to be written again."""

    @abstractmethod
    def restore(self, chunk: Chunk, rows: int) -> None:
        """Write a chunk of the journal to a new HDF5 file; its first ``rows`` steps are measured."""

    @abstractmethod
    def finish(self, measured: int) -> None:
        """Complete a file after all was restored."""

    @abstractmethod
    def photons(self, measured: int) -> float:
        """Return the sum of the photons of the first steps."""


def create_marks(transients: h5py.Group, steps: int, *, grows: bool = False) -> None:
    """Make the datasets of a new scan file that say which steps are measured, and for how long."""
    may = {"maxshape": (None,)} if grows else {}
    transients.create_dataset("done", data=np.zeros(steps, bool), **may)
    transients.create_dataset("live_time_s", data=np.full(steps, np.nan, "<f4"), **may)
