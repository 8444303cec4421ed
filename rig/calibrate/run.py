"""One calibration from beginning to end: measured or read, fitted, stored with its picture."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic

from rig.acquire.acquisition import Watch
from rig.acquire.connect import open_station
from rig.calibrate.routine import K, Routine
from rig.errors import RefusedError, UsageError
from rig.model.calibrations.store import CalibrationStore
from rig.model.config import RigConfig
from rig.model.devices import Operator, Preparation
from rig.model.state import RigState
from rig.show.saving import save


@dataclass(frozen=True)
class Calibrated(Generic[K]):
    """A new calibration, and where it and its picture are."""

    calibration: K
    path: Path
    picture: Path


def measured(
    routine: Routine[Any], config: RigConfig, operator: Operator, folder: Path, watch: Watch
) -> list[Path]:
    """Measure the raw data of a calibration into ``folder``, and return its files.

    The rig is left prepared as for a scan.

    Raises
    ------
    UsageError, RefusedError
        If the configuration does not allow it, or its result could not be stored; nothing was started.
    """
    if len(config.channels) > 1:
        raise UsageError(
            f"a calibration is measured with one channel, but {len(config.channels)} are configured: "
            "give a configuration with only the channel to calibrate"
        )
    if reason := routine.impossible(config):
        raise RefusedError(reason)
    CalibrationStore(config.calibration.folder).require_room()
    setup = routine.setup(config)
    with open_station(setup, operator, tagged=routine.tagged) as station:
        state = RigState(setup).of_devices(station.devices.identities())
        files = routine.measure(station, state, folder, watch)
        station.operator.prepare(Preparation.MEASURE)  # the laser is dark by now
        return files


def fitted(routine: Routine[K], config: RigConfig, files: Sequence[Path]) -> Calibrated[K]:
    """Fit raw data, and store calibration and picture.

    Raises
    ------
    CalibrationError
        If the data does not allow it; nothing is stored then.
    """
    calibration = routine.fit(files, RigState.resolve(config))
    store = CalibrationStore(config.calibration.folder)
    figure = routine.figure(files, calibration)
    path = store.add(calibration)
    picture = store.path_for(calibration, ".png")
    save(figure, picture)
    return Calibrated(calibration, path, picture)
