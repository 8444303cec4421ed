"""Glossy surfaces: reciprocal, never brighter than what they receive, brightest at the mirror direction."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulators.scenes import Mesh, Scene, quads_mesh, scene
from simulators.transport.patches import tessellate
from simulators.transport.reflectance import gloss
from simulators.transport.three_bounces import ThreeBounces
from simulators.transport.visibility import occluders

UP = np.array([[0.0, 0.0, 1.0]])
direction = st.tuples(st.floats(0.0, 1.45), st.floats(0, 2 * np.pi)).map(lambda angles: towards(*angles))
roughness = st.floats(0.05, 0.95)
models = pytest.mark.parametrize("model", ["ward", "ggx"])


def towards(polar, around):
    return np.array([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)])


def over_lambert(model, alpha, i, o, *, retro=False, normal=UP):
    """By how much a patch at the origin sends more from i to o than a Lambertian one."""
    weight = np.ones(1)
    looks = np.array([alpha]), np.array([retro]), np.array([model == "ggx"])
    gloss(weight, np.zeros((1, 3)), normal, *looks, 2.0 * i, 3.0 * o)
    return weight[0]


@models
@settings(deadline=None)  # the first call compiles
@given(direction, direction, roughness, st.booleans())
def test_reflectance_is_reciprocal_and_the_same_on_both_sides(model, i, o, alpha, retro):
    there = over_lambert(model, alpha, i, o, retro=retro)
    assert there == pytest.approx(over_lambert(model, alpha, o, i, retro=retro), rel=1e-9)
    assert there == pytest.approx(over_lambert(model, alpha, i, o, retro=retro, normal=-UP), rel=1e-9)
    assert there >= alpha * (1 - 1e-12)


@models
@settings(deadline=None)
@given(direction, direction)
def test_roughness_1_is_lambertian(model, i, o):
    assert over_lambert(model, 1.0, i, o) == 1.0


@models
@pytest.mark.parametrize("retro", [False, True])
@pytest.mark.parametrize("alpha", [0.1, 0.2, 0.4, 0.8])
def test_no_more_leaves_than_arrives(model, alpha, retro):
    """Integral of f cos over the hemisphere, in steps of 1 degree."""
    for polar in (0.0, 0.5, 1.0, 1.4):
        i, nodes = towards(polar, 0.3), 110
        total = 0.0
        square = (np.arange(nodes) + 0.5) / nodes * 2 - 1
        for x in square:  # the disk under the hemisphere: cos dOmega is its area
            for y in square[square**2 < 1 - x * x]:
                o = np.array([x, y, np.sqrt(1 - x * x - y * y)])
                total += over_lambert(model, alpha, i, o, retro=retro) * (2 / nodes) ** 2 / np.pi
        assert total < 1.01
        if polar == 0.0:
            assert total > 1 - 0.35 * alpha  # steep facets send part of the lobe below the surface
    assert alpha <= total


@models
@settings(deadline=None)
@given(st.floats(0.1, 1.2), st.floats(0, 6.0), st.sampled_from([0.1, 0.3]))
def test_the_lobe_is_brightest_at_the_mirror_direction_or_back(model, polar, around, alpha):
    i = towards(polar, around)
    mirror = np.array([-i[0], -i[1], i[2]])
    for retro, peak in ((False, mirror), (True, i)):
        at_peak = over_lambert(model, alpha, i, peak, retro=retro)
        assert at_peak > 2
        beside = [
            over_lambert(model, alpha, i, towards(polar, around + turn), retro=retro) for turn in (2.0, 4.0)
        ]
        assert at_peak > max(beside)


def plate(alpha, model="ward", *, retro=False):
    corners = np.array([[[-0.5, -0.4, 1.0], [0.5, -0.4, 1.0], [0.5, 0.4, 1.0], [-0.5, 0.4, 1.0]]])
    flat = quads_mesh("plate", corners)
    return Scene("plate", (Mesh("plate", flat.vertices_m, flat.faces, 0.8, alpha, retro, model),))


def sent(built, p, c, edge_m=None):
    return ThreeBounces(tessellate(built, edge_m), occluders(built.triangles_m), c).from_spot(p)[0]


@pytest.mark.parametrize(("model", "elsewhere"), [("ward", 0.2), ("ggx", 0.4)])
@pytest.mark.parametrize(("retro", "at_x_m"), [(False, -0.05), (True, None)])
def test_a_glossy_plate_glints_where_a_mirror_would(model, elsewhere, retro, at_x_m):
    """Halfway between laser and detector; a retroreflector sends it back.

    Little of it goes on to the other spot: 0.1 as by a Lambertian surface, nothing by Ward's facets of the
    slopes that this needs, 0.3 and more, and up to pi D / 4 = 0.3 by those of GGX.
    """
    p, c = (0.4, 0.1, 0.0), (-0.5, -0.1, 0.0)
    ratio = sent(plate(0.1, model, retro=retro), p, c) / sent(plate(1.0), p, c)
    if retro:
        assert ratio.max() < elsewhere
        back = sent(plate(0.1, model, retro=retro), p, p) / sent(plate(1.0), p, p)
        assert back.min() > 5
    else:
        brightest = tessellate(plate(0.1)).centre_m[ratio.argmax()]
        assert brightest[:2] == pytest.approx([at_x_m, 0.0], abs=0.02)
        assert ratio.max() > 20


@models
def test_swapping_laser_and_detector_changes_nothing_for_glossy_scenes(model):
    built, p, c = scene("shelf").with_roughness(0.3), (0.7, -0.4, 0.0), (-0.3, 0.25, 0.0)
    built = built.with_gloss(model)
    assert sent(built, p, c) == pytest.approx(sent(built, c, p), rel=1e-9)


def test_every_mesh_of_a_scene_keeps_its_own_gloss():
    """The same plate twice, neither hiding the other: each sends what it sends alone."""
    p, c, edge_m = (0.4, 0.1, 0.0), (-0.5, -0.1, 0.0), 0.05
    alone = {model: plate(0.2, model) for model in ("ward", "ggx")}
    patches = tessellate(Scene("both", tuple(built.meshes[0] for built in alone.values())), edge_m)
    together = ThreeBounces(patches, occluders(np.empty((0, 3, 3))), c).from_spot(p)[0]
    for (model, built), of_model in zip(alone.items(), (~patches.ggx, patches.ggx), strict=True):
        assert together[of_model] == pytest.approx(sent(built, p, c, edge_m), rel=1e-12), model
    assert not np.allclose(together[patches.ggx], together[~patches.ggx], rtol=0.1)


@pytest.mark.parametrize("alpha", [0.0, 0.01, 1.5])
def test_roughness_out_of_range_is_refused(alpha):
    with pytest.raises(ValueError, match=r"letter_F: roughness .* is not between 0.05 and 1"):
        scene("letters").with_roughness(alpha)


def test_a_gloss_that_does_not_exist_is_refused():
    with pytest.raises(ValueError, match="letter_F: there is no gloss 'phong'; choose ward or ggx"):
        scene("letters").with_gloss("phong")


def test_albedo_out_of_range_is_refused():
    with pytest.raises(ValueError, match="m: albedo is not between 0 and 1"):
        Mesh("m", np.eye(3), np.array([[0, 1, 2]]), np.array([1.2]))
