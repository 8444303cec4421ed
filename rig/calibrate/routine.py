"""What a calibration routine is: it measures through the devices, fits what it measured, and shows it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, TypedDict

from matplotlib.figure import Figure

from rig.acquire.acquisition import Watch
from rig.acquire.connect import Station
from rig.errors import CalibrationError, UsageError
from rig.model.calibrations.base import Calibration
from rig.model.config import HydraHarpConfig, RigConfig
from rig.model.devices import Settings
from rig.model.state import RigState


class Routine(Protocol):
    """One kind of calibration, with its options.

    ``measure`` writes raw data, ``fit`` reads it: so recorded data is fitted just like fresh data.
    """

    @property
    def kind(self) -> str:
        """Of the calibration that it makes, see `rig.model.calibrations.kinds`."""
        ...

    def setup(self, config: RigConfig) -> RigConfig:
        """Return the configuration with which the devices are opened for it."""
        ...

    def measure(self, station: Station, state: RigState, folder: Path, watch: Watch) -> list[Path]:
        """Measure, and return the files of raw data, made in ``folder``.

        ``state`` has the configuration that `setup` gave.

        Raises
        ------
        drivers.errors.DeviceError
            If a device fails.
        """
        ...

    def fit(self, files: Sequence[Path], state: RigState) -> Calibration:
        """Return what the raw data says; ``state`` is the rig's own, as far as it was calibrated before.

        Raises
        ------
        CalibrationError
            If the data does not allow it: what is wrong, where, and what to do.
        DataFileError
            If a file is damaged, or of another kind.
        """
        ...

    def figure(self, files: Sequence[Path], calibration: Calibration) -> Figure:
        """Draw data, fit and residuals."""
        ...


def changed(config: RigConfig, **sections: Mapping[str, Any]) -> RigConfig:
    """Return a configuration with other values in some of its sections, in SI units.

    ``changed(config, detector={"gated": False})``
    """
    update = {
        name: getattr(config, name).model_copy(update=dict(values)) for name, values in sections.items()
    }
    return config.model_copy(update=update)


def histogram_settings(config: RigConfig) -> HydraHarpConfig:
    """Return the settings of the timing instrument's histograms, which a calibration chooses.

    Raises
    ------
    UsageError
        If it is of a kind that has none.
    """
    if not isinstance(config.tcspc, HydraHarpConfig):
        raise UsageError(
            f"a calibration sets the timing instrument's bins, which the kind {config.tcspc.kind} does not "
            "allow; give recorded raw data with --from, or the configuration of the rig itself"
        )
    return config.tcspc


class Origin(TypedDict):
    """Where a calibration comes from, as `Calibration` wants it."""

    rig_name: str
    devices: dict[str, str]
    measured_from: dict[str, str]
    simulated: bool


class RawData(Protocol):
    """A file that says where it comes from, such as a `rig.files.scan.ScanFile`."""

    @property
    def path(self) -> Path:
        """Where it is."""
        ...

    @property
    def digest(self) -> str:
        """SHA-256 of its bytes."""
        ...

    @property
    def devices(self) -> Mapping[str, Settings]:
        """Settings of each device, ``identity`` among them."""
        ...

    @property
    def config(self) -> RigConfig | None:
        """The configuration with which it was measured; None where it does not say."""
        ...

    @property
    def simulated(self) -> bool:
        """Whether it was computed rather than measured."""
        ...


def origin(kind: type[Calibration], scans: Sequence[RawData]) -> Origin:
    """Return rig, devices and digests of the files that a calibration of this kind is computed from.

    Raises
    ------
    CalibrationError
        If the files are of different devices.
    """
    devices: dict[str, str] = {}
    for scan in scans:
        for name in kind.belongs_to:
            identity = str(scan.devices.get(name, {}).get("identity", "unknown"))
            if devices.setdefault(name, identity) != identity:
                raise CalibrationError(
                    f"{scan.path} was measured with the {name} '{identity}', the files before it with "
                    f"'{devices[name]}': give files of one rig"
                )
    return {
        "rig_name": scans[0].config.name if scans[0].config else "unknown rig",
        "devices": devices,
        "measured_from": {scan.path.name: scan.digest for scan in scans},
        "simulated": scans[0].simulated,
    }
