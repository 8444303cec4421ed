"""Surfaces cut into patches so small that light may be taken at their centres."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from simulators.scenes import Scene

#: Longest edge of a patch [m]; halving leaves right triangles with legs of about 1 cm.
PATCH_EDGE_M = 0.02

#: Large scenes are cut coarser, into about this many patches. An edge of 6 cm at 1 m shifts the times inside
#: a patch by at most edge^2 / (8 r) = 0.45 mm or 1.5 ps, and its shade by half a patch.
USUAL_PATCHES = 12_000


class Patches(NamedTuple):
    """Small flat triangles, K of them.

    Attributes
    ----------
    corners_m
        (K, 3, 3) corners [m].
    centre_m
        (K, 3) centroids [m], each column in one piece: so kernels do many patches at once.
    normal
        (K, 3) unit normals, stored in the same way; both sides reflect, so the sign means nothing by itself.
    area_m2
        (K,) areas [m^2].
    albedo
        (K,) fraction of light reflected.
    roughness
        (K,) 1 for Lambertian surfaces, below for glossy ones.
    retro
        (K,) whether the gloss points back to where light comes from.
    ggx
        (K,) whether the gloss is that of GGX, or else of Ward.
    triangle
        (K,) which triangle of the scene each was cut from.
    """

    corners_m: NDArray[np.float64]
    centre_m: NDArray[np.float64]
    normal: NDArray[np.float64]
    area_m2: NDArray[np.float64]
    albedo: NDArray[np.float64]
    roughness: NDArray[np.float64]
    retro: NDArray[np.bool_]
    ggx: NDArray[np.bool_]
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
        halves_m = np.stack([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)], axis=1)
        pieces_m, parent = halves_m.reshape(-1, 3, 3), np.repeat(parent, 2)  # the two halves side by side
    if not done:
        return triangles_m, parent
    return np.concatenate([p for p, _ in done]), np.concatenate([t for _, t in done])


def tessellate(scene: "Scene", edge_m: float | None = None) -> Patches:
    """Cut all surfaces of a scene into patches with no edge longer than ``edge_m`` [m].

    Without ``edge_m`` it is `PATCH_EDGE_M`, or more where that would give far more than `USUAL_PATCHES`.
    """
    if edge_m is None:
        # halved right triangles have between 1/8 and 1/4 of the area of their longest edge's limit squared
        edge_m = max(
            PATCH_EDGE_M, float(np.sqrt(6 * _twice_areas(scene.triangles_m).sum() / 2 / USUAL_PATCHES))
        )
    corners_m, triangle = subdivide(scene.triangles_m, edge_m)
    twice_area = _twice_areas(corners_m)
    real = twice_area > 0  # a triangle without area reflects nothing and has no normal
    corners_m, twice_area, triangle = corners_m[real], twice_area[real], triangle[real]
    across = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    of_mesh = scene.mesh_index[triangle]
    return Patches(
        corners_m=corners_m,
        centre_m=np.asfortranarray(corners_m.mean(axis=1)),
        normal=np.asfortranarray(across / twice_area[:, None]),
        area_m2=twice_area / 2,
        albedo=scene.albedo[triangle],
        roughness=np.array([mesh.roughness for mesh in scene.meshes])[of_mesh],
        retro=np.array([mesh.retro for mesh in scene.meshes], dtype=bool)[of_mesh],
        ggx=np.array([mesh.gloss == "ggx" for mesh in scene.meshes], dtype=bool)[of_mesh],
        triangle=triangle,
    )


def _twice_areas(triangles_m: NDArray[np.float64]) -> NDArray[np.float64]:
    across = np.cross(triangles_m[:, 1] - triangles_m[:, 0], triangles_m[:, 2] - triangles_m[:, 0])
    return np.linalg.norm(across, axis=1)
