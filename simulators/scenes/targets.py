"""Targets that measure an imaging system: single points, bars, and nothing at all."""

import numpy as np

from simulators.scenes.mesh import Mesh, Scene
from simulators.scenes.solids import facing, joined, quads_mesh


def point() -> Scene:
    """Return one patch of 2 cm on the axis, 1 m from the wall."""
    corners_m = np.array([[[0.01, -0.01, 1.0], [-0.01, -0.01, 1.0], [-0.01, 0.01, 1.0], [0.01, 0.01, 1.0]]])
    return Scene("point", (quads_mesh("patch", corners_m),))


def patches() -> Scene:
    """Return seven patches of 4 cm from 0.7 m to 2.5 m, none before another."""
    places = [
        (0.60, 0.40, 0.7),
        (-0.60, 0.40, 0.9),
        (0.0, 0.0, 1.1),
        (0.60, -0.40, 1.4),
        (-0.60, -0.40, 1.7),
        (0.0, 0.45, 2.0),
        (0.0, -0.45, 2.5),
    ]
    return Scene(
        "patches",
        tuple(
            quads_mesh(f"patch_{z:g}m", facing((x - 0.02, x + 0.02), (y - 0.02, y + 0.02), z))
            for x, y, z in places
        ),
    )


def resolution() -> Scene:
    """Return groups of three bars at 1 m, upright above, lying below; bars and gaps of 8, 5, 3 and 2 cm."""
    groups: list[Mesh] = []
    left_m = 0.7
    for width in (0.08, 0.05, 0.03, 0.02):
        middle = left_m - 2.5 * width
        upright, lying = [], []
        for at in (-2 * width, 0.0, 2 * width):
            upright.append(facing((middle + at - width / 2, middle + at + width / 2), (0.05, 0.45), 1.0))
            lying.append(
                facing(
                    (middle - 2.5 * width, middle + 2.5 * width),
                    (-0.25 + at - width / 2, -0.25 + at + width / 2),
                    1.0,
                )
            )
        groups += [
            joined(f"upright_{width * 100:g}cm", *upright),
            joined(f"lying_{width * 100:g}cm", *lying),
        ]
        left_m -= 5 * width + 0.12
    return Scene("resolution", tuple(groups))


def empty() -> Scene:
    """Return an empty room: only background is measured."""
    return Scene("empty", ())
