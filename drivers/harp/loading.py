"""Finding the vendor's library on this computer.

The library is not ours to ship: it comes with the instrument.
"""

import ctypes
import os
import sys
from importlib.util import find_spec
from pathlib import Path

from drivers.errors import DeviceNotFoundError
from drivers.harp.family import Family
from drivers.harp.library import HarpLibrary


def load_library(family: Family, path: Path | None = None) -> HarpLibrary:
    """Load a family's library from the first place that has it.

    The order is the family's environment variable (``$HHLIB_PATH`` of a HydraHarp 400), the copy inside an
    installed ``snAPI`` package, the vendor's Linux installation, and on Windows the vendor's DLL. A path that
    was asked for, by argument or by the variable, is never replaced by another.

    Parameters
    ----------
    family
        Which library.
    path
        The library file; None to search.

    Returns
    -------
    HarpLibrary
        The loaded library.

    Raises
    ------
    DeviceNotFoundError
        Where none of them could be loaded; it lists what was tried and why each failed.
    """
    tried = []
    for candidate in [str(path)] if path else candidates(family):
        try:
            return HarpLibrary(_load(candidate), family, name=candidate)
        except OSError as error:
            tried.append(f"{candidate} ({error})")
        except DeviceNotFoundError as error:
            tried.append(f"{candidate} ({error.answered})")
    raise DeviceNotFoundError(
        family.name,
        f"load the vendor's library {family.library}",
        "nothing could be loaded from " + "; ".join(tried),
        f"Install {family.library} {family.versions[-1]}, which comes with the instrument, or set "
        f"{family.files.variable} to its file.",
    )


def candidates(family: Family) -> list[str]:
    """Return the paths and names to try, first choice first."""
    files = family.files
    chosen = os.environ.get(files.variable)
    if chosen:
        return [chosen]
    if sys.platform == "win32":
        return [files.windows]
    return [*_inside_snapi(files.in_snapi), *files.linux]


def _inside_snapi(file: str) -> list[str]:
    """Find snAPI's copy without importing snAPI, whose import loads a second vendor library globally.

    The file stays where it is, since it finds the bundled libusb relative to itself.
    """
    spec = find_spec("snAPI")
    places = spec.submodule_search_locations if spec else None
    return [str(Path(place) / file) for place in places or ()]


def _load(path: str) -> ctypes.CDLL:
    if sys.platform == "win32":  # the vendor's library is stdcall there
        return ctypes.WinDLL(path)
    return ctypes.CDLL(path)
