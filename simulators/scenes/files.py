"""Hidden scenes from mesh files."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simulators.scenes.mesh import Mesh, Point, Scene

#: Endings of the files that can be read.
ENDINGS = (".obj", ".ply", ".stl")
#: What is no farther from the wall lies on it.
ON_THE_WALL_M = 1e-9
#: Largest file: a million triangles take a quarter of it, and reading takes ten times it of memory.
MOST_BYTES = 200_000_000


@dataclass(frozen=True)
class Placement:
    """How what a file holds is put before the wall: scaled, then turned, then moved.

    Attributes
    ----------
    centre_m
        Where the middle of its bounding box comes to lie; None leaves it where it is.
    rotation_rad
        Turns about x, then y, then z, about that middle; right-handed.
    scale
        By which its coordinates are multiplied: 0.001 of a file in millimetres.
    """

    centre_m: Point | None = None
    rotation_rad: Point = (0.0, 0.0, 0.0)
    scale: float = 1.0

    def placed(self, scene: Scene) -> Scene:
        """Return a scene, placed."""
        from scipy.spatial.transform import Rotation  # the scenes of the program itself need no turning

        triangles_m = scene.triangles_m
        turn = Rotation.from_euler("xyz", self.rotation_rad).as_matrix().round(12)  # quarter turns are exact
        middle_m = _middle(triangles_m)
        turned_m = (triangles_m - middle_m) @ turn.T * self.scale
        begin_m = self.scale * middle_m
        shift_m = begin_m if self.centre_m is None else np.array(self.centre_m) - _middle(turned_m)
        return Scene(
            scene.name,
            tuple(
                replace(
                    mesh,
                    vertices_m=(np.asarray(mesh.vertices_m, np.float64) - middle_m) @ turn.T * self.scale
                    + shift_m,
                )
                for mesh in scene.meshes
            ),
        )


def _middle(triangles_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the middle of a bounding box."""
    return np.asarray((triangles_m.min(axis=(0, 1)) + triangles_m.max(axis=(0, 1))) / 2)


def from_file(path: Path, albedo: float = 0.8, placement: Placement | None = None) -> Scene:
    """Read a scene from an OBJ, PLY or STL file, in metres, in the wall's frame, placed as asked.

    Every object in the file becomes one mesh, Lambertian, of the same albedo; materials are not read.

    Raises
    ------
    ValueError
        If the file is missing or damaged, holds no surface, or all of it is behind the wall.
    ModuleNotFoundError
        If trimesh is not installed.
    """
    if not path.is_file():
        raise ValueError(f"{path}: {'is not a file' if path.exists() else 'there is no such file'}")
    try:
        import trimesh
    except ModuleNotFoundError:
        raise ModuleNotFoundError(
            f"{path}: reading meshes needs trimesh; install it with pip install trimesh"
        ) from None
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise ValueError(
            f"{path}: has {size / 1e6:.0f} MB, a scene at most {MOST_BYTES / 1e6:.0f}; simplify it"
        )
    quiet = trimesh.util.log
    told, quiet.disabled = quiet.disabled, True  # it logs tracebacks of what it tries, and then raises
    try:
        loaded = trimesh.load_scene(path, process=False, split_objects=True)
        parts = [part for part in loaded.dump() if isinstance(part, trimesh.Trimesh) and len(part.faces)]
    except Exception as error:  # trimesh raises whatever its parsers meet
        raise ValueError(
            f"{path}: cannot be read as {path.suffix[1:].upper()} ({type(error).__name__}: {error})"
        ) from None
    finally:
        quiet.disabled = told
    for part in parts:
        if part.faces.min() < 0 or part.faces.max() >= len(part.vertices):
            raise ValueError(
                f"{path}: a triangle has a corner that is not among its {len(part.vertices)} vertices"
            )
    meshes = tuple(
        Mesh(
            str(part.metadata.get("name") or f"{path.stem}_{number}"),
            np.array(part.vertices, dtype=np.float64),
            np.array(part.faces, dtype=np.int64),
            albedo,
        )
        for number, part in enumerate(parts)
    )
    built = Scene(path.name, meshes)
    _check(built, path)
    placed = placement.placed(built) if placement else built
    _check_place(placed, path)
    return placed


def _check(built: Scene, path: Path) -> None:
    triangles_m = built.triangles_m
    if not len(triangles_m):
        raise ValueError(f"{path}: holds no triangles; export the scene as a surface of triangles")
    if not np.isfinite(triangles_m).all():
        raise ValueError(f"{path}: holds corners that are not finite numbers")
    edges = triangles_m[:, 1:] - triangles_m[:, :1]
    if not np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).any():
        raise ValueError(f"{path}: all {len(triangles_m)} triangles are degenerate, none has an area")


def _check_place(placed: Scene, path: Path) -> None:
    triangles_m = placed.triangles_m
    low, high = triangles_m.min(axis=(0, 1)), triangles_m.max(axis=(0, 1))
    if high[2] <= ON_THE_WALL_M:
        raise ValueError(
            f"{path}: all of it is on or behind the relay wall (z from {low[2]:g} to {high[2]:g} m); the "
            "room is at z > 0, in metres: place its centre there"
        )
    if low[2] > 100:
        raise ValueError(
            f"{path}: begins {low[2]:g} m from the relay wall, too far to be seen; meshes are in metres, so "
            "scale a file in millimetres by 0.001"
        )
