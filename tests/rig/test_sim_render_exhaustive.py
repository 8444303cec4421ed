"""Each laser with each pixel is rendered as each pair by itself, and read and imaged laser by laser."""

import numpy as np
import pytest

from simulators.scenes import scene
from simulators.transport.each_with_each import EachWithEach
from simulators.transport.renderer import Transport
from support.hidden_points import wall

LASERS, PIXELS = wall(2, 2, 0.4), wall(5, 4, 0.2, (0.03, 0.0))
WIDTH_S, BINS = 64e-12, 250


@pytest.mark.parametrize(("bounces", "roughness"), [(3, 1.0), (3, 0.4), (4, 1.0)])
def test_all_pairs_are_each_pair_by_itself(bounces, roughness):
    """Form factors are kept in single precision, and light over all bins of a record adds up: 2e-7.

    Light of more bounces is summed up from the laser, which is where another renderer has its detector.
    """
    built = scene("point" if roughness < 1 else "letter-plane").with_roughness(roughness)
    light = Transport.of_scene(built, bounces=bounces)
    each, edges_s = EachWithEach(light, PIXELS), WIDTH_S * np.arange(BINS + 1)
    for spot_m in LASERS[:2]:
        found = each.transients(tuple(spot_m), BINS, WIDTH_S)
        wanted = light.transients(PIXELS, spot_m[None], edges_s)
        np.testing.assert_allclose(found, wanted, rtol=1e-5, atol=1e-6 * wanted.max())
        assert wanted.any(axis=1).all()
