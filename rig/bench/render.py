"""Rendering a hidden scene: what a scan of it would give on average, without noise and instrument."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.bench.simulated import renderer, true_geometry
from rig.errors import UsageError, command_line
from rig.files.description import ScanDescription
from rig.files.writer import ScanWriter
from rig.model.config import RigConfig
from rig.model.plan import ScanPlan
from rig.model.state import RigState

#: Positions that are rendered at a time: 8 MB of 15 000 bins, and work enough for all cores. Fewer of more
#: bins, so that they are no more than so many values.
BLOCK, _BLOCK_VALUES = 64, 2**22


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
    rig.errors.RefusedError
        If the plan has no positions.
    rig.errors.ConfigError
        If there is no such scene.
    """
    if target.exists():
        raise UsageError(f"{target} exists and is not overwritten; give another name, or move it away")
    plan.require_positions()
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
        command=command_line(),
        dtype="<f4",
    )
    photons = 0.0
    with ScanWriter.whole(target, description) as writer:
        for block in _blocks(plan, config, axis):
            writer.extend(block)
            photons += float(block.sum())
            progress(writer.appended / len(plan))
        writer.close("complete", "all positions rendered")
    return photons


def even_grid(columns: int, rows: int, width_m: float, height_m: float) -> NDArray[np.float64]:
    """Return (columns * rows, 3) spots in the middles of equal parts of a wall, row by row."""
    x_m = ((np.arange(columns) + 0.5) / columns - 0.5) * width_m
    y_m = ((np.arange(rows) + 0.5) / rows - 0.5) * height_m
    x_m, y_m = np.meshgrid(x_m, y_m)
    return np.stack([x_m, y_m, np.zeros_like(x_m)], axis=-1).reshape(-1, 3)


def render_each_with_each(
    laser_m: NDArray[np.float64],
    pixel_m: NDArray[np.float64],
    config: RigConfig,
    axis: TimeAxis,
    target: Path,
    progress: Callable[[float], None] = lambda fraction: None,
) -> float:
    """Write the expected transients of each laser spot at each pixel; as `render` in all else.

    Steps of the file are lasers, channels are pixels. Two lasers are in memory.

    Parameters
    ----------
    laser_m, pixel_m
        (L, 3) and (D, 3) spots on the wall.
    config, axis, target, progress
        As of `render`; the detector's own spots are not used.
    """
    from simulators.transport.each_with_each import EachWithEach

    if target.exists():
        raise UsageError(f"{target} exists and is not overwritten; give another name, or move it away")
    description = ScanDescription(
        laser_m=laser_m,
        detector_m=pixel_m[None],
        bins=axis.bins,
        bin_width_s=axis.bin_width_s,
        first_bin_s=0.0,
        state=RigState(config),
        simulated=True,
        command=command_line(),
        dtype="<f4",
    )
    counted_m2 = _counted_m2(config, config.scan.exposure_s, pixel_m)
    photons = 0.0
    with ScanWriter.whole(target, description) as writer:
        scene = EachWithEach(renderer(config), pixel_m)

        def rendered(laser: int) -> NDArray[np.float64]:
            light = scene.transients(tuple(laser_m[laser].tolist()), axis.bins, axis.bin_width_s)
            return light * counted_m2[:, None]

        with ThreadPoolExecutor(1) as ahead:
            following = ahead.submit(rendered, 0)
            for laser in range(len(laser_m)):
                step = following.result()
                if laser + 1 < len(laser_m):
                    following = ahead.submit(rendered, laser + 1)
                writer.append(step)
                photons += float(step.sum())
                progress((laser + 1) / len(laser_m))
        writer.close("complete", "all positions rendered")
    return photons


def _blocks(plan: ScanPlan, config: RigConfig, axis: TimeAxis) -> Iterator[NDArray[np.float64]]:
    """Yield (steps, channels, bins) expected photons."""
    from simulators.transport.light_paths import transients

    scene = renderer(config)
    of_channels = [scene.light_paths(channel.spot_m) for channel in config.channels]
    edges_s = axis.bin_width_s * np.arange(axis.bins + 1, dtype=np.float64)
    spots_m = np.array([channel.spot_m for channel in config.channels])
    counted_m2 = _counted_m2(config, plan.passes[0].exposure_s, spots_m)

    step = max(1, min(BLOCK, _BLOCK_VALUES // (axis.bins * len(of_channels))))

    def rendered(first: int) -> NDArray[np.float64]:
        spots_m = plan.spots_m[first : first + step]
        light = [transients(paths, spots_m, edges_s) for paths in of_channels]
        return np.stack(light, axis=1) * counted_m2[:, None]

    with ThreadPoolExecutor(1) as ahead:
        following = ahead.submit(rendered, 0)
        for first in range(step, len(plan) + step, step):
            block = following.result()
            following = ahead.submit(rendered, first)
            yield block


def _counted_m2(config: RigConfig, exposure_s: float, spots_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return photons counted in an exposure if all of the laser's came, per m^2, to each detector spot."""
    from simulators.detector import Detector
    from simulators.optics.light import Optics

    optics, head_m = Optics(), true_geometry(config).detector_head_m
    per_photon_m2 = np.array([optics.collection_m2(head_m, tuple(spot_m)) for spot_m in spots_m.tolist()])
    photons = optics.photons_per_s * config.laser.fraction_of_full * exposure_s
    return photons * Detector().efficiency * per_photon_m2
