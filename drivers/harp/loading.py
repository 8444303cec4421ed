"""Finding the vendor's library on this computer.

The library is not ours to ship: it comes with the instrument.
"""

import ctypes
import os
import sys
from importlib.util import find_spec
from pathlib import Path

from drivers.errors import DeviceNotFoundError
from drivers.harp.library import HHLib

#: Environment variable that names the library file; where set, nothing else is tried.
PATH_VARIABLE = "HHLIB_PATH"


def load_library(path: Path | None = None) -> HHLib:
    """Load HHLib from the first place that has it.

    The order is ``$HHLIB_PATH``, the copy inside an installed ``snAPI`` package, the vendor's Linux
    installation, and on Windows ``hhlib64.dll``. A path that was asked for, by argument or by
    ``$HHLIB_PATH``, is never replaced by another.

    Parameters
    ----------
    path
        The library file; None to search.

    Returns
    -------
    HHLib
        The loaded library.

    Raises
    ------
    DeviceNotFoundError
        Where none of them could be loaded; it lists what was tried and why each failed.
    """
    tried = []
    for candidate in [str(path)] if path else candidates():
        try:
            return HHLib(_load(candidate), name=candidate)
        except OSError as error:
            tried.append(f"{candidate} ({error})")
        except DeviceNotFoundError as error:
            tried.append(f"{candidate} ({error.answered})")
    raise DeviceNotFoundError(
        "HydraHarp",
        "load the vendor's library HHLib",
        "nothing could be loaded from " + "; ".join(tried),
        f"Install HHLib 3.0, which comes with the instrument, or set {PATH_VARIABLE} to its file.",
    )


def candidates() -> list[str]:
    """Return the paths and names to try, first choice first."""
    chosen = os.environ.get(PATH_VARIABLE)
    if chosen:
        return [chosen]
    if sys.platform == "win32":
        return ["hhlib64.dll"]
    return [*_inside_snapi(), "/usr/local/lib64/hh400/hhlib.so", "libhh400.so"]


def _inside_snapi() -> list[str]:
    """Find snAPI's copy without importing snAPI, whose import loads a second vendor library globally.

    The file stays where it is, since it finds the bundled libusb relative to itself.
    """
    spec = find_spec("snAPI")
    places = spec.submodule_search_locations if spec else None
    return [str(Path(place) / "libhhlib.so") for place in places or ()]


def _load(path: str) -> ctypes.CDLL:
    if sys.platform == "win32":  # the vendor's library is stdcall there
        return ctypes.WinDLL(path)
    return ctypes.CDLL(path)
