"""Light from each of many laser spots to each of many detector spots: an exhaustive capture, laser by laser.

For three bounces the light of a pair is a sum over patches of a part of the laser's and a part of the
detector's spot (`simulators.transport.three_bounces`),

    h(l, d, t) = sum_k a_k(l) b_k(d) delta(t - (r_lk + r_kd)/c) ,

so that visibility and form factors are of each spot with the patches, (L + D) K of them, and only the sum is
of all pairs, L D K. More bounces are summed up backwards to the laser spot, of which there are fewer: light
goes either way alike (Helmholtz).
"""

from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simulators.constants import C_M_PER_S
from simulators.parallel import parallel_for
from simulators.transport.light_paths import Spot
from simulators.transport.reflectance import gloss
from simulators.transport.three_bounces import add_patch, corner_legs, form_factors_from

if TYPE_CHECKING:
    from simulators.transport.renderer import Transport

#: Detector spots that one core takes at a time.
SPOTS = 256


class EachWithEach:
    """Transients of any laser spot at all detector spots.

    Parameters
    ----------
    scene
        What follows the light.
    detector_m
        (D, 3) spots on the wall [m]. For each and each patch 4 bytes are kept.
    """

    def __init__(self, scene: "Transport", detector_m: NDArray[np.float64]) -> None:
        self._scene = scene
        self._detector_m = np.ascontiguousarray(detector_m, np.float64)
        patches = scene.patches
        self._forms = np.empty((len(detector_m), len(patches.area_m2)), np.float32)

        def see(number: int) -> None:
            self._forms[number], _ = form_factors_from(patches, scene.blockers, self._detector_m[number])

        parallel_for(see, len(detector_m))
        self._glossy = bool((patches.roughness < 1).any())

    def transients(self, laser_spot_m: Spot, bins: int, bin_width_s: float) -> NDArray[np.float64]:
        """Return (D, B) photons per m^2 at each detector spot, for one that leaves the laser spot.

        Parameters
        ----------
        laser_spot_m
            Where the pulse is on the wall at t = 0 [m].
        bins, bin_width_s
            Number B and width of the bins, from t = 0 on.
        """
        rows = np.zeros((len(self._detector_m), bins))
        self._add_three(np.array(laser_spot_m, np.float64), bin_width_s * C_M_PER_S, rows)
        if self._scene.between is not None:
            self._add_more(laser_spot_m, bin_width_s * np.arange(bins + 1, dtype=np.float64), rows)
        return rows

    def _add_three(self, spot: NDArray[np.float64], width_m: float, rows: NDArray[np.float64]) -> None:
        patches = self._scene.patches
        form, _ = form_factors_from(patches, self._scene.blockers, spot)
        reflecting = form * patches.area_m2 * patches.albedo
        legs_m = corner_legs(spot, patches.corners_m)
        looks = patches.roughness, patches.retro, patches.ggx

        def add(run: int) -> None:
            some = slice(run * SPOTS, (run + 1) * SPOTS)
            spots_m, forms = self._detector_m[some], self._forms[some]
            weights = np.maximum(forms * reflecting, 0.0)
            if self._glossy:
                for weight, spot_m in zip(weights, spots_m, strict=True):
                    gloss(weight, patches.centre_m, patches.normal, *looks, spot, spot_m)
            _deposit(weights, legs_m, patches.corners_m, spots_m, 1 / width_m, rows[some])

        parallel_for(add, -(-len(rows) // SPOTS))

    def _add_more(self, laser_spot_m: Spot, edges_s: NDArray[np.float64], rows: NDArray[np.float64]) -> None:
        assert self._scene.between is not None
        to_laser = self._scene.between.light_paths(laser_spot_m)

        def add(number: int) -> None:
            rows[number] += to_laser.transient_seen(self._forms[number], self._detector_m[number], edges_s)

        parallel_for(add, len(rows))


@njit(cache=True, error_model="numpy", nogil=True)
def _deposit(weights, legs, corners, spots, bins_per_m, rows):  # type: ignore[no-untyped-def]
    """Add every patch's weight (D, K) to the bins (D, B) that its paths cross, linear between its corners."""
    a = np.empty(3)
    for d in range(len(spots)):
        for k in range(len(legs)):
            if weights[d, k] == 0.0:
                continue
            for corner in range(3):
                square = 0.0
                for axis in range(3):
                    square += (corners[k, corner, axis] - spots[d, axis]) ** 2
                a[corner] = (legs[k, corner] + np.sqrt(square)) * bins_per_m
            add_patch(weights[d, k], a[0], a[1], a[2], rows[d])
