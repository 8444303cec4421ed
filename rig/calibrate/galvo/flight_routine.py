"""The steering mirror calibrated without cameras: times of flight over the wall, and a few marks."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from rig.acquire.acquisition import Watch
from rig.acquire.connect import Station
from rig.calibrate.first_bounce import FirstBounces, first_bounces, free_running, record_first_bounces
from rig.calibrate.galvo.flight import Marks, fit_flight
from rig.calibrate.galvo.marks import Pair, read_marks, write_marks
from rig.calibrate.galvo.pictures import flight_figure
from rig.calibrate.galvo.record import galvo_model
from rig.calibrate.routine import Origin, origin
from rig.errors import UsageError
from rig.files.scan import ScanFile
from rig.model.calibrations.base import Calibration
from rig.model.calibrations.kinds import GalvoModel
from rig.model.config import RigConfig
from rig.model.devices import Preparation
from rig.model.state import RigState

#: Marks are so far outside the corners of the scan, so that the whole scan lies between them.
OUTSIDE_M = 0.02


@dataclass(frozen=True)
class FlightRoutine:
    """Hears, as it were, where the beam meets the wall.

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
    kind: str = GalvoModel.kind

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
        record_first_bounces(
            station, state.nominal, scan_path, watch,
            columns=self.columns, rows=self.rows, exposure_s=self.exposure_s,
        )  # fmt: skip
        return [scan_path, marks_path]

    def fit(self, files: Sequence[Path], state: RigState) -> Calibration:
        """Return the mirror's model from a scan and a file of marks."""
        bounces, marks, source = _read(files)
        flight = fit_flight(bounces.mirror_rad, bounces.arrival_s, bounces.error_s, marks, state.config)
        return galvo_model(
            "flight",
            flight.mirror,
            marks.mirror_rad,
            marks.mark_m,
            source,
            positions=len(bounces.arrival_s),
            detector_head_m=tuple(flight.head_m.tolist()),
            electronics_delay_s=flight.delay_s,
        )

    def figure(self, files: Sequence[Path], calibration: Calibration) -> Figure:
        """Draw positions with what the fit leaves of their arrivals, and the marks."""
        assert isinstance(calibration, GalvoModel)
        bounces, _, _ = _read(files)
        return flight_figure(calibration, bounces.mirror_rad, bounces.arrival_s, bounces.error_s)


def _read(files: Sequence[Path]) -> tuple[FirstBounces, Marks, Origin]:
    scans = [path for path in files if path.suffix != ".json"]
    marks_files = [path for path in files if path.suffix == ".json"]
    if len(scans) != 1 or len(marks_files) != 1:
        raise UsageError(
            f"the mirror is calibrated from one scan and one file of marks (*.json), {len(scans)} and "
            f"{len(marks_files)} were given: --from galvo-flight.h5 --from galvo-marks.json"
        )
    with ScanFile(scans[0]) as scan:
        marks, digest = read_marks(marks_files[0], scan.devices)
        source = origin(GalvoModel, [scan])
        source["measured_from"][marks_files[0].name] = digest
        return first_bounces(scan), marks, source


def wall_marks_m(config: RigConfig) -> list[Pair]:
    """Return the marks (x, y): the wall's centre, and just outside the corners of the scan [m]."""
    scan = config.scan
    x_m = (scan.columns - 1) / 2 * scan.spacing_m + OUTSIDE_M
    y_m = (scan.rows - 1) / 2 * scan.spacing_m + OUTSIDE_M
    return [(0.0, 0.0), (-x_m, -y_m), (x_m, -y_m), (x_m, y_m), (-x_m, y_m)]
