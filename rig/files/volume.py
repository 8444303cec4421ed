"""Volume files: the reconstructed image, and how it was made."""

import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.atomic import appearing, refusals_told
from rig.errors import DataFileError, RigError, UsageError
from rig.files.blocks import read
from rig.files.check import check_format, check_layout, open_hdf5, plain, reading
from rig.files.fresh import FreshFile
from rig.files.layout import VOLUME, VOLUME_VERSION
from rig.files.start import describe, storable, write_root

#: Steps of an axis that are smaller than its values by this are lost in rounding (2e-16 of a value).
FINEST_STEP = 1e12


@dataclass(frozen=True)
class Volume:
    """A reconstructed volume.

    Attributes
    ----------
    intensity
        (nz, ny, nx) |U|^2; for the transient camera (nt, nz, ny, nx) or (nt, ny, nx).
    x_m, y_m, z_m
        (nx,), (ny,), (nz,) voxel centres.
    depth_m
        (ny, nx) depth of the surface seen at each pixel, NaN where nothing; None where it was not made.
    confidence
        (ny, nx), 0 to 1: the probability that noise alone stays below what is brightest at each pixel; None
        where it was not made.
    t_s
        (nt,) times of the transient camera's frames.
    parameters
        Parameters of the reconstruction: what JSON can hold.
    scan, scan_digest
        Name and SHA-256 of the scan file it came from.
    command
        The command that made it; empty where nobody said.
    """

    intensity: NDArray[np.float32]
    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]
    z_m: NDArray[np.float64]
    depth_m: NDArray[np.float32] | None = None
    confidence: NDArray[np.float32] | None = None
    t_s: NDArray[np.float64] | None = None
    parameters: Mapping[str, Any] = field(default_factory=dict)
    scan: str = ""
    scan_digest: str = ""
    command: str = ""

    def problem(self) -> str:
        """Return what does not fit together, empty if all does."""
        shape = self.intensity.shape
        image = (len(self.y_m), len(self.x_m))
        if self.t_s is None:
            wanted: set[tuple[int, ...]] = {(len(self.z_m), *image)}
        else:
            wanted = {(len(self.t_s), len(self.z_m), *image), (len(self.t_s), *image)}
        if shape not in wanted:
            return f"intensity has shape {shape}, its axes say {' or '.join(map(str, sorted(wanted)))}"
        if self.depth_m is not None and self.depth_m.shape != image:
            return f"depth_m has shape {self.depth_m.shape}, its axes say {image}"
        if self.confidence is not None and self.confidence.shape != image:
            return f"confidence has shape {self.confidence.shape}, its axes say {image}"
        return ""


def write_volume(path: str | Path, volume: Volume) -> None:
    """Write a volume file, whole or not at all; an older volume file of this name is replaced.

    Raises
    ------
    UsageError
        If another kind of file has this name, or the folder does not exist.
    DataFileError
        If the file cannot be written.
    ValueError
        If the shapes of the volume do not fit together.
    """
    if problem := volume.problem():
        raise ValueError(problem)
    with _creating(Path(path)) as file:
        _write(file, volume)


@dataclass(frozen=True)
class VolumeOutline:
    """What a volume file says beside its image.

    Attributes
    ----------
    created, software
        When it was made, UTC, ISO 8601, and by which program; empty where it does not say.
    voxels
        Voxels along x, y and z.
    x_m, y_m, z_m
        First and last voxel centre along each axis.
    t_s
        (nt,) times of frames; None where it is no video.
    parameters, scan, scan_digest, command
        As of `Volume`.
    """

    created: str
    software: str
    voxels: tuple[int, int, int]
    x_m: tuple[float, float]
    y_m: tuple[float, float]
    z_m: tuple[float, float]
    t_s: NDArray[np.float64] | None
    parameters: Mapping[str, Any]
    scan: str
    scan_digest: str
    command: str


def outline_volume(path: Path) -> VolumeOutline:
    """Read what a volume file says beside its image; raises as `read_volume`."""
    with _opened(path) as file:
        group = file["volume"]
        axes = [read(group[name]).astype(float) for name in ("x_m", "y_m", "z_m")]
        ends = [(float(axis[0]), float(axis[-1])) for axis in axes]
        return VolumeOutline(
            created=str(plain(file.attrs.get("created", ""))),
            software=str(plain(file.attrs.get("software", ""))),
            voxels=(len(axes[0]), len(axes[1]), len(axes[2])),
            x_m=ends[0],
            y_m=ends[1],
            z_m=ends[2],
            t_s=read(group["t_s"]).astype(float) if "t_s" in group else None,
            parameters=dict(json.loads(plain(file.attrs.get("parameters", "{}")))),
            scan=str(plain(file.attrs.get("scan", ""))),
            scan_digest=str(plain(file.attrs.get("scan_digest", ""))),
            command=str(plain(file.attrs.get("command", ""))),
        )


@contextmanager
def _opened(path: Path) -> Iterator[h5py.File]:
    """Open a volume file, and hold it against its layout."""
    with open_hdf5(path) as file, reading(path):
        check_format(path, file, "rig-volume", (VOLUME_VERSION,))
        check_layout(path, file, VOLUME)
        yield file


