"""The scan plan: an immutable value that can be printed, timed and checked without hardware."""

from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from shutil import disk_usage
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.errors import RefusedError
from rig.model.config import RigConfig
from rig.model.pointing import Pointing
from rig.model.quantities import show_length

#: Bytes that one photon takes in a compressed scan file, measured on simulated scans (gzip level 1).
BYTES_PER_PHOTON = 0.85
#: Detections a second that the size estimate assumes (the paper's Table 1: 205 to 265 thousand).
ASSUMED_RATE_HZ = 265e3


@dataclass(frozen=True)
class ScanPlan:
    """Which spots are lit, in which order, for how long.

    The grid is centred on the wall's origin; lines run along x and alternate in direction, from the bottom up
    (snake order), so that the mirror never jumps.

    Attributes
    ----------
    columns, rows
        Grid positions along x and y.
    spacing_m
        Distance between neighbours.
    exposure_s
        Measurement time at each position.
    detector_spot_m
        The spot that the detector looks at.
    skip_m
        Side of the square around that spot which is left out, because there the first bounce drowns the rest.
    bins, bin_width_s
        The histogram at each position.
    """

    columns: int
    rows: int
    spacing_m: float
    exposure_s: float
    detector_spot_m: tuple[float, float, float]
    skip_m: float
    bins: int
    bin_width_s: float

    @classmethod
    def from_config(cls, config: RigConfig, **changes: Any) -> "ScanPlan":
        """Take the configuration's scan, with ``changes`` from the command line where they are not None."""
        plan: dict[str, Any] = {
            "columns": config.scan.columns,
            "rows": config.scan.rows,
            "spacing_m": config.scan.spacing_m,
            "exposure_s": config.scan.exposure_s,
            "detector_spot_m": config.spad.spot_m,
            "skip_m": config.scan.skip_m,
            "bins": config.hydraharp.bins,
            "bin_width_s": config.hydraharp.bin_width_s,
        }
        plan.update({name: value for name, value in changes.items() if value is not None})
        return cls(**plan)

    @cached_property
    def _grid(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        x_m = (np.arange(self.columns) - (self.columns - 1) / 2) * self.spacing_m
        y_m = (np.arange(self.rows) - (self.rows - 1) / 2) * self.spacing_m
        lines = [x_m if row % 2 == 0 else x_m[::-1] for row in range(self.rows)]
        spots_m = np.zeros((self.rows * self.columns, 3))
        spots_m[:, 0] = np.concatenate(lines)
        spots_m[:, 1] = np.repeat(y_m, self.columns)
        away_m = np.abs(spots_m[:, :2] - np.asarray(self.detector_spot_m)[:2]).max(axis=1)
        kept = away_m > self.skip_m / 2 if self.skip_m > 0 else np.ones(len(spots_m), bool)
        return spots_m[kept], np.repeat(np.arange(self.rows), self.columns)[kept]

    @property
    def spots_m(self) -> NDArray[np.float64]:
        """(P, 3) laser spots in the order in which they are visited."""
        return self._grid[0]

    @property
    def line_of_position(self) -> NDArray[np.int64]:
        """(P,) which line of the grid each position belongs to."""
        return self._grid[1]

    @property
    def positions(self) -> int:
        """Number of positions P that are measured."""
        return len(self.spots_m)

    @property
    def skipped(self) -> int:
        """Number of grid positions left out around the detector's spot."""
        return self.columns * self.rows - self.positions

    @property
    def exposure_total_s(self) -> float:
        """Light on the wall over the whole scan."""
        return self.positions * self.exposure_s

    def duration_s(self, config: RigConfig) -> float:
        """Estimate how long the scan takes on hardware: exposure, settling and readout of each position."""
        each_s = self.exposure_s + config.galvo.settle_time_s + config.hydraharp.readout_time_s
        return self.positions * each_s

    @property
    def bytes_in_memory(self) -> int:
        """Size of all histograms, uncompressed."""
        return self.positions * self.bins * 4

    @property
    def bytes_on_disk(self) -> int:
        """Estimate of the compressed scan file, at the paper's count rate."""
        photons = self.exposure_total_s * ASSUMED_RATE_HZ
        return int(min(self.bytes_in_memory, photons * BYTES_PER_PHOTON + self.positions * 500))

    def check(self, config: RigConfig, folder: Path, pointing: Pointing) -> None:
        """Refuse what the rig cannot do, before anything moves.

        Parameters
        ----------
        config
            The rig's limits.
        folder
            Where the scan file shall be.
        pointing
            The model of the mirror.

        Raises
        ------
        RefusedError
            If a spot is outside the mirror's limits, the exposure does not suit the timing instrument, or the
            disk would overflow.
        """
        if not folder.is_dir():
            raise RefusedError(f"{folder} is not a folder; make it first, or choose another place with --out")
        if not self.positions:
            raise RefusedError(
                "the plan has no positions: the skipped square covers the whole grid; make skip smaller"
            )
        angles = np.abs(pointing.angles_rad(self.spots_m)).max(axis=0)
        limits = (config.galvo.max_angle_x_rad, config.galvo.max_angle_y_rad)
        for axis, angle, limit in zip("xy", angles, limits, strict=True):
            if angle > limit:
                raise RefusedError(
                    f"the grid of {self.columns} x {self.rows} at {show_length(self.spacing_m)} needs "
                    f"{np.degrees(angle):.1f} deg of mirror angle in {axis}, {np.degrees(limit):.1f} deg is "
                    "the limit. "
                    f"Use a smaller grid or spacing, or raise galvo.max_angle_{axis} if the mirror can do it"
                )
        milliseconds = self.exposure_s * 1e3
        if milliseconds < 1 or abs(milliseconds - round(milliseconds)) > 1e-6:
            raise RefusedError(
                f"an exposure of {milliseconds:g} ms is not possible: the timing instrument measures in "
                f"whole milliseconds from 1 ms on. Use {max(round(milliseconds), 1)}ms"
            )
        free = disk_usage(folder).free
        if self.bytes_on_disk > 0.95 * free:
            raise RefusedError(
                f"the scan needs about {self.bytes_on_disk / 1e6:.0f} MB, {folder} has {free / 1e6:.0f} MB "
                "free. Free some space, or choose another place with --out"
            )

    def as_dict(self) -> dict[str, Any]:
        """Return the plan as plain values, for a file."""
        return asdict(self)
