"""The shapes that built-in scenes are made of: quadrilaterals, boxes and cylinders."""

import numpy as np
from numpy.typing import NDArray

from simulators.scenes.mesh import Mesh, Point


def quads_mesh(
    name: str, corners_m: NDArray[np.float64], albedo: float = 0.8, *, roughness: float = 1.0
) -> Mesh:
    """Make a mesh of (Q, 4, 3) flat convex quadrilaterals [m], two triangles each."""
    first = 4 * np.arange(len(corners_m))
    faces = (first[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    return Mesh(name, corners_m.reshape(-1, 3), faces, albedo, roughness)


def facing(x_m: tuple[float, float], y_m: tuple[float, float], z_m: float) -> NDArray[np.float64]:
    """Return the (1, 4, 3) corners of a rectangle parallel to the wall [m]."""
    (x0, x1), (y0, y1) = x_m, y_m
    return np.array([[[x0, y0, z_m], [x1, y0, z_m], [x1, y1, z_m], [x0, y1, z_m]]])


def box(low_m: Point, high_m: Point, *, turn_deg: float = 0.0) -> NDArray[np.float64]:
    """Return the (6, 4, 3) faces [m] of a box between two corners, turned about its upright axis."""
    corners = np.array(np.meshgrid(*zip(low_m, high_m, strict=True), indexing="ij")).reshape(3, 8).T
    faces = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    return rotated(corners[faces], turn_deg, (corners[0] + corners[7]) / 2)


def rotated(
    corners_m: NDArray[np.float64], turn_deg: float, about_m: Point | NDArray[np.float64]
) -> NDArray[np.float64]:
    """Turn (.., 3) corners [m] about the upright axis through a point, from z towards x."""
    cos, sin = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    matrix = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
    return (corners_m - about_m) @ matrix.T + about_m


def cylinder(foot_m: Point, radius_m: float, height_m: float, sides: int = 16) -> NDArray[np.float64]:
    """Return the (sides + sides / 2 - 1, 4, 3) faces [m] of an upright cylinder, its lid included.

    It is a prism with an even number of sides, whose corners lie on the cylinder.
    """
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([radius_m * np.cos(angle), 0 * angle, radius_m * np.sin(angle)], axis=1) + foot_m
    up = ring + np.array([0.0, height_m, 0.0])
    mantle = np.stack([ring, np.roll(ring, -1, axis=0), np.roll(up, -1, axis=0), up], axis=1)
    lid = [[up[i], up[i + 1], up[sides - 2 - i], up[sides - 1 - i]] for i in range(sides // 2 - 1)]
    return np.concatenate([mantle, np.array(lid)])


def joined(name: str, *parts: NDArray[np.float64], albedo: float = 0.8, roughness: float = 1.0) -> Mesh:
    """Join the faces of several shapes, (.., 4, 3) each [m], into one mesh of one material."""
    return quads_mesh(name, np.concatenate(parts), albedo, roughness=roughness)
