"""A mesh as the hidden scene: how large it is, where it lies, and whether the scan can see it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.capture import C_M_PER_S
from rig.bench.simulated import hidden_scene
from rig.errors import RefusedError
from rig.model.config import RigConfig
from rig.model.quantities import show_length


@dataclass(frozen=True)
class Hidden:
    """What is said of a mesh before it is scanned.

    Attributes
    ----------
    words
        Its size and its place, in a line.
    warnings
        What of it will not be seen, with numbers and a remedy.
    """

    words: str
    warnings: tuple[str, ...]


def looked_at(
    config: RigConfig,
    laser_m: NDArray[np.float64],
    detector_m: Sequence[tuple[float, float, float]] | NDArray[np.float64],
    record_s: tuple[float, float],
) -> Hidden | None:
    """Look at the mesh that a configuration names, placed; None where the scene is built in.

    Distances are those of its bounding box, so that what is refused is not seen for sure.

    Parameters
    ----------
    config
        Of a simulated rig.
    laser_m, detector_m
        (P, 3) and (C, 3) spots on the wall.
    record_s
        Begin and end of the record, in rectified time.

    Raises
    ------
    rig.errors.ConfigError
        If the mesh cannot be read, or all of it is on or behind the wall.
    rig.errors.RefusedError
        If nothing of it is in the record.
    """
    simulation = config.simulation
    if simulation is None or simulation.mesh is None:
        return None
    triangles_m, name = hidden_scene(config).triangles_m, simulation.mesh.name
    low_m, high_m = triangles_m.min(axis=(0, 1)), triangles_m.max(axis=(0, 1))
    nearest_m, farthest_m = _paths_m(low_m, high_m, laser_m, np.asarray(detector_m))
    begin_m, end_m = (C_M_PER_S * at_s for at_s in record_s)
    half_m = (high_m[2] - low_m[2]) / 2
    if nearest_m > end_m or farthest_m < begin_m:
        depth_m = max((begin_m + end_m) / 4, half_m + 0.1)
        raise RefusedError(
            f"{name} would not be measured at all: light to it and back takes {nearest_m:.2f} to "
            f"{farthest_m:.2f} m of path, the record holds {max(begin_m, 0):.2f} to {end_m:.2f} m. Place its "
            f"middle at a depth of {depth_m:.2g} m, e.g. --place 0cm,0cm,{depth_m:.2g}m, or scale it"
        )
    warnings = []
    if low_m[2] < 0:
        warnings.append(
            f"part of {name} is behind the wall, which is at z = 0: it begins at z = {show_length(low_m[2])}"
            f". That part is not seen; place its middle at a depth of {half_m + 0.1:.2g} m or more"
        )
    if farthest_m > end_m:
        warnings.append(
            f"light to the farthest of {name} and back takes up to {farthest_m:.2f} m of path, and the "
            f"record ends at {end_m:.2f} m: what is deeper than about {end_m / 2:.2f} m is not seen"
        )
    return Hidden(_in_words(name, low_m, high_m, len(triangles_m)), tuple(warnings))


def _in_words(name: str, low_m: NDArray, high_m: NDArray, triangles: int) -> str:
    size = " x ".join(show_length(side_m) for side_m in (high_m - low_m).round(6))
    where = ", ".join(
        f"{axis} {low:.2f} to {high:.2f} m" for axis, low, high in zip("xyz", low_m, high_m, strict=True)
    )
    return f"{name}: {size}, {where}; {triangles:,} triangles"


def _paths_m(
    low_m: NDArray[np.float64], high_m: NDArray[np.float64], *ends_m: NDArray[np.float64]
) -> tuple[float, float]:
    """Return bounds of the way from a spot of one end to a box, and on to a spot of the other."""
    nearest_m = farthest_m = 0.0
    for spots_m in ends_m:
        outside_m = np.maximum(np.maximum(low_m - spots_m, spots_m - high_m), 0)
        across_m = np.maximum(high_m - spots_m, spots_m - low_m)
        nearest_m += float(np.linalg.norm(outside_m, axis=1).min())
        farthest_m += float(np.linalg.norm(across_m, axis=1).max())
    return nearest_m, farthest_m
