"""Good files of the layouts that other programs write, as HDF5 where they may be: what is spoiled of them."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import scipy.io

from rig.importers import import_scan
from support.layout_examples import EXAMPLES
from support.layout_files import matlab

#: Layouts by the ends of the attacks' names.
_NAMES = {
    "neutral": "neutral HDF5",
    "znlos": "Zaragoza Z-NLOS",
    "liu2019": "Liu 2019, phasor field",
    "liu2020": "Liu 2020, diffraction",
    "lct": "O'Toole 2018, LCT",
    "lindell2019": "Lindell 2019, f-k",
    "ahn": "Ahn 2019",
    "xiao": "Xiao, 18 m stand-off",
    "wu2021": "Wu 2021, 1.43 km stand-off",
    "cc-socr": "Liu 2023, CC-SOCR",
    "cc-socr-cube": "Liu 2023, CC-SOCR with setup",
    "general-raw": "general-NLOS, raw",
    "rsd3d": "Gu 2023, 3D-RSD",
    "aligned": "aligned f-k (NLOST)",
    "cmu": "Tsai 2019, CMU",
    "dlct": "Young 2020, D-LCT",
    "dirac": "NLOS-DIRAC",
    "histograms": "PicoQuant histograms",
}
#: Those that MATLAB v5 alone has.
_V5 = {"ahn"}


def parsers() -> dict[str, tuple[Callable[[Path], Path], Callable[[Path], object]]]:
    """Return by name what makes a good file, and what reads any."""
    found = {}
    for name, layout in _NAMES.items():
        make, given = EXAMPLES[layout]
        found[f"import-{name}"] = make if name in _V5 else partial(_in_hdf5, make), partial(_read, given)
    return found


def _in_hdf5(make: Callable[[Path], Path], folder: Path) -> Path:
    """Make an example, and write its files of MATLAB v5 as v7.3."""
    good = make(folder)
    for path in folder.glob("*.mat"):
        if h5py.is_hdf5(path):
            continue
        variables = {
            name: value for name, value in scipy.io.loadmat(path).items() if not name.startswith("__")
        }
        matlab(path, 7.3, **{name: value for name, value in variables.items() if not value.dtype.names})
        with h5py.File(path, "r+") as file:
            for name, struct in variables.items():
                for field in struct.dtype.names or ():
                    file[f"{name}/{field}"] = np.atleast_2d(struct[field].ravel()[0]).T
    return good


def _read(given: dict, path: Path) -> None:
    import_scan(path, path.with_suffix(".imported"), **given)
