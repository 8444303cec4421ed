"""The surface of a volume's depth map as triangles, in metres of our frame, which is right-handed with y up.

A pixel that shows a surface is a vertex. Neighbours are joined where their depths differ by no more than
`STEEPEST` times their distance: more is an edge with nothing between, not a slope.
"""

from dataclasses import dataclass

import numpy as np
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.exporters.arrays import pitches_m
from rig.files import Volume
from rig.model.colours import DEPTH_COLOURS

#: Greatest rise of a surface by its run, 72 degrees.
STEEPEST = 3.0


@dataclass(frozen=True)
class Mesh:
    """Triangles.

    Attributes
    ----------
    vertices_m
        (n, 3) float32 x, y, z.
    normals
        (n, 3) float32 unit vectors, towards the wall.
    colours
        (n, 3) uint8, by depth, as in pictures.
    faces
        (m, 3) uint32 vertices, counter-clockwise as seen from the wall.
    """

    vertices_m: NDArray[np.float32]
    normals: NDArray[np.float32]
    colours: NDArray[np.uint8]
    faces: NDArray[np.uint32]


def surface_mesh(volume: Volume) -> Mesh:
    """Return the surface that a volume's depth map shows.

    Raises
    ------
    UsageError
        If the volume has no depth map, sees no surface, or is not evenly spaced.
    """
    if volume.depth_m is None:
        raise UsageError("the volume has no depth map, and so no surface; image it with the confocal camera")
    seen = np.isfinite(volume.depth_m)
    if not seen.any():
        raise UsageError("the volume shows no surface above noise, so there is nothing to write")
    pitch_m = pitches_m(volume)[:2]
    x_m, y_m = np.meshgrid(volume.x_m, volume.y_m)
    vertices_m = np.stack([x_m[seen], y_m[seen], volume.depth_m[seen]], axis=1)
    number = np.full(seen.shape, -1)
    number[seen] = np.arange(len(vertices_m))
    faces = _faces(volume.depth_m, number, pitch_m)
    low_m, high_m = vertices_m[:, 2].min(), vertices_m[:, 2].max()
    colours = DEPTH_COLOURS(Normalize(low_m, max(high_m, low_m + 1e-6))(vertices_m[:, 2]), bytes=True)[:, :3]
    return Mesh(
        vertices_m.astype(np.float32), _normals(vertices_m, faces), np.ascontiguousarray(colours), faces
    )


def _faces(
    depth_m: NDArray[np.float32], number: NDArray[np.intp], pitch_m: tuple[float, float]
) -> NDArray[np.uint32]:
    """Join neighbours: two triangles for a square of four, one where three of them belong together.

    The corners of a square, counter-clockwise for one who looks along +z with y up and x to the left.
    """
    low, high = slice(-1), slice(1, None)
    corners = [(low, low), (high, low), (high, high), (low, high)]  # (y, x)
    at = [depth_m[corner] for corner in corners]
    who = [number[corner] for corner in corners]
    limit_m = [STEEPEST * side for side in (pitch_m[1], pitch_m[0], np.hypot(*pitch_m))]

    def joined(i: int, j: int) -> NDArray[np.bool_]:
        along = 2 if abs(i - j) == 2 else 0 if {i, j} in ({0, 1}, {2, 3}) else 1
        with np.errstate(invalid="ignore"):
            return np.abs(at[i] - at[j]) <= limit_m[along]  # never where one of them shows nothing

    def triangle(i: int, j: int, k: int) -> NDArray[np.bool_]:
        return joined(i, j) & joined(j, k) & joined(i, k)

    first, second = triangle(0, 1, 2), triangle(0, 2, 3)
    # where the one diagonal joins nothing, the other may
    other = ~(first | second)
    found = [
        np.stack([who[corner][where] for corner in picked], axis=1)
        for picked, where in (
            ((0, 1, 2), first),
            ((0, 2, 3), second),
            ((0, 1, 3), other & triangle(0, 1, 3)),
            ((1, 2, 3), other & triangle(1, 2, 3)),
        )
    ]
    return np.concatenate(found).astype(np.uint32)


def _normals(vertices_m: NDArray[np.float64], faces: NDArray[np.uint32]) -> NDArray[np.float32]:
    """Return the mean normal of a vertex's triangles, by their areas; of a lone vertex, towards the wall."""
    a, b, c = (vertices_m[faces[:, corner]] for corner in range(3))
    of_faces = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices_m, dtype=np.float64)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], of_faces)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    towards_wall = np.array([0.0, 0.0, -1.0])
    normals = np.divide(normals, lengths, out=np.tile(towards_wall, (len(normals), 1)), where=lengths > 0)
    return normals.astype(np.float32)
