"""Hidden scenes from mesh files."""

from pathlib import Path

import numpy as np

from simulators.scenes.mesh import Mesh, Scene

#: Endings of the files that can be read.
ENDINGS = (".obj", ".ply", ".stl")
#: Largest file: a million triangles take a quarter of it, and reading takes ten times it of memory.
MOST_BYTES = 200_000_000


def from_file(path: Path, albedo: float = 0.8) -> Scene:
    """Read a scene from an OBJ, PLY or STL file, in metres, in the wall's frame, placed as it is.

    Every object in the file becomes one mesh, Lambertian, of the same albedo; materials are not read.

    Raises
    ------
    ValueError
        If the file is missing or damaged, holds no surface, or all of it is behind the wall.
    ModuleNotFoundError
        If trimesh is not installed.
    """
    if not path.is_file():
        raise ValueError(f"{path}: there is no such file")
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
                f"{path}: a triangle has a corner that is none of its {len(part.vertices)} vertices"
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
    return built


def _check(built: Scene, path: Path) -> None:
    triangles_m = built.triangles_m
    if not len(triangles_m):
        raise ValueError(f"{path}: holds no triangles; export the scene as a surface of triangles")
    if not np.isfinite(triangles_m).all():
        raise ValueError(f"{path}: holds corners that are not finite numbers")
    edges = triangles_m[:, 1:] - triangles_m[:, :1]
    if not np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).any():
        raise ValueError(f"{path}: all {len(triangles_m)} triangles are degenerate, none has an area")
    low, high = triangles_m.min(axis=(0, 1)), triangles_m.max(axis=(0, 1))
    if high[2] <= 0:
        raise ValueError(
            f"{path}: all of it is behind the relay wall (z from {low[2]:g} to {high[2]:g} m); the room is "
            "at z > 0, in metres"
        )
    if low[2] > 100:
        raise ValueError(
            f"{path}: begins {low[2]:g} m from the relay wall, too far to be seen; meshes are in metres, so "
            "scale a file in millimetres by 0.001"
        )
