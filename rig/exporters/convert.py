"""From a scan or volume file to a file of another layout, which its ending names."""

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

from rig.atomic import appearing, refusals_told
from rig.errors import UsageError
from rig.exporters import glb, mat, npz, page, ply, ptu, tal, tiff, transients_mat, vti
from rig.files import ScanFile, Volume, read_volume
from rig.files.volume import is_volume

#: Layouts of a volume: modules with NAME, ENDINGS and write(path, volume).
VOLUME_LAYOUTS: tuple[ModuleType, ...] = (npz, mat, vti, tiff, page, ply, glb)
#: Layouts of transients: modules with NAME, ENDINGS and write(path, scan, rectify).
SCAN_LAYOUTS: tuple[ModuleType, ...] = (tal, transients_mat, ptu)


def export(
    source: str | Path,
    target: str | Path,
    rectify: bool = False,
    tell: Callable[[str], None] = lambda sentence: None,
    replace: bool = False,
) -> str:
    """Write a scan or volume file in another layout, whole or not at all.

    Parameters
    ----------
    source
        A scan or volume file of this program.
    target
        The file to make; its ending names the layout.
    rectify
        Whether a scan's time is to begin when the pulse is on the wall, for all positions.
    tell
        Told what a person must know of a scan that is not, or no longer, as its program left it.
    replace
        Whether a file that has this name is replaced.

    Returns
    -------
    str
        Name of the layout.

    Raises
    ------
    UsageError
        If the ending is not known for this kind of file, ``target`` exists, the layout cannot hold what the
        file holds, or a volume is to be rectified.
    DataFileError
        If ``source`` cannot be read, or ``target`` not be written.
    """
    source, target = Path(source), Path(target)
    if target.exists() and not replace:
        raise UsageError(f"{target} exists and is not overwritten; give another name, or move it away")
    if is_volume(source):
        if rectify:
            raise UsageError(f"{source} is a volume; --rectified is for scans. Leave it out")
        return write_volume_as(read_volume(source), target, replaces=replace)
    with ScanFile(source) as scan:
        layout = _by_ending(target, SCAN_LAYOUTS, "a scan")
        for sentence in scan.doubts:
            tell(sentence)
        _write(target, lambda partial: layout.write(partial, scan, rectify), replaces=replace)
    return str(layout.NAME)


def write_volume_as(volume: Volume, target: Path, *, replaces: bool) -> str:
    """Write a volume in the layout that the ending names, whole or not at all; return the layout's name.

    ``replaces`` says whether a file that has this name is replaced; if not, it is written beside it.

    Raises
    ------
    UsageError
        If the ending is not known for volumes, the layout cannot hold what the volume holds, or it was
        written beside another file.
    DataFileError
        If ``target`` cannot be written.
    """
    layout = _by_ending(target, VOLUME_LAYOUTS, "a volume")
    _write(target, lambda partial: layout.write(partial, volume), replaces=replaces)
    return str(layout.NAME)


def _by_ending(target: Path, layouts: tuple[ModuleType, ...], what: str) -> ModuleType:
    ending = target.suffix.lower()
    for layout in layouts:
        if ending in layout.ENDINGS:
            return layout
    known = "; ".join(f"{', '.join(layout.ENDINGS)} ({layout.NAME})" for layout in layouts)
    raise UsageError(f"{target}: {what} cannot be written as '{ending}'; its endings are {known}")


def _write(target: Path, write: Callable[[Path], None], *, replaces: bool) -> None:
    with refusals_told(target), appearing(target, replaces=replaces) as partial:
        write(partial)
