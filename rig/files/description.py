"""What a scan file says before its photons: geometry, time axis, plan, configuration, devices."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import DTypeLike, NDArray

from rig.model.delays import PathDelays

#: A device's settings, as read back from it.
Settings = Mapping[str, str | int | float | bool]


@dataclass(frozen=True)
class ScanDescription:
    """All that is known of a scan before its first photon.

    Attributes
    ----------
    laser_m, detector_m
        (P, 3) laser spots in the order of acquisition, and (1, 3) or (P, 3) detector spots; metres.
    bins, bin_width_s, first_bin_s
        Number and width of the bins, and the left edge of bin 0.
    legs
        None where t = 0 is the pulse on the wall (time origin ``wall``); the legs where it is the pulse
        leaving the laser (time origin ``laser``).
    delay_s
        (P,) instead of the legs: what to subtract from each position's time, where that was measured.
    plan, configuration
        JSON texts.
    simulated
        Whether the photons were computed rather than measured.
    command
        The command that makes the file.
    devices
        Settings by device name, ``identity`` among them.
    fade_from_s
        Rectified time before which the record holds the wall's own light.
    gate_start_s, gate_stop_s
        The detector's gate, in the file's time.
    instrument_response_s
        Full width at half maximum.
    imported
        JSON text: which file of another layout the photons come from; empty where they were measured here.
    mirror_rad
        (P, 2) commanded mirror angles.
    calibrations
        JSON text of each calibration that the scan uses, by kind.
    dtype
        Type of the counts; a floating type says that they are expectations, not photons.
    """

    laser_m: NDArray[np.float64]
    detector_m: NDArray[np.float64]
    bins: int
    bin_width_s: float
    first_bin_s: float
    legs: PathDelays | None = None
    plan: str = "{}"
    configuration: str = "{}"
    simulated: bool = False
    command: str = ""
    devices: Mapping[str, Settings] = field(default_factory=dict)
    fade_from_s: float | None = None
    gate_start_s: float | None = None
    gate_stop_s: float | None = None
    instrument_response_s: float | None = None
    imported: str = ""
    dtype: DTypeLike = "<u4"
    delay_s: NDArray[np.float64] | None = None
    mirror_rad: NDArray[np.float64] | None = None
    calibrations: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        positions = len(self.laser_m)
        if self.laser_m.shape != (positions, 3) or positions == 0:
            raise ValueError(f"laser_m must be (positions, 3), not {self.laser_m.shape}")
        if self.detector_m.shape not in {(1, 3), (positions, 3)}:
            raise ValueError(f"detector_m must be (1, 3) or ({positions}, 3), not {self.detector_m.shape}")
        if self.bins < 1 or not self.bin_width_s > 0:
            raise ValueError(f"{self.bins} bins of {self.bin_width_s} s: both must be positive")
        if self.delay_s is not None and (self.legs is not None or self.delay_s.shape != (positions,)):
            raise ValueError(f"delay_s must be ({positions},), and in place of the legs")

    @property
    def positions(self) -> int:
        """Number of positions P."""
        return len(self.laser_m)

    @property
    def time_origin(self) -> str:
        """``wall`` or ``laser``."""
        return "wall" if self.legs is None and self.delay_s is None else "laser"
