"""Three to five bounces in one hidden scene: a `simulators.transport.light_paths.Renderer`."""

from typing import Self

import numpy as np
from numpy.typing import NDArray

from simulators.parallel import parallel_for
from simulators.scenes import Scene
from simulators.transport.extra_bounces import Interreflections
from simulators.transport.light_paths import LightPaths, Spot, transients
from simulators.transport.patches import Patches, tessellate
from simulators.transport.three_bounces import ThreeBounces
from simulators.transport.visibility import occluders

#: How many bounces can be followed: wall, one to three surfaces (the second of three may be the wall), wall.
BOUNCES = (3, 4, 5)


class Transport:
    """All bounces that are asked for, in one scene.

    Parameters
    ----------
    patches
        Surfaces of the scene, cut small.
    triangles_m
        (T, 3, 3) triangles that block light [m]; they may be coarser than the patches.
    bounces
        3, 4 or 5; the higher ones add to the lower.
    wall_albedo
        What the relay wall reflects in the middle of five bounces.

    Attributes
    ----------
    patches, blockers
        Surfaces, and what hides light.
    between
        The exchange of light inside the scene; None with three bounces.

    Raises
    ------
    ValueError
        If ``bounces`` is none of these.
    """

    def __init__(
        self,
        patches: Patches,
        triangles_m: NDArray[np.float64],
        *,
        bounces: int = 3,
        wall_albedo: float = 0.8,
    ) -> None:
        if bounces not in BOUNCES:
            raise ValueError(f"{bounces} bounces cannot be followed: choose 3, 4 or 5")
        self.patches = patches
        self.blockers = occluders(triangles_m)
        self.between = Interreflections(patches, self.blockers, bounces, wall_albedo) if bounces > 3 else None

    @classmethod
    def of_scene(cls, scene: Scene, *, bounces: int = 3, wall_albedo: float = 0.8) -> Self:
        """Cut a scene into patches and follow light in it."""
        return cls(tessellate(scene), scene.triangles_m, bounces=bounces, wall_albedo=wall_albedo)

    def light_paths(self, detector_spot_m: Spot) -> tuple[LightPaths, ...]:
        """Return light to one detector spot: that of three bounces, and that of more."""
        three = ThreeBounces(self.patches, self.blockers, detector_spot_m)
        return (three, self.between.light_paths(detector_spot_m)) if self.between else (three,)

    def transients(
        self, laser_m: NDArray[np.float64], detector_m: NDArray[np.float64], edges_s: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the noise-free transients of a capture, or of a part of its rows, without any instrument.

        Parameters
        ----------
        laser_m
            (P, 3) laser spots [m].
        detector_m
            (1, 3) one detector spot for all, or (P, 3) one for each, e.g. ``laser_m`` for a confocal capture;
            for several detectors call once for each [m].
        edges_s
            (B + 1,) ascending bin edges; time zero is the pulse leaving the wall [s].

        Returns
        -------
        ndarray
            (P, B), see `simulators.transport.light_paths.transients`.

        Raises
        ------
        ValueError
            If there are neither one nor P detector spots.
        """
        if len(detector_m) not in (1, len(laser_m)):
            raise ValueError(
                f"{len(detector_m)} detector spots for {len(laser_m)} laser spots: give one, or as many"
            )
        if len(detector_m) == 1:
            return transients(self.light_paths(tuple(detector_m[0])), laser_m, edges_s)
        rows = np.zeros((len(laser_m), len(edges_s) - 1))

        def fill(index: int) -> None:
            for paths in self.light_paths(tuple(detector_m[index])):
                rows[index] += paths.transient(tuple(laser_m[index]), edges_s)

        parallel_for(fill, len(laser_m))
        return rows
