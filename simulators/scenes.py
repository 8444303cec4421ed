"""Hidden scenes: named triangle meshes in front of the relay wall.

Frame: right-handed, origin at the centre of the wall, y up, z out of the wall into the room, x to the right
for one who faces the wall; metres. The virtual camera looks out of the wall, so it sees x grow to the left:
what it is to read is drawn with x = -u, where u is the reader's right.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulators.letters import letter_quads
from simulators.truth import Truth, first_surface

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Mesh:
    """A surface of triangles, Lambertian on both sides, whichever way they are wound.

    Attributes
    ----------
    name
        What it is called in truth files.
    vertices_m
        (V, 3) corners [m].
    faces
        (F, 3) integers, corners of each triangle.
    albedo
        Fraction of light reflected: one number, or (F,) one for each face.
    """

    name: str
    vertices_m: NDArray[np.float64]
    faces: NDArray[np.int64]
    albedo: float | NDArray[np.float64] = 0.8

    @property
    def triangles_m(self) -> NDArray[np.float64]:
        """(F, 3, 3) corners of every triangle [m]."""
        return np.asarray(self.vertices_m, dtype=np.float64)[np.asarray(self.faces, dtype=np.int64)]

    @property
    def face_albedo(self) -> NDArray[np.float64]:
        """(F,) albedo of every triangle."""
        return np.broadcast_to(np.asarray(self.albedo, dtype=np.float64), len(self.faces))


@dataclass(frozen=True)
class Scene:
    """What is hidden around the corner."""

    name: str
    meshes: tuple[Mesh, ...]

    @property
    def triangles_m(self) -> NDArray[np.float64]:
        """(T, 3, 3) corners of the triangles of all meshes, in order [m]."""
        return np.concatenate([np.empty((0, 3, 3)), *(mesh.triangles_m for mesh in self.meshes)])

    @property
    def albedo(self) -> NDArray[np.float64]:
        """(T,) albedo of the triangles of all meshes."""
        return np.concatenate([np.empty(0), *(mesh.face_albedo for mesh in self.meshes)])

    @property
    def mesh_index(self) -> NDArray[np.int64]:
        """(T,) which of `meshes` each triangle belongs to."""
        return np.repeat(np.arange(len(self.meshes)), [len(mesh.faces) for mesh in self.meshes])

    def truth(self, x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> Truth:
        """Return the first surface along +z from the wall, at the points of two axes [m]."""
        return first_surface(self.triangles_m, self.mesh_index, x_m, y_m)

    def depth_map(self, x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (ny, nx) depth of the first surface [m], NaN where there is nothing."""
        return self.truth(x_m, y_m).depth_m


def quads_mesh(name: str, corners_m: NDArray[np.float64], albedo: float = 0.8) -> Mesh:
    """Make a mesh of (Q, 4, 3) flat convex quadrilaterals [m], two triangles each."""
    first = 4 * np.arange(len(corners_m))
    faces = (first[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    return Mesh(name, corners_m.reshape(-1, 3), faces, albedo)


def letter(
    character: str,
    *,
    centre_m: Point,
    height_m: float = 0.6,
    width_m: float = 0.45,
    stroke_m: float = 0.09,
    albedo: float = 0.8,
) -> Mesh:
    """Stand a letter parallel to the wall, so that the camera that looks out of the wall reads it."""
    drawn = letter_quads(character, width_m=width_m, height_m=height_m, stroke_m=stroke_m)
    x_m, y_m, z_m = centre_m
    right, up = drawn[..., 0] - width_m / 2, drawn[..., 1] - height_m / 2
    corners_m = np.stack([x_m - right, y_m + up, np.full_like(up, z_m)], axis=-1)
    return quads_mesh(f"letter_{character}", corners_m, albedo)


def _letters() -> Scene:
    near = letter("F", centre_m=(0.16, -0.02, 1.0))
    far = letter("R", centre_m=(-0.20, 0.04, 1.5), height_m=0.66, width_m=0.5)
    return Scene("letters", (near, far))


def _letter_plane() -> Scene:
    places = zip("NLOS", (0.63, 0.21, -0.21, -0.63), strict=True)
    size = {"height_m": 0.5, "width_m": 0.34, "stroke_m": 0.08}
    return Scene(
        "letter-plane", tuple(letter(name, centre_m=(x_m, 0.0, 1.0), **size) for name, x_m in places)
    )


def _point() -> Scene:
    corners_m = np.array([[[0.01, -0.01, 1.0], [-0.01, -0.01, 1.0], [-0.01, 0.01, 1.0], [0.01, 0.01, 1.0]]])
    return Scene("point", (quads_mesh("patch", corners_m),))


#: The built-in scenes.
SCENES: dict[str, Callable[[], Scene]] = {
    "letters": _letters,
    "letter-plane": _letter_plane,
    "point": _point,
    "empty": lambda: Scene("empty", ()),
}


def scene(name: str = "letters") -> Scene:
    """Build a scene by name.

    Raises
    ------
    ValueError
        If there is no such scene.
    """
    if name not in SCENES:
        raise ValueError(f"no scene {name!r}; the built-in scenes are {', '.join(SCENES)}")
    return SCENES[name]()
