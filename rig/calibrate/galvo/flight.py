"""The steering mirror calibrated without cameras: times of flight over the wall, and a few marks."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib.figure import Figure
from pydantic import BaseModel, ConfigDict, ValidationError

from recon.capture import C_M_PER_S
from rig.acquire.acquisition import Watch
from rig.acquire.connect import Station
from rig.atomic import appearing, refusals_told
from rig.calibrate import figures
from rig.calibrate.galvo.mirror import AIMED_TO_M, fit_flight, galvo_model
from rig.calibrate.geometry_fit import Arrivals, Spots
from rig.calibrate.raw import Origin, origin, reading
from rig.calibrate.routine import beam
from rig.calibrate.timing.first_bounce import FirstBounceRoutine, first_bounces, mirror_rad
from rig.errors import DataFileError, UsageError
from rig.model.calibrations.kinds import GalvoModel
from rig.model.config import RigConfig
from rig.model.delays import PathDelays
from rig.model.devices import Preparation
from rig.model.problems import in_words
from rig.model.state import RigState
from rig.whole import read_whole

Pair = tuple[float, float]

#: Marks are so far outside the corners of the scan, so that the whole scan lies between them.
OUTSIDE_M = 0.02


class Mark(BaseModel):
    """A mark on the wall (x, y), and the angles commanded when the beam met it."""

    model_config = ConfigDict(allow_inf_nan=False)

    mark_m: Pair
    mirror_rad: Pair


class WallMarks(BaseModel):
    """What a file of marks holds; ``galvo`` is the identity of the mirror that was steered."""

    format: Literal["rig-wall-marks"] = "rig-wall-marks"
    version: Literal[1] = 1
    galvo: str | None = None
    marks: list[Mark]

    def write(self, path: Path) -> None:
        """Write the file.

        Raises
        ------
        DataFileError
            If the disk refuses it; then none is left.
        """
        with refusals_told(path), appearing(path) as partial:
            partial.write_text(self.model_dump_json(indent=1) + "\n", encoding="utf-8")


@dataclass(frozen=True)
class FlightRoutine(FirstBounceRoutine[GalvoModel]):
    """Learns from times of flight where the beam meets the wall."""

    makes, files = GalvoModel, ("galvo-flight.h5",)

    def measure(self, station: Station, state: RigState, folder: Path, watch: Watch) -> list[Path]:
        """Let a person steer the beam onto marks, then scan."""
        marks = []
        station.operator.prepare(Preparation.ATTENUATE)
        with beam(station, state.config, (0.0, 0.0), watch) as (galvo, goes_on):
            for mark_m in wall_marks_m(state.config):
                mirror_rad = station.operator.aim_at(galvo, mark_m, goes_on)
                marks.append(Mark(mark_m=mark_m, mirror_rad=mirror_rad))
        marks_path = folder / "galvo-marks.json"
        WallMarks(galvo=galvo.identity, marks=marks).write(marks_path)
        # as configured, not as calibrated before: what is measured must not depend on it
        return [*super().measure(station, state.nominal, folder, watch), marks_path]

    def fit(self, files: Sequence[Path], state: RigState) -> GalvoModel:
        """Return the mirror's model from a scan and a file of marks."""
        arrivals, marks, source = _read(files)
        fit = fit_flight(arrivals, marks, state.config)
        return galvo_model(
            "flight",
            fit,
            marks,
            np.concatenate([arrivals.mirror_rad, marks.mirror_rad]),
            source,
            positions=len(arrivals.arrival_s),
            detector_head_m=tuple(fit.rig.delays.detector_head_m.tolist()),
            electronics_delay_s=fit.rig.delays.electronics_delay_s,
        )

    def figure(self, files: Sequence[Path], found: GalvoModel) -> Figure:
        """Draw residuals of the first bounces over the wall and over their paths, and the marks."""
        arrivals, marks, _ = _read(files)
        pointing = found.pointing()
        spots_m = pointing.spots_m(arrivals.mirror_rad)
        paths = PathDelays(np.array(found.mirror_m), np.array(found.detector_head_m))
        flight_s = paths.delay_s(spots_m, spots_m)
        residual_ps = 1e12 * (arrivals.arrival_s - (found.electronics_delay_s or 0.0) - flight_s)
        missed_m = pointing.spots_m(marks.mirror_rad)[:, :2] - marks.spot_m
        figure, axes = figures.panels(
            f"{found.positions} first bounces, {len(marks.spot_m)} marks: standard error of a spot "
            f"{found.spot_error_m * 1e3:.2f} mm",
            [["wall", "paths"]], (13, 5.2), width_ratios=(1.7, 1),
        )  # fmt: skip
        wall, label = axes["wall"], "arrival less modelled (ps)"
        figures.wall_map(
            wall, spots_m[:, :2], residual_ps, label, reach=float(np.abs(residual_ps).max()), size=30
        )
        figures.outline(wall, found.area_m)
        wall.plot(*marks.spot_m.T, "+", color="black", markersize=10, label="mark")
        figures.arrows(wall, marks.spot_m, missed_m, "modelled less mark", 0.1)
        figures.legend_below(wall)
        figures.residuals(axes["paths"], flight_s * C_M_PER_S, residual_ps, 1e12 * arrivals.error_s, fmt="o")
        axes["paths"].set(xlabel="path mirror - wall - detector (m)", ylabel=label, title="residuals")
        return figure


