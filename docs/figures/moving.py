"""Draw docs/images/moving.gif: a hidden 4 that moves at 0.3 m/s, 5 frames a second.

The rig is that of configs/video.toml, but for the time of turns between lines: 190 x 22 laser spots, 50 us
each, 28 pixels at 205,000 counts a second on average. Its photons are drawn point by point at their bench
times, which takes one to two minutes of computer time a frame, and kept in a folder; then frames are imaged
one after the other.

    python docs/figures/moving.py FOLDER docs/images/moving.gif
"""

import sys
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy.ndimage import gaussian_filter

from recon.accumulate import likeness
from recon.capture import ArrayHistograms, Capture
from recon.depth import compensate_falloff, front_view
from recon.frames import FrameImager
from recon.grid import VoxelGrid
from recon.sparse import Photons
from recon.wave import VirtualPulse
from rig.bench.simulated import simulated_bench
from rig.files.volume import Volume
from rig.model.config import RigConfig, load
from rig.model.plan import ScanPlan
from rig.model.state import RigState
from rig.show.video import save_video
from simulators.bench import LightState
from simulators.scenes import scene

CONFIG = Path(__file__).parents[2] / "configs" / "video.toml"
POINT_S, FRAMES = 50e-6, 10
PULSE = VirtualPulse(0.08)
GRID = VoxelGrid.from_spec(1.9, 1.9, 0.019, (0.8, 1.4, 0.05))


def drawn(config: RigConfig, plan: ScanPlan, number: int) -> Photons:
    """Draw a frame's photons, point by point and pixel by pixel."""
    bench, gate = simulated_bench(config, real_time=False), config.detector
    light = LightState(
        emitting=True, biased=True, gated=True, gate_delay_s=gate.gate_delay_s, gate_width_s=gate.gate_width_s
    )
    tcspc, rng = config.tcspc, np.random.default_rng([5, number])
    assert tcspc.kind == "hydraharp"
    found: list[np.ndarray] = []
    for point, spot_m in enumerate(map(tuple, plan.spots_m.tolist())):
        at_s = (number * len(plan) + point) * POINT_S
        for photons in bench.photons:
            times_s = photons.at(at_s).detections(spot_m, light, POINT_S, rng).time_s  # type: ignore[attr-defined]
            bins = np.floor((times_s - tcspc.offset_s) / tcspc.bin_width_s).astype(np.int32)
            found.append(bins[(bins >= 0) & (bins < tcspc.bins)])
    offset = np.concatenate([[0], np.cumsum([len(bins) for bins in found])])
    return Photons(offset, np.concatenate(found), np.ones(offset[-1], np.float32))


def kept(folder: Path, config: RigConfig, plan: ScanPlan, number: int) -> Photons:
    """Return a frame's photons from the folder; draw them if they are not there yet."""
    path = folder / f"frame{number:02d}.npz"
    if not path.exists():
        photons = drawn(config, plan, number)
        np.savez(path, offset=photons.offset, bins=photons.bins)
    with np.load(path) as held:
        return Photons(held["offset"], held["bins"], np.ones(len(held["bins"]), np.float32))


def geometry(config: RigConfig, plan: ScanPlan) -> Capture:
    """Return where and when each pair of laser spot and pixel was measured."""
    state, tcspc = RigState(config), config.tcspc
    assert tcspc.kind == "hydraharp"
    spots_m = np.array([channel.spot_m for channel in config.channels])
    delay_s = state.delays.delay_s(plan.spots_m[:, None], spots_m[None])
    pairs = delay_s.size
    return Capture(
        ArrayHistograms(np.broadcast_to(np.uint8(0), (pairs, tcspc.bins))),
        tcspc.bin_width_s,
        tcspc.offset_s - delay_s.ravel(),
        np.repeat(plan.spots_m, len(spots_m), axis=0),
        np.tile(spots_m, (len(plan), 1)),
    )


def place(amplitude: np.ndarray) -> tuple[float, float]:
    """Return at which x the 4, blurred by a resolution cell, is most like a picture, and how much."""
    best = (0.0, 0.0)
    for x_m in np.arange(-0.4, 0.4, 0.005):
        truth = np.isfinite(scene("four").moved((x_m, 0.0, 0.0)).depth_map(GRID.x_m, GRID.y_m))
        blurred = gaussian_filter(truth.astype(float), 0.02 / 0.019)
        best = max(best, (likeness(blurred, amplitude), float(x_m)))
    return best[1], best[0]


def main(folder: Path, gif: Path) -> None:
    """Draw photons, image them, say where the 4 is, and write the film."""
    config = load(CONFIG)
    plan = ScanPlan.grid(config)
    frame_s = len(plan) * POINT_S
    imager = FrameImager(geometry(config, plan), PULSE, GRID, fresh_to_m=1.0)
    fronts = []
    for number in range(FRAMES):
        photons = kept(folder, config, plan, number)
        begun_s = perf_counter()
        found = imager.image(photons)
        took_s = perf_counter() - begun_s
        front = front_view(compensate_falloff(found.intensity, GRID.z_m, found.falloff_power))
        fronts.append(front)
        true_m = -0.3 + 0.3 * (number + 0.5) * frame_s
        found_m, alike = place(np.sqrt(front))
        print(
            f"frame {number}: {len(photons.bins):,} photons, imaged in {took_s:.2f} s, most like the 4 at "
            f"x = {found_m:.3f} m (likeness {alike:.3f}); its middle was at {true_m:.3f} m half way"
        )
    volume = Volume(
        np.array(fronts),
        GRID.x_m,
        GRID.y_m,
        GRID.z_m,
        t_s=frame_s * np.arange(FRAMES),
        parameters={
            "camera": "confocal",
            "solver": "rsd",
            "wavelength_m": 0.08,
            "cycles": 2.0,
            "each_frame": True,
        },
        scan="a 4 at 1 m, 0.3 m/s",
    )
    save_video(volume, gif, compensation="z⁴")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
