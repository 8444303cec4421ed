"""Hidden scenes as triangle meshes in front of the relay wall.

Frame: right-handed, origin at the centre of the wall, y up, z out of the wall into the room, x to the right
for one who faces the wall; metres. The virtual camera looks out of the wall, so it sees x grow to the left:
what it is to read is drawn with x = -u, where u is the reader's right.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from simulators.scenes.truth import Truth

Point = tuple[float, float, float]

#: Smoothest surface [alpha] that patches of a few centimetres, lit as if from their centres, can show.
SMOOTHEST = 0.05

#: Models of the lobe of a glossy surface, see `simulators.transport.reflectance`.
Gloss = Literal["ward", "ggx"]


@dataclass(frozen=True)
class Mesh:
    """A surface of triangles that reflects on both sides, whichever way they are wound.

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
    roughness
        1 is perfectly Lambertian; below, down to 0.05, more and more light leaves near the mirror direction,
        see `simulators.transport.reflectance`.
    retro
        Whether the lobe of a surface with roughness below 1 points back to where the light comes from.
    gloss
        Model of the lobe of a surface with roughness below 1: "ward" or "ggx".

    Raises
    ------
    ValueError
        If the roughness or an albedo is out of range, or there is no such model.
    """

    name: str
    vertices_m: NDArray[np.float64]
    faces: NDArray[np.int64]
    albedo: float | NDArray[np.float64] = 0.8
    roughness: float = 1.0
    retro: bool = False
    gloss: Gloss = "ward"

    def __post_init__(self) -> None:
        if not SMOOTHEST <= self.roughness <= 1:
            raise ValueError(
                f"{self.name}: roughness {self.roughness} is not between {SMOOTHEST} and 1 (Lambertian)"
            )
        if np.any(np.asarray(self.albedo) < 0) or np.any(np.asarray(self.albedo) > 1):
            raise ValueError(f"{self.name}: albedo is not between 0 and 1")
        if self.gloss not in get_args(Gloss):
            raise ValueError(f"{self.name}: there is no gloss {self.gloss!r}; choose ward or ggx")

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

    def with_roughness(self, roughness: float) -> "Scene":
        """Return the same scene with every surface as rough as this; see `Mesh`."""
        return Scene(self.name, tuple(replace(mesh, roughness=roughness) for mesh in self.meshes))

    def with_gloss(self, gloss: Gloss) -> "Scene":
        """Return the same scene with this model for the lobes of all surfaces; see `Mesh`."""
        return Scene(self.name, tuple(replace(mesh, gloss=gloss) for mesh in self.meshes))

    def moved(self, offset_m: Point) -> "Scene":
        """Return the same scene, moved as a whole [m]."""
        return Scene(
            self.name,
            tuple(replace(mesh, vertices_m=np.add(mesh.vertices_m, offset_m)) for mesh in self.meshes),
        )

    def truth(self, x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> "Truth":
        """Return the first surface along +z from the wall, at the points of two axes [m]."""
        from simulators.scenes.truth import first_surface

        return first_surface(self.triangles_m, self.mesh_index, x_m, y_m)

    def depth_map(self, x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (ny, nx) depth of the first surface [m], NaN where there is nothing."""
        return self.truth(x_m, y_m).depth_m
