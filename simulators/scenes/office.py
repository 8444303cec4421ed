"""An office: near and far things that hide each other, matt and glossy ones, in a room."""

import numpy as np
from numpy.typing import NDArray

from simulators.scenes.mesh import Mesh, Scene
from simulators.scenes.shelves import shelf_with_things
from simulators.scenes.solids import box, cylinder, facing, joined, quads_mesh, rotated

#: Height of the floor on which all stands, and the room across [m].
FLOOR_M, ROOM_X_M = -0.9, (-1.0, 1.0)


def office() -> Scene:
    """Return the office, 0.65 m to 3 m from the wall; the chair is nearest, as in the paper."""
    bin_ = joined("bin", cylinder((0.05, FLOOR_M, 1.15), 0.13, 0.6), albedo=0.7, roughness=0.2)
    cabinet = joined("cabinet", box((0.2, FLOOR_M, 1.52), (1.0, -0.551, 1.8)), albedo=0.5)
    ladder = joined(
        "ladder",
        *(box((x, FLOOR_M, 2.1), (x + 0.04, 0.6, 2.14)) for x in (-0.15, 0.2)),
        *(box((-0.11, y, 2.1), (0.2, y + 0.04, 2.13)) for y in (-0.4, -0.15, 0.1, 0.35)),
        albedo=0.75,
    )
    picture = quads_mesh("picture", facing((-0.05, 0.35), (0.25, 0.6), 2.95), albedo=0.8, roughness=0.3)
    things = (_chair(), bin_, *shelf_with_things(x_m=0.6, front_m=1.5, foot_m=-0.55), cabinet, ladder)
    return Scene("office", (*things, *_desk(), picture, *_room()))


def _room() -> tuple[Mesh, ...]:
    """Build the back wall, and the floor as far as the desk, which spreads light over many nanoseconds."""
    x0, x1 = ROOM_X_M
    floor = np.array([[[x0, FLOOR_M, 0], [x1, FLOOR_M, 0], [x1, FLOOR_M, 2], [x0, FLOOR_M, 2]]])
    return (
        quads_mesh("back_wall", facing(ROOM_X_M, (FLOOR_M, 0.8), 3.0), albedo=0.5),
        quads_mesh("floor", floor, albedo=0.5),
    )


def _chair() -> Mesh:
    """Build a chair of round tubes at x = -0.4, 0.65 m away and turned a little, with a bent rest."""
    near, far = ([(x, z) for x in (-0.58, -0.22)] for z in (0.7, 1.08))
    legs = [cylinder((x, FLOOR_M, z), 0.018, -0.201 - FLOOR_M, sides=8) for x, z in near + far]
    seat = box((-0.6, -0.2, 0.68), (-0.2, -0.16, 1.1))
    posts = [cylinder((x, -0.159, z), 0.018, 0.5, sides=8) for x, z in far]
    bend = np.radians(np.linspace(-40, 40, 9))
    x_m, z_m = -0.4 + 0.28 * np.sin(bend), 0.84 + 0.28 * np.cos(bend)
    slats = [_bent(x_m, z_m, y, y + tall) for y, tall in ((0.05, 0.08), (0.2, 0.22))]
    parts = np.concatenate([*legs, seat, *posts, *slats])
    return joined("chair", rotated(parts, 15, (-0.4, 0.0, 0.9)), albedo=0.7)


def _bent(x_m: NDArray[np.float64], z_m: NDArray[np.float64], low_m: float, high_m: float) -> NDArray:
    """Return the upright faces (n - 1, 4, 3) over n points of a bent line [m]."""
    low, high = (np.stack([x_m, np.full_like(x_m, y_m), z_m], axis=1) for y_m in (low_m, high_m))
    return np.stack([low[:-1], low[1:], high[1:], high[:-1]], axis=1)


def _desk() -> tuple[Mesh, ...]:
    """Build a desk 2.2 m away with a monitor and a stack of paper on it."""
    top = box((-0.95, -0.3, 2.2), (-0.2, -0.26, 2.7))
    legs = [box((x, FLOOR_M, z), (x + 0.05, -0.301, z + 0.05)) for x in (-0.95, -0.25) for z in (2.2, 2.65)]
    screen = box((-0.85, -0.1, 2.45), (-0.4, 0.22, 2.48), turn_deg=-8)
    stand = box((-0.66, -0.259, 2.46), (-0.6, -0.101, 2.5))
    return (
        joined("desk", top, *legs, albedo=0.6),
        joined("monitor", screen, stand, albedo=0.6, roughness=0.4),
        joined("paper", box((-0.38, -0.259, 2.25), (-0.24, -0.19, 2.45)), albedo=0.85),
    )
