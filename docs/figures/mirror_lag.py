"""Draw what a mirror's lag does to a continuous scan, and where a mirror is along its lines.

    python docs/figures/mirror_lag.py WORK_FOLDER docs/images

A simulated mirror trails by 2 ms, and its configuration says 0. The letters are scanned at 1 ms a point as it
is, after `rig calibrate lag`, and in step mode, with two seeds, which shows what chance does alone. It takes
ten minutes. Made are ``mirror_lag.png`` (the pictures), ``calibration_lag.png`` (the calibration's own) and
``mirror_lag_lines.png``: where the mirror is in the mean during each point, by its equation of motion.
"""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from recon.accumulate import likeness
from recon.depth import compensate_falloff, front_view
from rig.files import read_volume
from rig.model.colours import AMPLITUDE_COLOURS
from rig.model.config import built_in
from rig.model.plan import ScanPlan
from rig.model.state import RigState
from rig.model.sweep import Trajectories
from rig.show.saving import save
from rig.show.volume import draw_front
from simulators.motion.mirror import SteeringMirror

CONFIG = """
name = "slow mirror"
galvo.lag = "0ms"
point_clock.kind = "daq"
calibration.folder = "calibrations"
simulation.scene = "letters"
simulation.misalignment.mirror_lag = "2ms"
"""
CONTINUOUS = ("--mode", "continuous")
#: Lags and times of a point that are drawn along a line, and samples of a point.
LAGS_S, POINTS_S, SAMPLES = (0.8e-3, 2e-3), (1e-3, 5e-3), 40


def rig(folder: Path, *arguments: str) -> str:
    """Run a command of the program in a folder, and return what it prints."""
    print("rig", *arguments, file=sys.stderr)
    command = [sys.executable, "-m", "rig", *arguments]
    return subprocess.run(command, cwd=folder, check=True, stdout=subprocess.PIPE, text=True).stdout


def experiment(folder: Path) -> None:
    """Scan as configured, calibrate, scan again, and in step mode; image all."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "slow.toml").write_text(CONFIG)

    def scanned(name: str, *options: str) -> None:
        rig(folder, "scan", "--config", "slow.toml", "--exposure", "1ms", "--out", f"{name}.h5", *options)
        made = ("--out", f"{name}-volume.h5", "--image", f"{name}.png")
        rig(folder, "recon", f"{name}.h5", "--depth", "0.5m:2m:1cm", *made)

    scanned("uncorrected", *CONTINUOUS)
    rig(folder, "calibrate", "lag", "--config", "slow.toml")
    scanned("corrected", *CONTINUOUS)
    scanned("step")
    scanned("step-again", "--seed", "1")


def draw(folder: Path, picture: Path) -> None:
    """Compare the images with that of the step scan and with the scene, and draw them."""
    fronts, titles = {}, {}
    for name, title in {
        "uncorrected": "continuous, lag taken as 0",
        "corrected": "continuous, lag calibrated",
        "step": "step",
        "step-again": "step, another seed",
    }.items():
        volume = read_volume(folder / f"{name}-volume.h5")
        fronts[name] = np.sqrt(front_view(compensate_falloff(volume.intensity, volume.z_m, 4.0)))
        truth = ("--truth", "scene:letters", "--json")
        measured = json.loads(rig(folder, "measure", f"{name}-volume.h5", *truth))
        titles[name] = title, measured["overlap"], measured["depth"]["median_absolute_m"]
    figure = Figure(figsize=(13, 3.6), layout="constrained")
    for axes, name in zip(
        figure.subplots(1, 3, sharey=True), ("uncorrected", "corrected", "step"), strict=True
    ):
        drawn = draw_front(axes, fronts[name] / fronts[name].max(), volume.x_m, volume.y_m, AMPLITUDE_COLOURS)
        title, overlap, _ = titles[name]
        alike = likeness(fronts[name], fronts["step"])
        axes.set(title=f"{title}\noverlap {overlap:.2f}, likeness {alike:.3f}", xlim=(0.9, -0.9))
        axes.title.set_fontsize(10)
    figure.colorbar(drawn, ax=axes, label="amplitude / maximum, intensity times z⁴")
    save(figure, picture)
    for name, (title, overlap, depth_m) in titles.items():
        alike = likeness(fronts[name], fronts["step"])
        print(f"| {title} | {alike:.3f} | {overlap:.3f} | {1e3 * depth_m:.1f} mm |")


def along_a_line(lag_s: float, point_s: float) -> np.ndarray:
    """(points,) how far the mirror is ahead of each point in the mean of its time [m]; behind it: below zero.

    That time is later than the point's ticks by the lag. It is the second line of a scan.
    """
    config = built_in()
    state = RigState(config)
    plan = ScanPlan.grid(config, rows=3, exposure_s=point_s, motion="continuous", skip_m=0.0)
    angles = state.pointing.angles_rad(plan.spots_m)
    (sweep,) = Trajectories(plan, angles, config.galvo.turn_time_s).sweeps(range(len(plan)))
    mirror = SteeringMirror.trailing(lag_s)
    mirror.command(*sweep.angles_rad[0], -1.0)
    mirror.follow(np.arange(len(sweep.marks)) * point_s, sweep.angles_rad)
    line = sweep.lines[1]
    within_s = (np.arange(SAMPLES) + 0.5) / SAMPLES * point_s
    times_s = line.ticks[:, None] * point_s + lag_s + within_s
    spots_m = state.pointing.spots_m(mirror.positions(times_s.ravel())).reshape(*times_s.shape, 3)
    asked_m = plan.spots_m[line.steps.start : line.steps.stop]
    way = np.sign(asked_m[-1, 0] - asked_m[0, 0])
    return way * (spots_m.mean(axis=1)[:, 0] - asked_m[:, 0])


def draw_lines(picture: Path) -> None:
    """Draw how far the mirror is from its points along a line, as the lag is corrected for."""
    figure = Figure(figsize=(10, 3.6), layout="constrained")
    for axes, point_s in zip(figure.subplots(1, len(POINTS_S)), POINTS_S, strict=True):
        for lag_s in LAGS_S:
            off_mm = 1e3 * along_a_line(lag_s, point_s)
            axes.plot(np.arange(1, 13), off_mm[:12], "o-", markersize=4, label=f"lag {1e3 * lag_s:.1f} ms")
            first, last = (", ".join(f"{one:.2f}" for one in part) for part in (off_mm[:6], off_mm[-3:]))
            between = np.abs(off_mm[10:-5]).max()
            name = f"{1e3 * point_s:.0f} ms a point, lag {1e3 * lag_s:.1f} ms"
            print(f"{name}: {first} ... {last} mm, between {between:.3f} mm")
        axes.axhline(0, color="0.6", linewidth=0.8)
        axes.set(
            title=f"{1e3 * point_s:.0f} ms a point, {0.01 / point_s:.0f} m/s", xlabel="point of the line"
        )
        axes.set_ylabel("mirror ahead of its point (mm)")
        axes.legend(frameon=False)
    save(figure, picture)


if __name__ == "__main__":
    work, images = map(Path, sys.argv[1:])
    draw_lines(images / "mirror_lag_lines.png")
    experiment(work)
    draw(work, images / "mirror_lag.png")
    (made,) = (work / "calibrations").glob("lag-*.png")
    shutil.copy(made, images / "calibration_lag.png")
