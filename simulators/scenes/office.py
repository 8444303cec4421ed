"""An office: near and far things that hide each other, matt and glossy ones, before a back wall."""

from simulators.scenes.mesh import Mesh, Scene
from simulators.scenes.shelves import shelf_with_things
from simulators.scenes.solids import box, cylinder, facing, joined, quads_mesh


def office() -> Scene:
    """Return the office, about 0.6 m to 3 m from the wall."""
    back_wall = quads_mesh("back_wall", facing((-1.4, 1.4), (-0.9, 1.1), 3.0), albedo=0.5)
    picture = quads_mesh("picture", facing((-0.05, 0.35), (0.25, 0.6), 2.95), albedo=0.8, roughness=0.3)
    sign = quads_mesh("sign", facing((0.05, 0.25), (0.3, 0.5), 0.65), albedo=0.8)
    bin_ = joined("bin", cylinder((0.05, -0.62, 1.15), 0.13, 0.32), albedo=0.7, roughness=0.2)
    ladder = joined(
        "ladder",
        *(box((x, -0.6, 2.1), (x + 0.04, 0.6, 2.14)) for x in (-0.15, 0.2)),
        *(box((-0.11, y, 2.1), (0.2, y + 0.04, 2.13)) for y in (-0.4, -0.15, 0.1, 0.35)),
        albedo=0.75,
    )
    return Scene(
        "office",
        (
            sign,
            *_chair(),
            bin_,
            *shelf_with_things(x_m=0.6, front_m=1.5, foot_m=-0.55),
            ladder,
            *_desk(),
            picture,
            back_wall,
        ),
    )


def _chair() -> tuple[Mesh, ...]:
    """Build a chair at x = -0.4, its seat 0.85 to 1.25 m away and its rest behind that."""
    legs = [box((x, -0.6, z), (x + 0.03, -0.201, z + 0.03)) for x in (-0.6, -0.23) for z in (0.85, 1.22)]
    seat = box((-0.6, -0.2, 0.85), (-0.2, -0.16, 1.25))
    posts = [box((x, -0.159, 1.22), (x + 0.03, 0.3, 1.25)) for x in (-0.6, -0.23)]
    rest = box((-0.6, 0.301, 1.215), (-0.2, 0.5, 1.245))
    rung = box((-0.569, 0.1, 1.22), (-0.231, 0.16, 1.24))
    return (joined("chair", *legs, seat, *posts, rest, rung, albedo=0.7),)


def _desk() -> tuple[Mesh, ...]:
    """Build a desk 2.2 m away with a monitor and a stack of paper on it."""
    top = box((-0.95, -0.3, 2.2), (-0.2, -0.26, 2.7))
    legs = [box((x, -0.85, z), (x + 0.05, -0.301, z + 0.05)) for x in (-0.95, -0.25) for z in (2.2, 2.65)]
    screen = box((-0.85, -0.1, 2.45), (-0.4, 0.22, 2.48), turn_deg=-8)
    stand = box((-0.66, -0.259, 2.46), (-0.6, -0.101, 2.5))
    return (
        joined("desk", top, *legs, albedo=0.6),
        joined("monitor", screen, stand, albedo=0.6, roughness=0.4),
        joined("paper", box((-0.38, -0.259, 2.25), (-0.24, -0.19, 2.45)), albedo=0.85),
    )
