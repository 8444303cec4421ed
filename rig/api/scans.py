"""A scan file, as Python programs have it."""

import os
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, Self, Unpack

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from recon.capture import Capture
from rig.api import html
from rig.api.images import Image, open_volume
from rig.errors import UsageError, printable
from rig.files.scan import ScanFile
from rig.files.volume import is_volume
from rig.image.asked import ImageOptions, asked
from rig.image.reconstruct import imaged
from rig.show.about import scan_document


class Scan:
    """A scan file that is open for reading; use it as a context manager, or `close` it.

    Photons stay in the file until they are asked for.

    Parameters
    ----------
    path
        A scan file.

    Raises
    ------
    rig.errors.DataFileError
        If the file is missing, damaged, or no scan.

    Examples
    --------
    >>> with rig.open_scan("letters.h5") as scan:
    ...     scan.status, scan.positions_m.shape, scan.histogram(0).shape
    ('complete', (432, 3), (1, 15000))
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._file = ScanFile(os.fspath(path))

    @property
    def path(self) -> Path:
        """Where the file is."""
        return self._file.path

    @property
    def file(self) -> ScanFile:
        """The reader, for all that is not here.

        Raises
        ------
        rig.errors.UsageError
            If the scan was closed, as of all that reads.
        """
        if not self._file.is_open:
            raise UsageError(f"{self.path} was closed; open it again with rig.open({str(self.path)!r})")
        return self._file

    @property
    def status(self) -> str:
        """``complete``, ``interrupted``, ``failed``, or ``running`` while a scan writes it."""
        return self.file.status

    @property
    def info(self) -> dict[str, Any]:
        """What `rig info` says of it: plan, rig, notes, warnings and so on, numbers in SI units."""
        return scan_document(self.file)

    @property
    def positions_m(self) -> NDArray[np.float64]:
        """(S, 3) laser spot of each step, on the wall."""
        return self.file.laser_m

    @property
    def detector_m(self) -> NDArray[np.float64]:
        """(1 or S, C, 3) spots that the C channels look at."""
        return self.file.detector_m

    @property
    def done(self) -> NDArray[np.bool_]:
        """(S,) which steps were measured."""
        return np.asarray(self.file.done)

    @property
    def times_s(self) -> NDArray[np.float64]:
        """(B,) centres of the bins, in the file's time: see `capture` for the time since the wall was lit."""
        centres = np.arange(self.file.bins, dtype=np.float64) + 0.5
        return self.file.first_bin_s + centres * self.file.bin_width_s

    def histogram(self, step: int) -> NDArray:
        """Return the (C, B) counts of one step; negative numbers count from the end.

        Raises
        ------
        IndexError
            If there is no such step.
        """
        number = range(self.file.steps)[step]
        return self.counts(range(number, number + 1))[0]

    def counts(self, steps: slice | range = slice(None)) -> NDArray:
        """Return the (steps, C, B) counts, read now; all steps of a large scan take much memory.

        Parameters
        ----------
        steps
            Which; all by default.
        """
        every = range(self.file.steps)
        wanted = every[steps] if isinstance(steps, slice) else steps
        if len(wanted) and not (min(wanted) >= 0 and max(wanted) < len(every)):
            raise IndexError(f"{self.path} has {len(every)} steps, {wanted} are not all among them")
        if not len(wanted):
            return np.zeros((0, len(self.file.channels), self.file.bins), np.uint32)
        first = min(wanted)
        run = self.file.counts(range(first, max(wanted) + 1))
        return run if wanted.step == 1 else run[np.array(wanted) - first]

    def capture(self) -> Capture:
        """Return what was measured as imaging takes it: pairs of spots, in time since the wall was lit.

        Raises
        ------
        rig.errors.DataFileError
            If nothing was measured, or its passes differ in their settings.
        """
        return self.file.capture()

    def image(
        self,
        *,
        progress: Callable[[float], None] | None = None,
        **options: Unpack[ImageOptions],
    ) -> Image:
        """Image what is hidden. Names and defaults are those of the options of `rig recon`.

        Quantities are text with a unit, ``"6cm"``, or numbers in SI units, ``0.06``. What is None is chosen
        by the program, as docs/defaults.md says.

        Parameters
        ----------
        progress
            Called with the fraction that is done.
        wavelength, cycles
            Of the virtual pulse: its carrier, and its length in wavelengths.
        depth
            Nearest and farthest depth, and step: ``"0.5m:3m:2cm"`` or ``(0.5, 3.0, 0.02)``.
        camera
            ``confocal`` for the volume, ``photo`` for one wavelength, ``transient`` for a film.
        solver
            A name in `recon.registry.SOLVERS`, or a function of your own, as `recon.image` takes it.
        width, height, voxel
            Extent of the volume across, and side of a voxel.
        fade_from
            Time since the wall was lit before which light is ignored.
        frames, over
            Of a film: moments ``"2ns:20ns:0.2ns"``, and what is shown of all depths.
        snr
            Signal to noise power for solvers with a Wiener filter.
        memory
            Most memory that imaging may take, for solvers that keep to a bound.
        device
            ``cpu``, or ``cuda``.
        calibrations, even_bins
            A folder whose newest calibrations are used, and whether counts are divided by bins' widths.
        relight
            A hidden point that alone is lit, of an exhaustive capture: ``"10cm,0cm,1m"`` or metres.
        however_long
            Whether what takes more than ten minutes is computed, too.

        Raises
        ------
        rig.errors.UsageError
            If a quantity cannot be understood, or options do not go together.
        rig.errors.DataFileError
            If the scan holds nothing that can be imaged.
        recon.errors.ReconError
            If it cannot be imaged as asked.
        TypeError
            If there is no such option.

        Examples
        --------
        >>> img = scan.image(wavelength="30cm", depth=(0.8, 1.7, 0.05))
        >>> img.parameters["wavelength_m"], img.intensity.shape
        (0.3, (19, 18, 24))
        >>> img.save("letters-volume.h5")
        <rig.Image of letters.h5: 19 x 18 x 24, confocal, rsd, wavelength 30 cm, 2 cycles>
        """
        result = imaged(self.file, asked(**options), progress)
        return Image(result.volume, result)

    def plot(self) -> Figure:
        """Draw the raw data as `rig plot` does: all counts, and the histograms of three positions."""
        from rig.show.raw import scan_figure

        return scan_figure(printable(self.path.name), self.capture())

    def close(self) -> None:
        """Close the file; photons can no longer be read."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __len__(self) -> int:
        """Return the number of steps."""
        return self.file.steps

    def __repr__(self) -> str:
        if not self._file.is_open:
            return f"<rig.Scan {self.path}, closed>"
        bins = f"{len(self.file.channels)} channels, " if len(self.file.channels) > 1 else ""
        return f"<rig.Scan {self.path}: {self.status}, {len(self)} positions, {bins}{self.file.bins} bins>"

    def __str__(self) -> str:
        return str(self._file) if self._file.is_open else repr(self)

    def _repr_html_(self) -> str:
        return html.table(str(self.path), self.file.summary() if self._file.is_open else {"file": "closed"})


def open_scan(path: str | os.PathLike[str]) -> Scan:
    """Open a scan file; raises as `Scan`."""
    return Scan(path)


def open_file(path: str | os.PathLike[str]) -> Scan | Image:
    """Open a file of this program: a scan, or a volume, whichever it is.

    Files of other programs are made scans by `rig.import_file`.

    Raises
    ------
    rig.errors.DataFileError
        If it is missing, damaged, or neither.

    Examples
    --------
    >>> rig.open("letters.h5")
    <rig.Scan letters.h5: complete, 432 positions, 15000 bins>
    >>> rig.open("letters-volume.h5")
    <rig.Image of letters.h5: ...>
    """
    if is_volume(Path(path)):
        return open_volume(path)
    return Scan(path)
