"""The rig's configuration: what is connected, where it stands, and how it is set.

Files are TOML with quantities as text. Without a file the built-in simulated rig is used; it is written out
and commented in ``configs/simulated.toml``.
"""

from rig.model.config.delayers import (
    DelayerConfig,
    Dg645Config,
    ExternalDelayerConfig,
    PsdConfig,
    T560Config,
)
from rig.model.config.detectors import DetectorConfig, ExternalDetectorConfig, Id120Config, MpdConfig
from rig.model.config.galvos import AnalogueGalvoConfig, GalvoConfig, OptotuneConfig
from rig.model.config.harps import (
    EitherTriggerConfig,
    HarpConfig,
    HydraHarp500Config,
    HydraHarpConfig,
    MultiHarpConfig,
    PicoHarp330Config,
    TimeHarp260Config,
)
from rig.model.config.lasers import ExternalLaserConfig, Katana08Config, KatanaConfig, LaserConfig, NktConfig
from rig.model.config.notify import NotifyConfig
from rig.model.config.point_clocks import DaqClockConfig
from rig.model.config.reading import built_in, built_in_with, load, recorded
from rig.model.config.rig import RigConfig
from rig.model.config.section import DeviceSection, Point
from rig.model.config.shutters import DaqShutterConfig, SerialShutterConfig, ShutterConfig
from rig.model.config.simulation import FaultsConfig, SimulationConfig
from rig.model.config.timing import PlaybackConfig, TcspcConfig
from rig.model.config.use import CalibrationConfig

__all__ = [
    "AnalogueGalvoConfig",
    "CalibrationConfig",
    "DaqClockConfig",
    "DaqShutterConfig",
    "DelayerConfig",
    "DetectorConfig",
    "DeviceSection",
    "Dg645Config",
    "EitherTriggerConfig",
    "ExternalDelayerConfig",
    "ExternalDetectorConfig",
    "ExternalLaserConfig",
    "FaultsConfig",
    "GalvoConfig",
    "HarpConfig",
    "HydraHarp500Config",
    "HydraHarpConfig",
    "Id120Config",
    "Katana08Config",
    "KatanaConfig",
    "LaserConfig",
    "MpdConfig",
    "MultiHarpConfig",
    "NktConfig",
    "NotifyConfig",
    "OptotuneConfig",
    "PicoHarp330Config",
    "PlaybackConfig",
    "Point",
    "PsdConfig",
    "RigConfig",
    "SerialShutterConfig",
    "ShutterConfig",
    "SimulationConfig",
    "T560Config",
    "TcspcConfig",
    "TimeHarp260Config",
    "built_in",
    "built_in_with",
    "load",
    "recorded",
]
