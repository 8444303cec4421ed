"""The steering mirror calibrated without cameras: times of flight over the wall, and a few marks."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from rig.acquire.acquisition import Watch
from rig.acquire.connect import Station
from rig.atomic import appearing
from rig.calibrate import Floats
from rig.calibrate.first_bounce import first_bounces, mirror_rad
from rig.calibrate.galvo.mirror import Fiducials, fit_flight, galvo_model
from rig.calibrate.galvo.pictures import flight_figure
from rig.calibrate.peaks import Peaks
from rig.calibrate.raw import Origin, origin, reading
from rig.calibrate.routine import Routine, first_bounce_plan, free_running, recorded
from rig.errors import DataFileError, UsageError
from rig.model.calibrations.kinds import GalvoModel
from rig.model.config import RigConfig
from rig.model.devices import Preparation
from rig.model.state import RigState

Pair = tuple[float, float]

FORMAT = "rig-wall-marks"
#: Marks are so far outside the corners of the scan, so that the whole scan lies between them.
OUTSIDE_M = 0.02


@dataclass(frozen=True)
class FlightRoutine(Routine[GalvoModel]):
    """Learns from times of flight where the beam meets the wall.

    Attributes
    ----------
    columns, rows
        Positions at which the first bounce is timed.
    exposure_s
        At each.
    """

    columns: int = 11
    rows: int = 9
    exposure_s: float = 0.1

    makes = GalvoModel

    def setup(self, config: RigConfig) -> RigConfig:
        """Return a detector that runs free, and a histogram of the whole period."""
        return free_running(config)

    def measure(self, station: Station, state: RigState, folder: Path, watch: Watch) -> list[Path]:
        """Let a person steer the beam onto marks, then scan."""
        scan_path, marks_path = folder / "galvo-flight.h5", folder / "galvo-marks.json"
        galvo, laser = station.devices.galvo, station.devices.laser
        station.operator.prepare(Preparation.ATTENUATE)
        galvo.point(0.0, 0.0)  # aims before it lights
        galvo.wait_settled(state.config.galvo.settle_timeout_s)
        pairs = []
        try:
            laser.arm()
            laser.emit()
            for mark in wall_marks_m(state.config):
                pairs.append((mark, station.operator.aim_at(galvo, mark)))
                if watch.should_stop():
                    return []
        finally:
            laser.stop()
        write_marks(marks_path, pairs, galvo.identity)
        # as configured, not as calibrated before: what is measured must not depend on it
        plan = first_bounce_plan(state.config, self.columns, self.rows, self.exposure_s)
        recorded(scan_path, plan, state.nominal, station, watch)
        return [scan_path, marks_path]

    def fit(self, files: Sequence[Path], state: RigState) -> GalvoModel:
        """Return the mirror's model from a scan and a file of marks."""
        angles, bounces, marks, source = _read(files)
        mirror = fit_flight(angles, bounces.centre_s, bounces.centre_error_s, marks, state.config)
        return galvo_model(
            "flight",
            mirror,
            marks.mirror_rad,
            marks.place_m,
            source,
            positions=len(angles),
            detector_head_m=tuple(mirror.rig.delays.detector_head_m.tolist()),
            electronics_delay_s=mirror.rig.delays.electronics_delay_s,
        )

    def figure(self, files: Sequence[Path], found: GalvoModel) -> Figure:
        """Draw positions with what the fit leaves of their arrivals, and the marks."""
        angles, bounces, _, _ = _read(files)
        return flight_figure(found, angles, bounces.centre_s, bounces.centre_error_s)


def _read(files: Sequence[Path]) -> tuple[Floats, Peaks, Fiducials, Origin]:
    scans = [path for path in files if path.suffix != ".json"]
    marks_files = [path for path in files if path.suffix == ".json"]
    if len(scans) != 1 or len(marks_files) != 1:
        raise UsageError(
            f"the mirror is calibrated from one scan and one file of marks (*.json), {len(scans)} and "
            f"{len(marks_files)} were given: --from galvo-flight.h5 --from galvo-marks.json"
        )
    with reading(scans, whole=False) as ((scan,), (raw, *_)):
        marks, digest = read_marks(marks_files[0], scan.devices)
        source = origin(GalvoModel, [scan])
        source["measured_from"][marks_files[0].name] = digest
        bounces = first_bounces(raw)
        return mirror_rad(raw)[bounces.index], bounces, marks, source


def wall_marks_m(config: RigConfig) -> list[Pair]:
    """Return the marks (x, y): the wall's centre, and just outside the corners of the scan [m]."""
    scan = config.scan
    x_m = (scan.columns - 1) / 2 * scan.spacing_m + OUTSIDE_M
    y_m = (scan.rows - 1) / 2 * scan.spacing_m + OUTSIDE_M
    return [(0.0, 0.0), (-x_m, -y_m), (x_m, -y_m), (x_m, y_m), (-x_m, y_m)]


def write_marks(path: Path, pairs: Sequence[tuple[Pair, Pair]], galvo: str) -> None:
    """Write (mark [m], commanded angles [rad]) pairs, and the identity of the mirror that was steered."""
    content = {
        "format": FORMAT,
        "version": 1,
        "galvo": galvo,
        "marks": [{"mark_m": list(mark), "mirror_rad": list(angles)} for mark, angles in pairs],
    }
    with appearing(path) as partial:
        partial.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def read_marks(path: Path, devices: Mapping[str, Mapping[str, object]]) -> tuple[Fiducials, str]:
    """Return the marks of a file, and its SHA-256.

    Parameters
    ----------
    path
        The file.
    devices
        Of the scan that belongs to it.

    Raises
    ------
    DataFileError
        If it cannot be read, is of another kind, or of another mirror.
    """
    try:
        data = path.read_bytes()
        content = json.loads(data)
        if content.get("format") != FORMAT or content.get("version") != 1:
            raise ValueError(f"it is no {FORMAT} of version 1")
        marks = Fiducials(
            np.array([one["mark_m"] for one in content["marks"]], dtype=float).reshape(-1, 2),
            np.array([one["mirror_rad"] for one in content["marks"]], dtype=float).reshape(-1, 2),
        )
        if not (np.isfinite(marks.place_m).all() and np.isfinite(marks.mirror_rad).all()):
            raise ValueError("a number in it is none")
    except OSError as error:
        raise DataFileError(f"{path}: cannot be read ({error.strerror})") from None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise DataFileError(
            f"{path}: is no file of marks: {error}. It holds mark_m and mirror_rad, two numbers each, for "
            "every mark; see docs/calibration/galvo.md"
        ) from None
    mine, steered = devices.get("galvo", {}).get("identity"), content.get("galvo")
    if steered and mine and steered != mine:
        raise DataFileError(
            f"{path} is of the mirror '{steered}', the scan is of '{mine}': give files of one rig"
        )
    return marks, hashlib.sha256(data).hexdigest()
