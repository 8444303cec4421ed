"""An office: near and far things that hide each other, matt and glossy ones, in a room."""

import numpy as np

from simulators.scenes.mesh import Mesh, Scene
from simulators.scenes.shelves import shelf_with_things
from simulators.scenes.solids import box, cylinder, facing, joined, quads_mesh, turned

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
    """Build a chair at x = -0.4, 0.65 m away, turned so that none of its faces is parallel to the wall."""
    legs = [box((x, FLOOR_M, z), (x + 0.03, -0.201, z + 0.03)) for x in (-0.6, -0.23) for z in (0.7, 1.07)]
    seat = box((-0.6, -0.2, 0.7), (-0.2, -0.16, 1.1))
    posts = [box((x, -0.159, 1.07), (x + 0.03, 0.3, 1.1)) for x in (-0.6, -0.23)]
    rest = box((-0.6, 0.301, 1.065), (-0.2, 0.5, 1.095))
    rung = box((-0.569, 0.1, 1.07), (-0.231, 0.16, 1.09))
    parts = np.concatenate([*legs, seat, *posts, rest, rung])
    return joined("chair", turned(parts, 25, (-0.4, 0.0, 0.9)), albedo=0.7)


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