@contextmanager
def volume_by_planes(path: str | Path, volume: Volume) -> Iterator[Callable[[Any, NDArray], None]]:
    """Write a video of all voxels plane by plane; it need never be in memory as a whole.

    Parameters
    ----------
    path
        The file, which appears when the block ends well.
    volume
        All but the intensity, of which it holds the front view, (nt, ny, nx).

    Yields
    ------
    callable
        Takes a place in (nt, nz, ny, nx) and the values there.

    Raises
    ------
    As of `write_volume`.
    """
    if volume.t_s is None or volume.intensity.ndim != 3:
        raise ValueError("only a transient camera's video has planes at several moments")
    if problem := volume.problem():
        raise ValueError(problem)
    with _creating(Path(path)) as file:
        _write(file, volume)
        del file["volume/intensity"]
        shape = (len(volume.t_s), len(volume.z_m), len(volume.y_m), len(volume.x_m))
        intensity = file["volume"].create_dataset("intensity", shape, "<f4")

        def put(place: Any, values: NDArray) -> None:
            intensity[place] = values
            file.require_taken()

        yield put
        describe(file, VOLUME)


def require_replaceable(path: Path) -> None:
    """Refuse, before a volume is computed, the name of what is there and is none.

    Raises
    ------
    UsageError
        If it is so: a volume replaces volumes alone.
    """
    if os.path.lexists(path) and not is_volume(path):
        raise UsageError(f"{path} exists, is no volume, and is not overwritten by one; give another name")


@contextmanager
def _creating(path: Path) -> Iterator[FreshFile]:
    """Give a new volume file, to be filled; what is no volume is not replaced by it."""
    if path.exists() and not path.is_file():
        raise UsageError(f"{path} exists and is no file; it is not overwritten. Give another name")
    replaces = path.exists() and is_volume(path)
    with refusals_told(path), appearing(path, replaces=replaces) as partial, FreshFile(partial) as file:
        yield file


def read_volume(path: str | Path) -> Volume:
    """Read a volume file.

    Raises
    ------
    DataFileError
        If the file is missing, truncated, foreign, or lacks what is needed.
    """
    path = Path(path)
    with _opened(path) as file:
        group = file["volume"]
        volume = Volume(
            intensity=read(group["intensity"]).astype(np.float32, copy=False),
            x_m=read(group["x_m"]).astype(float),
            y_m=read(group["y_m"]).astype(float),
            z_m=read(group["z_m"]).astype(float),
            depth_m=_maybe(group, "depth_m"),
            confidence=_maybe(group, "confidence"),
            t_s=read(group["t_s"]).astype(float) if "t_s" in group else None,
            parameters=dict(json.loads(plain(file.attrs.get("parameters", "{}")))),
            scan=plain(file.attrs.get("scan", "")),
            scan_digest=plain(file.attrs.get("scan_digest", "")),
            command=str(plain(file.attrs.get("command", ""))),
        )
    if problem := volume.problem() or _uneven(volume) or _no_intensity(volume):
        raise DataFileError(f"{path} is not consistent: {problem}; make it again with 'rig recon'")
    return volume


def _uneven(volume: Volume) -> str:
    """Return which axis cannot be one, empty if all can."""
    axes = {"x_m": volume.x_m, "y_m": volume.y_m, "z_m": volume.z_m}
    if volume.t_s is not None:
        axes["t_s"] = volume.t_s
    for name, values in axes.items():
        if not values.size or not np.isfinite(values).all() or (np.diff(values) <= 0).any():
            return f"{name} is empty, or its values are not finite and increasing"
        if len(values) > 1 and np.abs(values).max() > FINEST_STEP * np.diff(values).min():
            return (
                f"{name} has a step of {np.diff(values).min():g}, which is too small compared with its values"
            )
    return ""


def _no_intensity(volume: Volume) -> str:
    """Return why values cannot be intensities, empty if they can."""
    return "" if np.isfinite(volume.intensity).all() else "intensity has values that are not finite"


def _maybe(group: h5py.Group, name: str) -> NDArray[np.float32] | None:
    return read(group[name]).astype(np.float32) if name in group else None


def is_volume(path: Path) -> bool:
    """Return whether the file is one of this program's volumes."""
    try:
        with open_hdf5(path) as file:
            return bool(plain(file.attrs.get("format")) == "rig-volume")
    except (RigError, OSError, RuntimeError):
        return False


def _write(file: h5py.File, volume: Volume) -> None:
    write_root(file, "rig-volume", VOLUME_VERSION)
    file.attrs["parameters"] = json.dumps(dict(volume.parameters))
    file.attrs["scan"] = volume.scan
    file.attrs["command"] = storable(volume.command)
    file.attrs["scan_digest"] = volume.scan_digest
    group = file.create_group("volume")
    group["intensity"] = np.asarray(volume.intensity, "<f4")
    for name in ("x_m", "y_m", "z_m"):
        group[name] = np.asarray(getattr(volume, name), "<f8")
    if volume.t_s is not None:
        group["t_s"] = np.asarray(volume.t_s, "<f8")
    for name in ("depth_m", "confidence"):
        if (image := getattr(volume, name)) is not None:
            group[name] = np.asarray(image, "<f4")
    describe(file, VOLUME)
