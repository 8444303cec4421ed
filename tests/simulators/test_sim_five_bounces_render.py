"""A furnished room, matt to five bounces and glossy at three, against a path tracer, where there is one.

Needs mitransient (``pip install mitransient``) and the LLVM library that it looks for; it runs in a process
of its own, by the interpreter that NLOS_PATH_TRACER names, or by this one.
"""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from simulators.constants import C_M_PER_S
from simulators.scenes import Scene, quads_mesh
from simulators.scenes.solids import box
from simulators.transport.extra_bounces import WALL_M
from simulators.transport.patches import tessellate
from simulators.transport.renderer import Transport

RENDERER = Path(__file__).parents[1] / "support" / "path_traced_room.py"
LASER = (0.35, -0.25, 0.0)
ALBEDO, WALL_ALBEDO = 0.6, 0.8
EDGES_M = np.arange(0.6, 13.0, 0.06)


def room(roughness=1.0):
    """Floor, ceiling, sides and end of a room behind the relay wall, and a box that stands in it."""
    x, y, z = WALL_M[0] / 2, WALL_M[1] / 2, 2.2
    ring = [(-x, -y), (x, -y), (x, y), (-x, y)]
    sides = [[[*a, 0], [*b, 0], [*b, z], [*a, z]] for a, b in zip(ring, [*ring[1:], ring[0]], strict=True)]
    walls = quads_mesh("walls", np.array([*sides, [[*p, z] for p in ring]]), ALBEDO)
    furniture = quads_mesh("box", box((-0.5, -0.5, 1.2), (0.1, 0.3, 1.6), turn_deg=20), ALBEDO)
    return Scene("room", (walls, furniture)).with_roughness(roughness).with_gloss("ggx")


def path_traced(here, bounces, *, roughness=1.0, samples=60_000):
    """Transients (bounces, 6, B), and the (6, 3) detector spots."""
    python = os.environ.get("NLOS_PATH_TRACER", sys.executable)
    np.savez(
        here / "room.npz",
        triangles_m=room().triangles_m,
        albedo=ALBEDO,
        roughness=roughness,
        wall_m=np.array(WALL_M),
        wall_albedo=WALL_ALBEDO,
        laser_m=np.array(LASER),
        edges_m=EDGES_M,
        samples=samples,
        bounces=bounces,
    )
    done = subprocess.run(
        [python, RENDERER, here / "room.npz", here / "out.npz"], capture_output=True, text=True, timeout=280
    )
    if done.returncode != 0:
        why = done.stderr.strip().splitlines()[-1:]
        pytest.skip(f"no path tracer; it needs mitransient and LLVM 19 or so (DRJIT_LIBLLVM_PATH): {why}")
    with np.load(here / "out.npz") as file:
        return file["transient"].astype(float), file["spots_m"]


def test_room_agrees_bounce_by_bounce(tmp_path):
    reference, spots = path_traced(tmp_path, (3, 4, 5))
    built, edges_s = room(), EDGES_M / C_M_PER_S
    patches, laser = tessellate(built), np.tile(LASER, (len(spots), 1))
    up_to = [
        Transport(patches, built.triangles_m, bounces=n).transients(laser, spots, edges_s) for n in (3, 4, 5)
    ]
    ours = np.stack([up_to[0], up_to[1] - up_to[0], up_to[2] - up_to[1]])
    reference = reference * ours[0].sum() / reference[0].sum()
    middle_m = (EDGES_M[1:] + EDGES_M[:-1]) / 2
    # clusters of 15 cm stand for the surfaces in between: 1 % of the light of each exchange between them
    for bounces, a, b, tolerance in zip((3, 4, 5), ours, reference, (0.02, 0.02, 0.05), strict=True):
        likeness = (a * b).sum() / np.sqrt((a**2).sum() * (b**2).sum())
        assert likeness > 0.997, bounces
        assert a.sum(axis=1) == pytest.approx(b.sum(axis=1), rel=tolerance)
        assert (a @ middle_m) / a.sum(axis=1) == pytest.approx((b @ middle_m) / b.sum(axis=1), abs=0.04)


@pytest.fixture(scope="module")
def unit(tmp_path_factory):
    """What one of ours is in the path tracer's unit: both have the same matt room."""
    reference, spots = path_traced(tmp_path_factory.mktemp("matt"), (3,), samples=400_000)
    return reference.sum() / ours_of_three_bounces(room(), spots).sum()


def ours_of_three_bounces(built, spots):
    return Transport.of_scene(built).transients(np.tile(LASER, (len(spots), 1)), spots, EDGES_M / C_M_PER_S)


@pytest.mark.parametrize("roughness", [0.2, 0.4])
def test_a_glossy_room_agrees_at_three_bounces(tmp_path, unit, roughness):
    """The path tracer takes masking and shadowing as independent: 1 % darker at 60 degrees and roughness 0.4.

    The patches of this room are up to 11 cm long, which costs 0.4 % of the light at 0.2. With Ward's gloss
    likeness would be 0.972 and 0.991.
    """
    reference, spots = path_traced(tmp_path, (3,), roughness=roughness, samples=400_000)
    a, b = unit * ours_of_three_bounces(room(roughness), spots), reference[0]
    assert (a * b).sum() / np.sqrt((a**2).sum() * (b**2).sum()) > 0.999
    assert a.sum(axis=1) == pytest.approx(b.sum(axis=1), rel=0.02)
    assert a.sum() == pytest.approx(b.sum(), rel=0.01)
