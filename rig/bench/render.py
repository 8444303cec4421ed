"""Rendering a hidden scene: what a scan of it would give on average, without noise and instrument."""

import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rig.atomic import appearing
from rig.bench.simulated import hidden_scene, true_geometry
from rig.errors import UsageError
from rig.files.description import ScanDescription
from rig.files.writer import ScanWriter
from rig.model.config import RigConfig, SimulationConfig
from rig.model.plan import ScanPlan
from rig.model.state import RigState

if TYPE_CHECKING:
    pass

#: Positions that are rendered at a time: 8 MB of 15 000 bins, and work enough for all cores.
BLOCK = 64


@dataclass(frozen=True)
class TimeAxis:
    """Bins of the rendered transients, from the pulse on the wall on.

    Attributes
    ----------
    bins, bin_width_s
        Number and width.
    """

    bins: int
    bin_width_s: float


def render(
    plan: ScanPlan,
    config: RigConfig,
    axis: TimeAxis,
    target: Path,
    progress: Callable[[float], None] = lambda fraction: None,
) -> float:
    """Write the expected transients of a plan on the simulated rig as a scan file, in rectified time.

    They are the photons that an ideal detector without a gate, of the simulated one's efficiency, would count
    of the hidden scene in the plan's exposure. The next block is rendered while the last is written.

    Parameters
    ----------
    plan, config, axis
        Where, of what, and how finely in time.
    target
        The scan file to make; it appears when it is whole.
    progress
        Called with the fraction that is done.

    Returns
    -------
    float
        Expected photons, all positions together.

    Raises
    ------
    rig.errors.UsageError
        If ``target`` exists, or its folder does not.
    rig.errors.ConfigError
        If there is no such scene.
    """
    if target.exists():
        raise UsageError(f"{target} exists and is not overwritten; give another name, or move it away")
    state = RigState(config)
    description = ScanDescription(
        laser_m=plan.spots_m,
        detector_m=np.array([[channel.spot_m for channel in state.channels]]),
        bins=axis.bins,
        bin_width_s=axis.bin_width_s,
        first_bin_s=0.0,
        channels=state.channels,
        state=state,
        simulated=True,
        command=" ".join(["rig", *sys.argv[1:]]),
        dtype="<f4",
    )
    photons = 0.0
    with appearing(target) as partial, ScanWriter.create(partial, description) as writer:
        for block in _blocks(plan, config, axis):
            for row in block:
                writer.append(row)
            photons += float(block.sum())
            progress(writer.appended / len(plan))
        writer.close("complete", "all positions rendered")
    return photons


def _blocks(plan: ScanPlan, config: RigConfig, axis: TimeAxis) -> Iterator[NDArray[np.float64]]:
    from simulators.optics.light import Optics
    from simulators.transport.geometry import cut
    from simulators.transport.renderer import Transport, along

    hidden = hidden_scene(config)
    bounces = (config.simulation or SimulationConfig()).bounces
    transport = Transport(cut(hidden), hidden.triangles_m, bounces=bounces, wall_albedo=Optics().wall_albedo)
    of_channels = [transport.towards(channel.spot_m) for channel in config.channels]
    edges_s = axis.bin_width_s * np.arange(axis.bins + 1, dtype=np.float64)
    counted_m2 = _counted_m2(config, plan.passes[0].exposure_s)

    def rendered(first: int) -> NDArray[np.float64]:
        spots_m = plan.spots_m[first : first + BLOCK]
        return counted_m2 * np.stack([along(ways, spots_m, edges_s) for ways in of_channels], axis=1)

    with ThreadPoolExecutor(1) as ahead:
        following = ahead.submit(rendered, 0)
        for first in range(BLOCK, len(plan) + BLOCK, BLOCK):
            block = following.result()
            following = ahead.submit(rendered, first)
            yield block


def _counted_m2(config: RigConfig, exposure_s: float) -> float:
    """Return photons counted in an exposure if all of the laser's came, per m^2, to the detector's spot."""
    from simulators.detector import Detector
    from simulators.optics.light import Optics

    optics = Optics()
    per_photon_m2 = optics.collection_m2(true_geometry(config)) * Detector().efficiency
    return optics.photons_per_s * per_photon_m2 * config.laser.power_setpoint / 10 * exposure_s
