"""Shelves with things on them, alone and in a corridor."""

import numpy as np
from numpy.typing import NDArray

from simulators.scenes.mesh import Mesh, Scene
from simulators.scenes.solids import box, cylinder, facing, joined, quads_mesh

#: Thickness of boards [m].
BOARD_M = 0.02


def bookshelf() -> Scene:
    """Return the paper's shelf of 1.4 m x 0.5 m, its front 1.7 m from the wall, with books."""
    return Scene("bookshelf", _bookshelf())


def bookshelf_corridor() -> Scene:
    """Return the same shelf in the paper's corridor of 2 m x 2 m x 3 m, which adds interreflections.

    The relay wall is one end of the corridor; the opening of 1 m x 2 m through which the rig looks in is in
    the side wall at positive x, next to the relay wall.
    """
    corners_m = np.array(
        [
            [[-1, -1, 3], [1, -1, 3], [1, 1, 3], [-1, 1, 3]],
            [[-1, -1, 0], [1, -1, 0], [1, -1, 3], [-1, -1, 3]],
            [[-1, 1, 0], [1, 1, 0], [1, 1, 3], [-1, 1, 3]],
            [[-1, -1, 0], [-1, 1, 0], [-1, 1, 3], [-1, -1, 3]],
            [[1, -1, 1], [1, 1, 1], [1, 1, 3], [1, -1, 3]],
        ],
        dtype=float,
    )
    sides = ("end", "floor", "ceiling", "side", "side_with_opening")
    walls = [quads_mesh(name, quad[None], albedo=0.6) for name, quad in zip(sides, corners_m, strict=True)]
    return Scene("bookshelf-corridor", (*_bookshelf(), *walls))


def shelf() -> Scene:
    """Return an upright shelf of 0.8 m x 1 m with glossy and matt things on three boards, 1.2 m away."""
    return Scene("shelf", shelf_with_things(x_m=0.0, front_m=1.2, foot_m=-0.5))


def shelf_with_things(*, x_m: float, front_m: float, foot_m: float) -> tuple[Mesh, ...]:
    """Build the shelf of `shelf` around ``x_m``, front at depth ``front_m``, standing at ``foot_m`` [m]."""
    left, right, back, top = x_m - 0.4, x_m + 0.4, front_m + 0.3, foot_m + 1.0
    boards = [
        box((left, foot_m + y, front_m), (right, foot_m + y + BOARD_M, back)) for y in (0.0, 0.33, 0.66, 0.98)
    ]
    sides = [
        box((x, foot_m, front_m), (x + BOARD_M, top, back)) for x in (left - BOARD_M, right)
    ]  # outside the boards, so that no faces coincide
    panel = facing((left, right), (foot_m, top), back + 1e-3)
    low, middle, high = (foot_m + y + BOARD_M + 1e-3 for y in (0.0, 0.33, 0.66))
    z = front_m + 0.05
    carton = box((x_m - 0.3, low, z), (x_m + 0.02, low + 0.22, z + 0.2), turn_deg=12)
    return (
        joined("shelf", *boards, *sides, panel, albedo=0.6),
        joined("books", *_row(left + 0.04, middle, z, (0.05, 0.04, 0.06, 0.05, 0.07), (0.22, 0.25, 0.20))),
        joined("vase", cylinder((x_m + 0.22, middle, z + 0.1), 0.07, 0.24), albedo=0.7, roughness=0.2),
        joined("carton", carton, albedo=0.7),
        joined("tin", cylinder((x_m + 0.24, low, z + 0.1), 0.08, 0.18), albedo=0.8, roughness=0.3),
        joined("ream", box((x_m + 0.02, high, z), (x_m + 0.32, high + 0.12, z + 0.2)), albedo=0.85),
        joined("cup", cylinder((x_m - 0.18, high, z + 0.08), 0.05, 0.14), albedo=0.8),
    )


def _bookshelf() -> tuple[Mesh, ...]:
    front, back, foot, top = 1.7, 1.95, -0.25, 0.25
    boards = [box((-0.7, y, front), (0.7, y + BOARD_M, back)) for y in (foot, -0.01, top - BOARD_M)]
    # uprights end one millimetre off the boards, so that no faces coincide
    uprights = [
        box((x, y0 + 1e-3, front), (x + BOARD_M, y1 - 1e-3, back))
        for x in (-0.7, -0.01, 0.7 - BOARD_M)
        for y0, y1 in ((foot + BOARD_M, -0.01), (-0.01 + BOARD_M, top - BOARD_M))
    ]
    panel = facing((-0.7, 0.7), (foot, top), back + 1e-3)
    low, high = foot + BOARD_M + 1e-3, 0.01 + 1e-3
    z = front + 0.03
    lower = _row(-0.60, low, z, (0.05, 0.04, 0.06, 0.05, 0.03, 0.05), (0.18, 0.20, 0.16))
    upper = _row(0.08, high, z, (0.04, 0.06, 0.05, 0.05, 0.07, 0.04, 0.05), (0.19, 0.17, 0.20))
    return (
        joined("bookshelf", *boards, *uprights, panel, albedo=0.6),
        joined("books_below", *lower, albedo=0.75),
        joined("books_above", *upper, albedo=0.75),
        joined("carton", box((0.15, low, z), (0.5, low + 0.15, z + 0.18), turn_deg=10), albedo=0.7),
        joined("vase", cylinder((-0.35, high, z + 0.1), 0.06, 0.18), albedo=0.8),
    )


def _row(
    x_m: float, y_m: float, z_m: float, widths_m: tuple[float, ...], heights_m: tuple[float, ...]
) -> list[NDArray[np.float64]]:
    """Stand books side by side towards +x, heights in turn, every other one set back by 3 cm."""
    books = []
    for number, width_m in enumerate(widths_m):
        height_m, back_m = heights_m[number % len(heights_m)], 0.03 * (number % 2)
        books.append(box((x_m, y_m, z_m + back_m), (x_m + width_m, y_m + height_m, z_m + back_m + 0.15)))
        x_m += width_m + 0.005
    return books
