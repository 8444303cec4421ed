"""Letters cover the area they claim, once, and read right for the camera that looks out of the wall."""

import numpy as np
import pytest

from simulators.scenes import Scene, letter
from simulators.scenes.letters import ALPHABET, letter_quads

SIZES = [(0.45, 0.60, 0.09), (0.34, 0.50, 0.08), (0.30, 0.70, 0.05), (0.60, 0.50, 0.10)]

#: Hand-drawn 5 x 7 letters, to be read as printed here.
DRAWN = {
    "4": "...#. ..##. .#.#. #..#. ##### ...#. ...#.",
    "D": "####. #...# #...# #...# #...# #...# ####.",
    "E": "##### #.... #.... ####. #.... #.... #####",
    "F": "##### #.... #.... ####. #.... #.... #....",
    "H": "#...# #...# #...# ##### #...# #...# #...#",
    "I": "..#.. ..#.. ..#.. ..#.. ..#.. ..#.. ..#..",
    "L": "#.... #.... #.... #.... #.... #.... #####",
    "N": "#...# ##..# ##..# #.#.# #..## #..## #...#",
    "O": ".###. #...# #...# #...# #...# #...# .###.",
    "R": "####. #...# #...# ####. #.#.. #..#. #...#",
    "S": "##### #.... #.... ##### ....# ....# #####",
    "T": "##### ..#.. ..#.. ..#.. ..#.. ..#.. ..#..",
    "U": "#...# #...# #...# #...# #...# #...# #####",
    "X": "#...# #...# .#.#. ..#.. .#.#. #...# #...#",
}


def cross(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def bitmap(character):
    return np.array([[cell == "#" for cell in row] for row in DRAWN[character].split()], dtype=float)


def seen_from_the_wall(character, rows=7, columns=5, inside=20):
    """The letter as the camera draws it: x from large to small, y from top to bottom; (7, 5) coverage."""
    scene = Scene("one", (letter(character, centre_m=(0, 0, 1), width_m=0.5, height_m=0.7, stroke_m=0.1),))
    u = (np.arange(columns * inside) + 0.5) / (columns * inside) * 0.5 - 0.25
    v = 0.35 - (np.arange(rows * inside) + 0.5) / (rows * inside) * 0.7
    lit = np.isfinite(scene.depth_map(-u, v))
    return lit.reshape(rows, inside, columns, inside).mean(axis=(1, 3))


def likeness(a, b):
    a, b = a - a.mean(), b - b.mean()
    return (a * b).sum() / np.sqrt((a**2).sum() * (b**2).sum())


@pytest.mark.parametrize("character", ALPHABET)
@pytest.mark.parametrize(("width_m", "height_m", "stroke_m"), SIZES)
def test_quads_are_convex_counterclockwise_and_fill_the_box(character, width_m, height_m, stroke_m):
    quads = letter_quads(character, width_m=width_m, height_m=height_m, stroke_m=stroke_m)
    edges = np.roll(quads, -1, axis=1) - quads
    assert (cross(edges, np.roll(edges, -1, axis=1)) > 0).all()
    low, high = quads.min(axis=(0, 1)), quads.max(axis=(0, 1))
    assert low[1] == 0
    assert high[1] == pytest.approx(height_m)
    if character != "I":
        assert low[0] == pytest.approx(0)
        assert high[0] == pytest.approx(width_m)


@pytest.mark.parametrize("character", ALPHABET)
@pytest.mark.parametrize(("width_m", "height_m", "stroke_m"), SIZES)
def test_no_two_quads_overlap(character, width_m, height_m, stroke_m):
    """Convex shapes have no area in common exactly if one of their edges separates them."""
    quads = letter_quads(character, width_m=width_m, height_m=height_m, stroke_m=stroke_m)
    for i, one in enumerate(quads):
        for other in quads[i + 1 :]:
            separated = False
            for a, b in ((one, other), (other, one)):
                for start, edge in zip(a, np.roll(a, -1, axis=0) - a, strict=True):
                    separated |= (cross(edge, b - start) <= 1e-12).all()  # rounding of coordinates below 1 m
            assert separated, f"{character}: {one} overlaps {other}"


@pytest.mark.parametrize("character", ALPHABET)
def test_mesh_area_is_the_sum_of_the_quads(character):
    quads = letter_quads(character, width_m=0.45, height_m=0.6, stroke_m=0.09)
    shoelace = 0.5 * cross(quads, np.roll(quads, -1, axis=1)).sum()
    mesh = letter(character, centre_m=(0.3, -0.1, 1.2))
    a, b, c = np.moveaxis(mesh.triangles_m, 1, 0)
    assert 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() == pytest.approx(shoelace, rel=1e-12)


@pytest.mark.parametrize("character", ALPHABET)
def test_reads_right_for_the_camera(character):
    """Among all letters and all mirrored letters, drawn by hand, each looks most like itself."""
    seen = seen_from_the_wall(character)
    score = {other: likeness(seen, bitmap(other)) for other in ALPHABET}
    mirrored = {f"mirrored {other}": likeness(seen, bitmap(other)[:, ::-1]) for other in "4DEFLNRS"}
    best = max({**score, **mirrored}.items(), key=lambda item: item[1])
    assert best[0] == character, best


def test_the_arms_of_f_point_to_minus_x():
    mesh = letter("F", centre_m=(0.0, 0.0, 1.0))
    lower_half = mesh.vertices_m[mesh.vertices_m[:, 1] < -0.1]  # only the stem reaches down there
    assert lower_half[:, 0].min() > 0.1
    assert mesh.vertices_m[:, 0].min() == pytest.approx(-0.225)


def test_unknown_letters_and_fat_strokes_are_refused():
    with pytest.raises(ValueError, match="no letter 'Q'"):
        letter_quads("Q", width_m=0.4, height_m=0.6, stroke_m=0.08)
    with pytest.raises(ValueError, match=r"at most 0\.1 m"):
        letter_quads("F", width_m=0.3, height_m=0.6, stroke_m=0.11)