def wall_marks_m(config: RigConfig) -> list[Pair]:
    """Return the marks (x, y): the wall's centre, and just outside the corners of the scan [m]."""
    scan = config.scan
    x_m = (scan.columns - 1) / 2 * scan.spacing_m + OUTSIDE_M
    y_m = (scan.rows - 1) / 2 * scan.spacing_m + OUTSIDE_M
    return [(0.0, 0.0), (-x_m, -y_m), (x_m, -y_m), (x_m, y_m), (-x_m, y_m)]


def _read(files: Sequence[Path]) -> tuple[Arrivals, Spots, Origin]:
    scans = [path for path in files if path.suffix != ".json"]
    marks = [path for path in files if path.suffix == ".json"]
    if len(scans) != 1 or len(marks) != 1:
        raise UsageError(
            f"the mirror is calibrated from one scan and one file of marks (*.json), {len(scans)} and "
            f"{len(marks)} were given: --from galvo-flight.h5 --from galvo-marks.json"
        )
    content, digest = read_marks(marks[0])
    with reading(scans, whole=False) as ((scan,), (raw, *_)):
        mine = scan.devices.get("galvo", {}).get("identity")
        if content.galvo and mine and content.galvo != mine:
            raise DataFileError(
                f"{marks[0]} is of the mirror '{content.galvo}', the scan is of '{mine}': give files of one "
                "rig"
            )
        source = origin(GalvoModel, [scan])
        source["measured_from"][marks[0].name] = digest
        found = first_bounces(raw)
        arrivals = Arrivals(mirror_rad(raw)[found.index], found.centre_s, found.centre_error_s)
    places_m, steered = (
        np.array([getattr(one, name) for one in content.marks], dtype=float).reshape(-1, 2)
        for name in ("mark_m", "mirror_rad")
    )
    return arrivals, Spots(steered, places_m, AIMED_TO_M), source


def read_marks(path: Path) -> tuple[WallMarks, str]:
    """Return the content of a file of marks, and its SHA-256.

    Raises DataFileError if it cannot be read, or is of another kind.
    """
    try:
        data = read_whole(path)
        return WallMarks.model_validate_json(data), hashlib.sha256(data).hexdigest()
    except OSError as error:
        raise DataFileError(f"{path}: cannot be read ({error.strerror})") from None
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "it"
        raise DataFileError(
            f"{path}: is not a file of marks: {where}: {in_words(first)}. "
            "It must hold mark_m and mirror_rad, two "
            "numbers each, for every mark; see docs/calibration/galvo.md"
        ) from None
