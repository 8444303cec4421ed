"""A small stroke font: letters as disjoint convex quadrilaterals, for hidden scenes that can be read.

A letter is drawn on the reader's axes: u to the reader's right, v up, origin at the lower left corner.
"""

import numpy as np
from numpy.typing import NDArray

Quad = tuple[tuple[float, float], tuple[float, float], tuple[float, float], tuple[float, float]]

#: The letters that can be drawn.
ALPHABET = "4DEFHILNORSTUX"


def letter_quads(character: str, *, width_m: float, height_m: float, stroke_m: float) -> NDArray[np.float64]:
    """Draw one letter.

    Parameters
    ----------
    character
        One of `ALPHABET`.
    width_m, height_m
        Outer size [m].
    stroke_m
        Thickness of the strokes [m].

    Returns
    -------
    ndarray
        (Q, 4, 2) corners (u, v) [m] of convex quadrilaterals, counter-clockwise for the reader, with no area
        in common.

    Raises
    ------
    ValueError
        If the letter is unknown, or its strokes are too thick to leave it legible.
    """
    if character not in ALPHABET or len(character) != 1:
        raise ValueError(f"no letter {character!r} in the stroke font; it has {' '.join(ALPHABET)}")
    if not 0 < stroke_m <= min(width_m / 3, height_m / 5):
        raise ValueError(
            f"strokes of {stroke_m} m do not fit a letter {character!r} of {width_m} m x {height_m} m: "
            f"choose more than 0 and at most {min(width_m / 3, height_m / 5):.3g} m"
        )
    return np.array(_draw(character, width_m, height_m, stroke_m))


def _draw(character: str, w: float, h: float, s: float) -> list[Quad]:
    low, high = (h - s) / 2, (h + s) / 2  # the middle bar
    left, right = _bar(0, s, 0, h), _bar(w - s, w, 0, h)
    match character:
        case "I":
            return [_bar((w - s) / 2, (w + s) / 2, 0, h)]
        case "L":
            return [left, _bar(s, w, 0, s)]
        case "T":
            return [_bar(0, w, h - s, h), _bar((w - s) / 2, (w + s) / 2, 0, h - s)]
        case "F":
            return [left, _bar(s, w, h - s, h), _bar(s, 0.8 * w, low, high)]
        case "E":
            return [left, _bar(s, w, h - s, h), _bar(s, 0.8 * w, low, high), _bar(s, w, 0, s)]
        case "H":
            return [left, right, _bar(s, w - s, low, high)]
        case "U":
            return [left, right, _bar(s, w - s, 0, s)]
        case "N":
            return [left, right, ((s, h - 1.5 * s), (w - s, 0), (w - s, 1.5 * s), (s, h))]
        case "S":
            bars = [_bar(0, w, 0, s), _bar(0, w, low, high), _bar(0, w, h - s, h)]
            return [*bars, _bar(w - s, w, s, low), _bar(0, s, high, h - s)]
        case "D":
            return [left, *_bowl(s, w, 0, h, s)]
        case "O":
            return [*_bowl(w / 2, w, 0, h, s), *_turned(_bowl(w / 2, w, 0, h, s), w, h)]
        case "R":
            leg = 1.2 * s
            start = w - 1.3 * leg - (w - s) / 4
            slant = ((start, low), (w - leg, 0), (w, 0), (start + leg, low))
            return [left, *_bowl(s, w, low, h, s), (slant[1], slant[2], slant[3], slant[0])]
        case "X":
            return _cross(w, h, 1.2 * s)
        case _:
            return _four(w, h, s)


def _bar(u0: float, u1: float, v0: float, v1: float) -> Quad:
    return (u0, v0), (u1, v0), (u1, v1), (u0, v1)


def _turned(quads: list[Quad], w: float, h: float) -> list[Quad]:
    """Turn half a circle about the middle of the letter."""
    return [tuple((w - u, h - v) for u, v in quad) for quad in quads]  # type: ignore[misc]


def _bowl(u0: float, u1: float, v0: float, v1: float, s: float) -> list[Quad]:
    """Draw the right half of a D between two heights: two bars, an upright, and two bevelled corners."""
    b = min(1.5 * s, 0.45 * (v1 - v0), u1 - u0)  # size of the bevel
    return [
        _bar(u0, u1 - b, v0, v0 + s),
        ((u1 - b, v0), (u1, v0 + b), (u1 - s, v0 + b), (u1 - b, v0 + s)),
        _bar(u1 - s, u1, v0 + b, v1 - b),
        ((u1 - s, v1 - b), (u1, v1 - b), (u1 - b, v1), (u1 - b, v1 - s)),
        _bar(u0, u1 - b, v1 - s, v1),
    ]


def _cross(w: float, h: float, t: float) -> list[Quad]:
    """Draw an X: one whole diagonal of horizontal thickness t, the other cut in two by it."""
    k = w - t
    meet = (k - t) / (2 * k)  # height, as a fraction, where the inner edges of both diagonals meet
    lower: Quad = (k, 0), (w, 0), (t + k / 2, h / 2), (k * (1 - meet), meet * h)
    return [((0, 0), (t, 0), (w, h), (k, h)), lower, *_turned([lower], w, h)]


def _four(w: float, h: float, s: float) -> list[Quad]:
    """Draw a 4: an upright, a cross bar in two pieces, and a diagonal from the bar's left end to the top."""
    a, v = 0.6 * w, 0.25 * h
    run = min(1.2 * s, 0.9 * a)
    drop = run * (h - v - s) / a
    diagonal: Quad = (0, v + s), (run, v + s), (a, h - drop), (a, h)
    return [_bar(a, a + s, 0, h), _bar(0, a, v, v + s), _bar(a + s, w, v, v + s), diagonal]
