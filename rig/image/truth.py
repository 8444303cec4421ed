"""What is really there: the first surface along +z, from a file or a scene of the simulator."""

from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from recon.measures import sampled_depth, surface_of_mesh, surface_of_voxels
from rig.bench.simulated import hidden_scene, mesh_is_as_it_was, mesh_triangles_m, scene_depth
from rig.errors import DataFileError, UsageError, in_a_line, no_file, reason
from rig.files import ScanFile, read_volume
from rig.files.blocks import read
from rig.files.check import open_hdf5, plain, reading
from rig.files.outline import ScanOutline
from rig.model.config.simulation import MESH_ENDINGS
from rig.model.npz import read_npz


def true_depth(source: str, x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Read a truth and return its depth at the points of two axes.

    Parameters
    ----------
    source
        ``scene:NAME``, a scene of the simulator, or ``scene:NAME@10cm,0cm,0cm``, moved so far; or a file:
        HDF5 with the group ``truth`` (``depth_m`` (y, x) with ``x_m`` and ``y_m``, or ``geometry/NAME`` with
        ``vertices_m`` and ``faces``); a volume file; a scan of the simulated rig, whose scene it is; ``.npz``
        with ``depth_m`` (y, x), or ``occupied`` (z, y, x) and ``z_m``, with ``x_m`` and ``y_m``; a triangle
        mesh as OBJ, PLY or STL, in metres and in the wall's frame.
    x_m, y_m
        Pixel centres, ascending.

    Returns
    -------
    ndarray
        (y, x) [m], NaN where nothing is.

    Raises
    ------
    UsageError
        If the scene or the kind of file is not known, or the library that reads meshes is not installed.
    DataFileError
        If the file is damaged or lacks what is needed.
    """
    if source.startswith("scene:"):
        return scene_depth(source.removeprefix("scene:"), x_m, y_m)
    path = Path(source)
    if not path.is_file():
        raise DataFileError(no_file(path, "a truth is a file, or scene:NAME for a simulated scene"))
    if _is_mesh(source):
        return surface_of_mesh(mesh_triangles_m(path), x_m, y_m)
    if path.suffix.lower() == ".npz":
        return _from_npz(path, x_m, y_m)
    if h5py.is_hdf5(path):
        return _from_hdf5(path, x_m, y_m)
    raise UsageError(
        f"{path} is not a truth that can be read: give HDF5, .npz, {', '.join(MESH_ENDINGS)}, or scene:NAME"
    )


def known_truth(path: Path, scan: ScanFile) -> str | None:
    """Return the truth that a file holds or names itself, as `true_depth` takes it; None where it does not.

    Parameters
    ----------
    path
        A scan, or the file that it was imported from; it may have the group ``truth``.
    scan
        The scan; a simulated one tells its scene.
    """
    if not scan.growing and h5py.is_hdf5(path):  # what a scan writes now has no truth
        with open_hdf5(path) as file, reading(path):
            truth = file.get("truth", {})
            if {"depth_m", "x_m", "y_m"} <= set(truth) or "geometry" in truth:
                return str(path)
    config = scan.config if scan.simulated else None
    if config is None or config.simulation is None:
        return None
    simulation = config.simulation
    if simulation.motion is not None:  # it is at many places, one after the other
        return None
    if simulation.mesh is None:
        return f"scene:{simulation.scene}"
    # where it was is said by the scan alone, and which mesh it was by its digest
    known = bool(simulation.mesh_sha256) and simulation.mesh.is_file()
    return str(scan.path) if known and mesh_is_as_it_was(simulation) else None


def _is_mesh(name: str) -> bool:
    return Path(name).suffix.lower() in MESH_ENDINGS


def _from_npz(path: Path, x_m: NDArray, y_m: NDArray) -> NDArray[np.float64]:
    try:
        arrays = read_npz(path)
    except (OSError, ValueError) as error:
        raise DataFileError(f"{path} cannot be read: {reason(error)}") from error
    _needed(path, arrays, "x_m", "y_m")
    if "depth_m" in arrays:
        depth_m = arrays["depth_m"]
    else:
        _needed(path, arrays, "occupied", "z_m")
        occupied, z_m = arrays["occupied"].astype(bool), arrays["z_m"]
        if occupied.ndim != 3 or len(occupied) != len(z_m):
            raise DataFileError(f"{path}: occupied {occupied.shape} and z_m {z_m.shape} are not consistent")
        depth_m = surface_of_voxels(occupied, z_m)
    return _sampled(path, depth_m, arrays["x_m"], arrays["y_m"], x_m, y_m)


def _from_hdf5(path: Path, x_m: NDArray, y_m: NDArray) -> NDArray[np.float64]:
    with open_hdf5(path) as file, reading(path):
        if plain(file.attrs.get("format")) == "rig-volume":
            volume = read_volume(path)
            if volume.depth_m is None:
                raise DataFileError(f"{path} is a volume without a depth map; it cannot serve as a truth")
            return _sampled(path, volume.depth_m, volume.x_m, volume.y_m, x_m, y_m)
        truth = file.get("truth", {})
        if not truth and plain(file.attrs.get("format")) == "rig-scan":
            return _of_scan(path, x_m, y_m)
        if {"depth_m", "x_m", "y_m"} <= set(truth):
            depth_m, of_x_m, of_y_m = (read(truth[name]) for name in ("depth_m", "x_m", "y_m"))
            return _sampled(path, depth_m, of_x_m, of_y_m, x_m, y_m)
        triangles_m = [
            read(mesh["vertices_m"]).astype(float)[read(mesh["faces"])]
            for mesh in truth.get("geometry", {}).values()
        ]
    if not triangles_m:
        raise DataFileError(f"{path} has no group 'truth' with depth_m, x_m and y_m, or with geometry")
    return surface_of_mesh(np.concatenate(triangles_m), x_m, y_m)


def _of_scan(path: Path, x_m: NDArray, y_m: NDArray) -> NDArray[np.float64]:
    """Return the depth of the scene that a simulated scan had."""
    with ScanOutline(path) as scan:
        config = scan.config if scan.simulated else None
    simulation = config.simulation if config else None
    if config is None or simulation is None or simulation.motion is not None:
        raise DataFileError(f"{path} is not a scan of a simulated scene at rest; it cannot serve as a truth")
    return hidden_scene(config).depth_map(x_m, y_m)


def _needed(path: Path, arrays: dict[str, NDArray], *names: str) -> None:
    missing = [name for name in names if name not in arrays]
    if missing:
        held = ", ".join(map(in_a_line, arrays)) or "nothing"
        raise DataFileError(
            f"{path} lacks {', '.join(missing)}; it holds {held}. A truth has "
            "depth_m (y, x), or occupied (z, y, x) and z_m, with x_m and y_m"
        )


def _sampled(
    path: Path, depth_m: NDArray, of_x_m: NDArray, of_y_m: NDArray, x_m: NDArray, y_m: NDArray
) -> NDArray[np.float64]:
    if depth_m.shape != (np.size(of_y_m), np.size(of_x_m)):
        raise DataFileError(
            f"{path}: depth_m has shape {depth_m.shape}, its axes say {(np.size(of_y_m), np.size(of_x_m))}"
        )
    return sampled_depth(depth_m, of_x_m.astype(float), of_y_m.astype(float), x_m, y_m)
