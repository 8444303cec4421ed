"""What a calibration routine is: it measures through the devices, fits what it measured, and shows it."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

from matplotlib.figure import Figure

from drivers.harp.limits import HarpLimits
from rig.acquire.acquisition import Watch, record
from rig.acquire.connect import Station
from rig.acquire.preflight import check
from rig.devices.kinds.harps import family_of
from rig.errors import InterruptedScanError, UsageError
from rig.light.guard import ASKING_LEASE_S
from rig.model.calibrations.base import Calibration
from rig.model.config import HarpConfig, RigConfig
from rig.model.devices import Galvo
from rig.model.plan import ScanPlan
from rig.model.state import RigState

K = TypeVar("K", bound=Calibration)


class Routine(ABC, Generic[K]):
    """What makes one kind of calibration; subclasses are dataclasses of its options.

    ``measure`` writes raw data, ``fit`` reads it: so recorded data is fitted just like fresh data.

    Attributes
    ----------
    makes
        The kind of calibration.
    tagged
        Whether the timing instrument is to record each photon.
    """

    makes: type[K]
    tagged: ClassVar[bool] = False

    @property
    def kind(self) -> str:
        """Of the calibration that it makes, see `rig.model.calibrations.kinds`."""
        return self.makes.kind

    def impossible(self, config: RigConfig) -> str:
        """Say in a sentence why a rig of this kind has no such calibration; empty where it has."""
        return ""

    def lacking(self, config: RigConfig) -> str:
        """Say in a sentence why it cannot be measured here and now; empty where it can.

        Then ``rig calibrate all`` leaves it out, and measures the others.
        """
        return self.impossible(config)

    def setup(self, config: RigConfig) -> RigConfig:
        """Return the configuration with which the devices are opened for it: as it is, if not overridden."""
        return config

    @abstractmethod
    def measure(self, station: Station, state: RigState, folder: Path, watch: Watch) -> list[Path]:
        """Measure, and return the files of raw data, made in ``folder``.

        ``state`` has the configuration that `setup` gave.

        Raises
        ------
        drivers.errors.DeviceError
            If a device fails.
        """

    @abstractmethod
    def fit(self, files: Sequence[Path], state: RigState) -> K:
        """Return what the raw data says; ``state`` is the rig's own, as far as it was calibrated before.

        Raises
        ------
        CalibrationError
            If the data does not allow it: what is wrong, where, and what to do.
        DataFileError
            If a file is damaged, or of another kind.
        """

    @abstractmethod
    def figure(self, files: Sequence[Path], found: K) -> Figure:
        """Draw data, fit and residuals."""


def changed(config: RigConfig, **sections: Mapping[str, Any]) -> RigConfig:
    """Return a configuration with other values in some of its sections, in SI units.

    ``changed(config, detector={"gated": False})``
    """
    update = {
        name: getattr(config, name).model_copy(update=dict(values)) for name, values in sections.items()
    }
    return config.model_copy(update=update)


def histogram_settings(config: RigConfig) -> HarpConfig:
    """Return the settings of the timing instrument's histograms, which a calibration chooses.

    Raises
    ------
    UsageError
        If it is of a kind that has none.
    """
    if not isinstance(config.tcspc, HarpConfig):
        raise UsageError(
            f"a calibration sets the timing instrument's bins, which the kind {config.tcspc.kind} does not "
            "allow; give recorded raw data with --from, or the configuration of the rig itself"
        )
    return config.tcspc


def histogram_limits(config: RigConfig) -> HarpLimits:
    """Return what histograms the timing instrument can have; raises as `histogram_settings`."""
    return family_of(histogram_settings(config)).limits


def recorded(path: Path, plan: ScanPlan, state: RigState, station: Station, watch: Watch) -> Path:
    """Run a plan into a new scan file, and return its path.

    Raises
    ------
    RefusedError
        If the rig cannot do it; nothing has moved then.
    """
    check(plan, state, path.parent)
    record(plan, state, station.devices, path, watch, station.operator)
    return path


@contextmanager
def beam(
    station: Station, config: RigConfig, angle: tuple[float, float], watch: Watch
) -> Iterator[tuple[Galvo, Callable[[], None]]]:
    """Light the beam, aimed before it is lit; it is dark again after the block, however that ends.

    Gives the mirror, and what has to be called before each step in the light: it says that all is well, and
    raises when the light is lost or a stop was asked for.
    """
    galvo, laser = station.devices.galvo, station.devices.laser

    def goes_on() -> None:
        laser.beat(ASKING_LEASE_S)
        if watch.should_stop():
            raise InterruptedScanError("the calibration was stopped, nothing was stored")

    galvo.point(*angle)
    galvo.wait_settled(config.galvo.settle_timeout_s)
    try:
        laser.arm()
        laser.emit()
        goes_on()
        yield galvo, goes_on
    finally:
        laser.stop()
