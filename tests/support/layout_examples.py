"""A small file of each layout that can be imported, and what must be given with it."""

import h5py
import numpy as np
import scipy.io

from support.layout_files import lct, liu2019, matlab, tal, znlos
from support.picoquant_files import phu, ptu, records_of, scan_events

GRID_M = np.array([[x, y, 0.0] for x in (-0.2, 0.0, 0.2) for y in (-0.15, 0.0, 0.15)])
CUBE = np.random.default_rng(3).poisson(3.0, (3, 3, 8)).astype(float)
BIN = {"bin_width_s": 32e-12}
WALL = {"wall_size_m": 0.5}
PLAN = {"grid": (3, 3), "spacing_m": 0.03, "detector": (0.1, 0.2)}


def _neutral(folder):
    with h5py.File(folder / "a.h5", "w") as file:
        file["counts"] = CUBE.reshape(9, 8).astype("u2")
        file["laser_position_m"], file["detector_position_m"] = GRID_M, GRID_M[:1]
        file["time_s"] = 32e-12 * (np.arange(8) + 0.5)
        file.attrs["time_origin"] = "wall"
    return folder / "a.h5"


def _tal(folder):
    tal(folder / "a.hdf5")
    return folder / "a.hdf5"


def _znlos(folder):
    znlos(folder / "a.hdf5", (1, 6, 4, 2, 5), turned=False)
    return folder / "a.hdf5"


def _liu2019(folder):
    liu2019(folder / "a.mat")
    return folder / "a.mat"


def _lct(folder):
    return lct(folder / "a.mat")


def _mat(folder, name="a.mat", **variables):
    matlab(folder / name, 5, **variables)
    return folder / name


def _liu2020(folder):
    return _mat(folder, rect_data=CUBE, ts=4e-12, SPAD_index=[1, 2], sampling_spacing=0.01)


def _lindell2019(folder):
    _mat(folder, "tof.mat", tofgrid=np.full((3, 3), 100.0))
    return _mat(folder, meas=CUBE)


def _ahn(folder):
    struct = {
        "transient": CUBE,
        "l": GRID_M,
        "s": GRID_M,
        "times": 0.01 * np.arange(8),
        "delta": 0.01,
    }
    return _mat(folder, NLOSDATA=struct)


def _xiao(folder):
    return _mat(folder, sig=CUBE)


def _wu2021(folder):
    return _mat(folder, sig_in=CUBE, timeRes=4e-12, width=0.3)


def _cc_socr(folder):
    index = np.array([[0, x, y] for x in range(3) for y in range(3)])
    for name in ("C_i", "C_d"):
        _mat(folder, f"{name}.mat", **{name: index})
    return _mat(folder, "sub_Sig.mat", sub_Sig=CUBE.reshape(9, 8))


def _cc_socr_cube(folder):
    points_m = GRID_M.reshape(3, 3, 3)
    scipy.io.savemat(folder / "setup.mat", {"laserpoints": points_m, "detectpoints": points_m})
    return _mat(folder, "data.mat", data=CUBE)


def _aligned(folder):
    return _mat(folder, final_meas=CUBE)


def _cmu(folder):
    return _mat(folder, transient=CUBE.reshape(9, 8), lighting=GRID_M)


def _dlct(folder):
    scipy.io.savemat(folder / "a.mat", {"nlos": {"Data": CUBE, "DeltaT": 0.01, "CameraGridSize": 0.4}})
    return folder / "a.mat"


def _dirac(folder):
    with h5py.File(folder / "a.hdf5", "w") as file:
        file["data_t"] = np.moveaxis(CUBE, 2, 0)
        file["xg"], file["yg"] = GRID_M[:, 0].reshape(3, 3), GRID_M[:, 1].reshape(3, 3)
        file["da"], file["offset_laser"] = 0.01 * np.arange(8), 1.0
    return folder / "a.hdf5"


def _rsd3d(folder):
    places = {"camera_pos": GRID_M, "laser_pos_base": np.array([[0.1, 0.0, 0.0]])}
    return _mat(folder, total_rect_data=CUBE.reshape(9, 8), ts=4e-12, **places)


def _general_raw(folder):
    places = {"laserpoints": GRID_M.reshape(3, 3, 3), "detectpoints": GRID_M.reshape(3, 3, 3)}
    _mat(folder, "setup.mat", **places)
    for name in ("peak1", "peak2"):
        _mat(folder, f"{name}.mat", **{name: np.ones((3, 3))})
    return _mat(folder, counts=CUBE.reshape(9, 8))


def _ptu(folder):
    return ptu(folder / "a.ptu", records_of(scan_events(9, 20)))


def _phu(folder):
    return phu(folder / "a.phu", CUBE.reshape(9, 8))


#: By the layout's name: what writes a file into a folder and returns its path; what must be given with it.
EXAMPLES = {
    "neutral HDF5": (_neutral, {}),
    "TAL": (_tal, {}),
    "Zaragoza Z-NLOS": (_znlos, {}),
    "Liu 2019, phasor field": (_liu2019, {}),
    "Liu 2020, diffraction": (_liu2020, {}),
    "O'Toole 2018, LCT": (_lct, BIN),
    "Lindell 2019, f-k": (_lindell2019, BIN | WALL),
    "Ahn 2019": (_ahn, {}),
    "Xiao, 18 m stand-off": (_xiao, BIN | WALL),
    "Wu 2021, 1.43 km stand-off": (_wu2021, {}),
    "Liu 2023, CC-SOCR": (_cc_socr, BIN | WALL),
    "Liu 2023, CC-SOCR with setup": (_cc_socr_cube, BIN),
    "general-NLOS, raw": (_general_raw, BIN),
    "Gu 2023, 3D-RSD": (_rsd3d, {}),
    "aligned f-k (NLOST)": (_aligned, BIN | WALL),
    "Tsai 2019, CMU": (_cmu, BIN),
    "Young 2020, D-LCT": (_dlct, {}),
    "NLOS-DIRAC": (_dirac, {}),
    "PicoQuant records": (_ptu, PLAN | {"point_marker": 1}),
    "PicoQuant histograms": (_phu, PLAN),
}
