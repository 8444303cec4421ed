"""Scenes of upright letters, which show at a glance whether a picture is sharp, mirrored or misplaced."""

import numpy as np

from simulators.scenes.letters import letter_quads
from simulators.scenes.mesh import Mesh, Point, Scene
from simulators.scenes.solids import quads_mesh


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


def letters() -> Scene:
    """Return an F that hides part of an R behind it."""
    near = letter("F", centre_m=(0.16, -0.02, 1.0))
    far = letter("R", centre_m=(-0.20, 0.04, 1.5), height_m=0.66, width_m=0.5)
    return Scene("letters", (near, far))


def letter_plane() -> Scene:
    """Return NLOS in one plane, 1 m from the wall."""
    places = zip("NLOS", (0.63, 0.21, -0.21, -0.63), strict=True)
    size = {"height_m": 0.5, "width_m": 0.34, "stroke_m": 0.08}
    return Scene(
        "letter-plane", tuple(letter(name, centre_m=(x_m, 0.0, 1.0), **size) for name, x_m in places)
    )


def letters_rd() -> Scene:
    """Return the paper's R and D of 0.75 m x 0.8 m, 1.25 m and 1.7 m from the wall, R partly hiding D."""
    near = letter("R", centre_m=(0.125, 0.0, 1.25), height_m=0.8, width_m=0.75, stroke_m=0.14)
    far = letter("D", centre_m=(-0.125, 0.0, 1.7), height_m=0.8, width_m=0.75, stroke_m=0.14)
    return Scene("letters-rd", (near, far))


def four() -> Scene:
    """Return a 4, 1 m from the wall: one letter to be moved, legible by what is open in it."""
    return Scene("four", (letter("4", centre_m=(0.0, 0.0, 1.0), height_m=0.7, width_m=0.55, stroke_m=0.12),))


def large_depth() -> Scene:
    """Return letters from 0.8 m to 3 m, larger where farther: light falls as depth to the minus 4."""
    places = [
        ("L", (0.62, -0.30, 0.8), 0.40),
        ("T", (-0.62, 0.25, 1.3), 0.50),
        ("H", (0.30, 0.30, 2.0), 0.60),
        ("E", (-0.25, -0.22, 3.0), 0.80),
    ]
    return Scene(
        "large-depth",
        tuple(
            letter(name, centre_m=at, height_m=h, width_m=0.75 * h, stroke_m=0.16 * h)
            for name, at, h in places
        ),
    )
