"""Time zero from one known target before the wall: light that went to it and back says when it started."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from recon.capture import C_M_PER_S
from rig.acquire.acquisition import Watch
from rig.acquire.connect import Station
from rig.calibrate import Floats, figures
from rig.calibrate.geometry_fit import TAPE_ERROR_M, TILT_ERROR_RAD
from rig.calibrate.raw import Raw, origin, reading
from rig.calibrate.routine import Routine, recorded
from rig.calibrate.timing import peaks
from rig.calibrate.timing.time_zero import draw_peak, in_common
from rig.errors import UsageError
from rig.model.calibrations.kinds import Point, TimeZero
from rig.model.delays import PathDelays
from rig.model.devices import Preparation
from rig.model.plan import ScanPlan
from rig.model.quantities import parse, show, show_length
from rig.model.state import RigState

#: How well the place of the target is known, on each axis.
TARGET_ERROR_M = 2e-3
#: Target and first bounces give the same delay but for errors of places: no more than this.
NEAR_S = 0.9e-9


def place(text: str) -> Point:
    """Read ``10cm,-5cm,1m``, or a distance alone straight before the wall's centre.

    Raises UsageError if it is neither, or not before the wall.
    """
    parts = [parse(part, "length") for part in text.split(",")]
    if len(parts) == 1:
        parts = [0.0, 0.0, *parts]
    if len(parts) != 3 or parts[2] <= 0:
        raise UsageError(
            f"--target {text}: give x,y,z in front of the wall, e.g. 10cm,-5cm,1m, or a distance"
        )
    return parts[0], parts[1], parts[2]


@dataclass(frozen=True)
class TargetRoutine(Routine[TimeZero]):
    """Scans one small target at a known place, gated as for a scan; nothing else near may be as bright."""

    target_m: Point
    columns: int = 9
    rows: int = 7
    exposure_s: float = 0.5

    makes = TimeZero

    def measure(self, station: Station, state: RigState, folder: Path, watch: Watch) -> list[Path]:
        """Scan a coarse grid."""
        scan = state.config.scan
        plan = ScanPlan.grid(
            state.config,
            columns=self.columns,
            rows=self.rows,
            spacing_m=scan.spacing_m * min(scan.columns / self.columns, scan.rows / self.rows),
            exposure_s=self.exposure_s,
            preparation=Preparation.MEASURE,
        )
        return [recorded(folder / "time-zero-target.h5", plan, state, station, watch)]

    def fit(self, files: Sequence[Path], state: RigState) -> TimeZero:
        """Return the delay with which the target is where it is, the heads being as known.

        What an error of a head's place does to the delay, rectified time gets back at the wall's centre.
        """
        galvo, delays = state.calibrations.galvo, state.nominal.delays
        head_m, head_error_m = delays.laser_head_m, TAPE_ERROR_M
        if galvo:
            head_m = np.array(galvo.mirror_m)
        else:
            head_error_m = float(np.hypot(TAPE_ERROR_M, TILT_ERROR_RAD * np.linalg.norm(head_m)))
        with reading(files[:1], whole=False) as (scans, (raw, *_)):
            spots_m = raw.laser_m if raw.mirror_rad is None else state.pointing.spots_m(raw.mirror_rad)
            spots_m = spots_m[raw.done]
            found = self._stacked(raw, spots_m, head_m, delays.detector_head_m)
            towards = spots_m - head_m
            towards = towards / np.linalg.norm(towards, axis=1, keepdims=True)
            aside_s = np.linalg.norm(towards - towards.mean(axis=0), axis=1) * head_error_m / C_M_PER_S
            own_s = float(np.hypot(found.centre_error_s[0], 2 * TARGET_ERROR_M / C_M_PER_S))
            errors_s = np.hypot(own_s, aside_s)
            own_delays = PathDelays(head_m, delays.detector_head_m, float(found.centre_s[0]))
            return TimeZero(
                **origin(TimeZero, scans),
                **in_common(own_delays, errors_s, raw),
                electronics_delay_error_s=float(np.hypot(own_s, 2**0.5 * head_error_m / C_M_PER_S)),
                residual_s=None,
                chi2=found.chi2,
                positions=len(spots_m),
                drift_per_minute_s=None,
                drift_per_minute_error_s=None,
                spots_m=[(x_m, y_m) for x_m, y_m, _ in spots_m.tolist()],
                residuals_s=[],
                warnings=[
                    "the galvo is not calibrated: time is right at the wall's centre if the target is at "
                    f"the given place, but may be wrong by {show(float(errors_s.max()), 's', 2)} at the rim: "
                    "run rig calibrate galvo, then this"
                ]
                * (galvo is None),
            )

    def figure(self, files: Sequence[Path], found: TimeZero) -> Figure:
        """Draw the stacked counts about the delay."""
        with reading(files[:1], whole=False) as (_, (raw, *_)):
            spots_m = np.pad(np.array(found.spots_m), ((0, 0), (0, 1)))
            heads_m = np.array(found.laser_head_m), np.array(found.detector_head_m)
            stacked = self._stacked(raw, spots_m, *heads_m)
        figure, axes = figures.panels(f"target at {self._name}, all positions", [["peak"]], (8, 4))
        draw_peak(axes["peak"], stacked, 0, "delay")
        axes["peak"].set_xlabel("time less the way over the target (ns)")
        return figure

    @property
    def _name(self) -> str:
        return ", ".join(map(show_length, self.target_m))

    def _stacked(self, raw: Raw, spots_m: Floats, galvo_m: Floats, head_m: Floats) -> peaks.Peaks:
        """Put all counts on one time axis, that of the delay, and fit the peak there.

        Where first bounces pass the gate, or there is none, they are far brighter. They come together on an
        axis of their own, which says where on the target's axis to look.
        """
        over_target = _way_m(galvo_m, spots_m, np.array(self.target_m), raw.detector_spot_m, head_m)
        total, start_s = _aligned(raw, over_target)
        direct, direct_start_s = _aligned(raw, _way_m(galvo_m, spots_m, head_m))
        searched = slice(0, len(total))
        if direct.max() > total.max():
            middle = round((direct_start_s - start_s) / raw.bin_width_s) + int(direct.argmax())
            near = round(NEAR_S / raw.bin_width_s)
            first = min(max(middle - near, 0), max(len(total) - 2 * near, 0))
            searched = slice(first, first + 2 * near)
        edges_s = np.asarray(start_s + np.arange(len(total) + 1) * raw.bin_width_s, dtype=np.float64)
        return peaks.find(
            total[None], np.array([np.inf]), np.ones((1, len(total))), edges_s,
            name=f"{raw.label}, light of the target at {self._name}, all positions together",
            searched=searched,
        )  # fmt: skip


def _aligned(raw: Raw, path_m: Floats) -> tuple[Floats, float]:
    """Add up histograms by the delay that each bin would mean; return it with its first edge [s].

    Counts are shared between the two bins that they fall in, so that their time is kept.
    """
    early = path_m / C_M_PER_S / raw.bin_width_s
    whole = np.floor(early).astype(np.int64)
    total = np.zeros(raw.bins + int(np.ptp(whole)) + 1)
    for row, at, share in zip(raw.counts[raw.done], whole.max() - whole, early - whole, strict=True):
        total[at : at + raw.bins] += share * row
        total[at + 1 : at + 1 + raw.bins] += (1 - share) * row
    return total, raw.first_bin_s - (int(whole.max()) + 1) * raw.bin_width_s


def _way_m(*points_m: Floats) -> Floats:
    """(P,) length of the way from point to point, each (3,) or (P, 3)."""
    return np.asarray(sum(np.linalg.norm(there - here, axis=-1) for here, there in pairwise(points_m)))
