"""Surfaces cut into patches so small that light may be taken at their centres."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from simulators.scenes import Scene

#: Longest edge of a patch [m]; halving leaves right triangles with legs of about 1 cm.
PATCH_EDGE_M = 0.02


class Patches(NamedTuple):
    """Small flat triangles, K of them.

    Attributes
    ----------
    corners_m
        (K, 3, 3) corners [m].
    centre_m
        (K, 3) centroids [m].
    normal
        (K, 3) unit normals; both sides reflect, so the sign means nothing by itself.
    area_m2
        (K,) areas [m^2].
    albedo
        (K,) fraction of light reflected.
    triangle
        (K,) which triangle of the scene each was cut from.
    """

    corners_m: NDArray[np.float64]
    centre_m: NDArray[np.float64]
    normal: NDArray[np.float64]
    area_m2: NDArray[np.float64]
    albedo: NDArray[np.float64]
    triangle: NDArray[np.int64]


def subdivide(
    triangles_m: NDArray[np.float64], edge_m: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Halve triangles across their longest edge until no edge is longer than ``edge_m``.

    Halving across the longest edge makes no slivers, however long and thin a triangle is.

    Parameters
    ----------
    triangles_m
        (T, 3, 3) corners [m].
    edge_m
        Longest edge allowed [m].

    Returns
    -------
    pieces_m
        (K, 3, 3) corners of the pieces [m]; they cover the triangles exactly.
    parent
        (K,) which triangle each piece was cut from.
    """
    done: list[tuple[NDArray, NDArray]] = []
    pieces_m, parent = triangles_m, np.arange(len(triangles_m))
    while len(pieces_m):
        lengths = np.linalg.norm(np.roll(pieces_m, -1, axis=1) - pieces_m, axis=2)
        long = lengths.max(axis=1) > edge_m
        done.append((pieces_m[~long], parent[~long]))
        pieces_m, parent, lengths = pieces_m[long], parent[long], lengths[long]
        turn = (lengths.argmax(axis=1)[:, None] + np.arange(3)) % 3
        a, b, c = (pieces_m[np.arange(len(pieces_m)), turn[:, i]] for i in range(3))
        middle = (a + b) / 2
        pieces_m = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
        parent = np.concatenate([parent, parent])
    if not done:
        return triangles_m, parent
    return np.concatenate([p for p, _ in done]), np.concatenate([t for _, t in done])


def cut(scene: "Scene", edge_m: float = PATCH_EDGE_M) -> Patches:
    """Cut all surfaces of a scene into patches with no edge longer than ``edge_m`` [m]."""
    corners_m, triangle = subdivide(scene.triangles_m, edge_m)
    across = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    twice_area = np.linalg.norm(across, axis=1)
    real = twice_area > 0  # a triangle without area reflects nothing and has no normal
    corners_m, across, twice_area, triangle = corners_m[real], across[real], twice_area[real], triangle[real]
    return Patches(
        corners_m=corners_m,
        centre_m=corners_m.mean(axis=1),
        normal=across / twice_area[:, None],
        area_m2=twice_area / 2,
        albedo=scene.albedo[triangle],
        triangle=triangle,
    )
