"""What is compared: a scan, or what can be imported as one, with voxels that show what it resolves."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from recon.defaults import spacing_m
from rig.errors import DataFileError, UsageError, no_file
from rig.files import ScanFile, read_volume
from rig.files.check import open_hdf5, plain
from rig.files.journal import has_journal
from rig.files.mend import keep_as_it_is
from rig.files.volume import is_volume
from rig.image.focus import settled
from rig.image.request import Request
from rig.image.work import Work, chosen
from rig.importers import import_scan

#: Planes in a wavelength: the second derivative along depth has to see the finest period, 0.4 of one.
PLANES = 8


def check_comparable(file: Path, tell: Callable[[str], None] = lambda sentence: None) -> None:
    """Refuse what is no capture, before anything is computed.

    Raises
    ------
    UsageError
        If the file is a volume.
    DataFileError
        If it does not exist, or is a scan that cannot be read.
    """
    if not file.is_file():
        raise DataFileError(no_file(file, "give scans, e.g. of 'rig scan'"))
    if is_volume(file):
        raise UsageError(
            f"{file} is a volume, already imaged by one method; give the scan that it was made from, "
            f"{read_volume(file).scan or 'which it does not name'}"
        )
    if is_scan(file):
        with ScanFile(file) as scan:
            for sentence in scan.doubts:
                tell(sentence)


def is_scan(file: Path) -> bool:
    """Return whether a file is a scan of this program, also one that was not closed."""
    if has_journal(file):  # a scan writes it, or was killed: its reader takes what there is
        return True
    try:
        with open_hdf5(file) as held:
            return bool(plain(held.attrs.get("format")) == "rig-scan")
    except DataFileError:  # no HDF5, so another lab's
        return False


@contextmanager
def opened(file: Path, folder: Path) -> Iterator[ScanFile]:
    """Open a scan, or what is imported as one into a folder.

    Raises
    ------
    UsageError, DataFileError
        As `check_comparable`, or if it cannot be imported without being asked for more.
    """
    check_comparable(file)
    path, own = file, folder / f"{file.stem}.h5"
    if not is_scan(file):
        path = own
        import_scan(file, path)
    elif keep_as_it_is(file, own):  # all methods are to see the same, however long each takes
        path = own
    with ScanFile(path) as scan:
        yield scan


def matched(scan: ScanFile, request: Request) -> tuple[Work, str]:
    """Choose the wavelength as `rig recon` does, and voxels that show what it resolves.

    Returns
    -------
    tuple of Work and str
        The work that all methods share, and why this wavelength.
    """
    work, reason = settled(scan, request)
    wavelength_m = work.pulse.wavelength_m
    pitch_m = spacing_m(work.capture)
    voxel_m = request.voxel_m or pitch_m / max(1, round(2 * pitch_m / wavelength_m))
    z_m = work.grid.z_m
    depth_m = request.depth_m or (float(z_m[0]), float(z_m[-1]), wavelength_m / PLANES)
    exact = replace(request, wavelength_m=wavelength_m, voxel_m=voxel_m, depth_m=depth_m)
    return chosen(scan, exact)[0], reason
