"""Glossy surfaces: reciprocal, never brighter than what they receive, brightest at the mirror direction."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulators.scenes import Mesh, Scene, quads_mesh, scene
from simulators.transport.patches import tessellate
from simulators.transport.reflectance import gloss
from simulators.transport.three_bounces import ThreeBounces
from simulators.transport.visibility import occluders

UP = np.array([[0.0, 0.0, 1.0]])
direction = st.tuples(st.floats(0.0, 1.45), st.floats(0, 2 * np.pi)).map(lambda angles: towards(*angles))
roughness = st.floats(0.05, 0.95)


def towards(polar, around):
    return np.array([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)])


def over_lambert(alpha, retro, i, o, normal=UP):
    """By how much a patch at the origin sends more from i to o than a Lambertian one."""
    weight = np.ones(1)
    gloss(weight, np.zeros((1, 3)), normal, np.array([alpha]), np.array([retro]), 2.0 * i, 3.0 * o)
    return weight[0]


@given(direction, direction, roughness, st.booleans())
def test_reflectance_is_reciprocal_and_the_same_on_both_sides(i, o, alpha, retro):
    there = over_lambert(alpha, retro, i, o)
    assert there == pytest.approx(over_lambert(alpha, retro, o, i), rel=1e-9)
    assert there == pytest.approx(over_lambert(alpha, retro, i, o, -UP), rel=1e-9)
    assert there >= alpha * (1 - 1e-12)


@given(direction, direction)
def test_roughness_1_is_lambertian(i, o):
    assert over_lambert(1.0, False, i, o) == 1.0


@pytest.mark.parametrize("retro", [False, True])
@pytest.mark.parametrize("alpha", [0.1, 0.2, 0.4, 0.8])
def test_no_more_leaves_than_arrives(alpha, retro):
    """Integral of f cos over the hemisphere, in steps of 1 degree."""
    for polar in (0.0, 0.5, 1.0, 1.4):
        i, nodes = towards(polar, 0.3), 110
        total = 0.0
        square = (np.arange(nodes) + 0.5) / nodes * 2 - 1
        for x in square:  # the disk under the hemisphere: cos dOmega is its area
            for y in square[square**2 < 1 - x * x]:
                o = np.array([x, y, np.sqrt(1 - x * x - y * y)])
                total += over_lambert(alpha, retro, i, o) * (2 / nodes) ** 2 / np.pi
        assert total < 1.01
        if polar == 0.0:
            assert total > 1 - 0.35 * alpha  # steep facets send part of the lobe below the surface
    assert alpha <= total


@given(st.floats(0.1, 1.2), st.floats(0, 6.0), st.sampled_from([0.1, 0.3]))
def test_the_lobe_is_brightest_at_the_mirror_direction_or_back(polar, around, alpha):
    i = towards(polar, around)
    mirror = np.array([-i[0], -i[1], i[2]])
    for retro, peak in ((False, mirror), (True, i)):
        at_peak = over_lambert(alpha, retro, i, peak)
        assert at_peak > 2
        beside = [over_lambert(alpha, retro, i, towards(polar, around + turn)) for turn in (2.0, 4.0)]
        assert at_peak > max(beside)


def plate(alpha, retro=False):
    corners = np.array([[[-0.5, -0.4, 1.0], [0.5, -0.4, 1.0], [0.5, 0.4, 1.0], [-0.5, 0.4, 1.0]]])
    flat = quads_mesh("plate", corners)
    return Scene("plate", (Mesh("plate", flat.vertices_m, flat.faces, 0.8, alpha, retro),))


def sent(built, p, c):
    return ThreeBounces(tessellate(built), occluders(built.triangles_m), c).from_spot(p)[0]


@pytest.mark.parametrize(("retro", "at_x_m"), [(False, -0.05), (True, None)])
def test_a_glossy_plate_glints_where_a_mirror_would(retro, at_x_m):
    """Halfway between laser and detector; a retroreflector sends it nowhere else than back."""
    p, c = (0.4, 0.1, 0.0), (-0.5, -0.1, 0.0)
    ratio = sent(plate(0.1, retro), p, c) / sent(plate(1.0), p, c)
    if retro:
        assert ratio.max() < 0.2
        back = sent(plate(0.1, retro), p, p) / sent(plate(1.0), p, p)
        assert back.min() > 5
    else:
        brightest = tessellate(plate(0.1)).centre_m[ratio.argmax()]
        assert brightest[:2] == pytest.approx([at_x_m, 0.0], abs=0.02)
        assert ratio.max() > 20


def test_swapping_laser_and_detector_changes_nothing_for_glossy_scenes():
    built, p, c = scene("shelf").with_roughness(0.3), (0.7, -0.4, 0.0), (-0.3, 0.25, 0.0)
    assert sent(built, p, c) == pytest.approx(sent(built, c, p), rel=1e-9)


@pytest.mark.parametrize("alpha", [0.0, 0.01, 1.5])
def test_roughness_out_of_range_is_refused(alpha):
    with pytest.raises(ValueError, match=r"letter_F: roughness .* is not between 0.05 and 1"):
        scene("letters").with_roughness(alpha)


def test_albedo_out_of_range_is_refused():
    with pytest.raises(ValueError, match="m: albedo is not between 0 and 1"):
        Mesh("m", np.eye(3), np.array([[0, 1, 2]]), np.array([1.2]))
