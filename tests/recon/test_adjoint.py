"""<A e, f> = <e, A* f> for the propagation from the wall to a plane, on random fields."""

import numpy as np
import pytest

from recon.aperture import recognise
from recon.grid import VoxelGrid
from recon.solvers.fresnel import FresnelPropagator
from recon.solvers.rsd.regular import LatticePropagator
from recon.wave import VirtualPulse
from support.hidden_points import wall


@pytest.mark.parametrize("legs", [1, 2])
@pytest.mark.parametrize(
    ("x_m", "y_m"),
    [
        (-0.11 + 0.02 * np.arange(12), -0.09 + 0.02 * np.arange(10)),
        (0.05 + 0.017 * np.arange(9), -0.2 + 0.031 * np.arange(7)),
        (np.array([0.3]), np.array([0.0])),
    ],
    ids=["on-lattice", "between", "one-voxel"],
)
@pytest.mark.parametrize("kind", [LatticePropagator, FresnelPropagator])
def test_dot_products_agree(kind, x_m, y_m, legs):
    random = np.random.default_rng(5)

    def draw(*shape):
        return (random.normal(size=shape) + 1j * random.normal(size=shape)).astype(np.complex64)

    laser_m = np.concatenate([wall(12, 10, 0.02), wall(4, 2, 0.02)])[random.permutation(126)]  # some repeated
    band = VirtualPulse(0.08).band(5e-9)
    emitted = draw(len(band), len(laser_m))
    grid = VoxelGrid(x_m, y_m, np.array([0.4]))
    forward = kind(recognise(laser_m), emitted, band, grid, legs)
    fields = draw(len(band), len(y_m), len(x_m))
    there = forward.fields(0.4)
    back = forward.adjoint(0.4, fields)
    for e, af, ae, f in zip(emitted, back, there, fields, strict=True):
        # Single precision of a transform of some thousand points, of terms that may cancel.
        assert abs(np.vdot(ae, f) - np.vdot(e, af)) < 1e-5 * np.linalg.norm(ae) * np.linalg.norm(f)
