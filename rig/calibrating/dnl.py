"""Bin widths: light that knows nothing of the laser fills all bins alike, but for their widths."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from rig.acquisition import Watch, record
from rig.calibrating.routine import changed, origin
from rig.calibration.kinds import BinWidths
from rig.calibration.record import Calibration
from rig.calibration.use import Calibrations
from rig.config import RigConfig
from rig.devices import Preparation
from rig.errors import CalibrationError
from rig.files.scan import ScanFile
from rig.plan import ScanPlan
from rig.session import Station


@dataclass(frozen=True)
class DnlRoutine:
    """Measures the widths of the bins that scans use."""

    exposure_s: float = 20.0
    exposures: int = 4
    kind: str = BinWidths.kind

    def setup(self, config: RigConfig) -> RigConfig:
        """Return the scan's own bins, the detector free running."""
        return changed(config, spad={"gated": False})

    def measure(
        self, station: Station, config: RigConfig, known: Calibrations, folder: Path, watch: Watch
    ) -> list[Path]:
        """Count a steady lamp."""
        station.operator.prepare(Preparation.LAMP)
        plan = ScanPlan.from_config(
            config, columns=self.exposures, rows=1, exposure_s=self.exposure_s, skip_m=0.0
        )
        path = folder / "dnl-lamp.h5"
        record(plan, config, station.devices, path, watch)
        return [path]

    def fit(self, files: Sequence[Path], config: RigConfig, known: Calibrations) -> Calibration:
        """Return widths in proportion to counts."""
        with ScanFile(files[0]) as scan:
            counts = _counts(scan)
            mean = float(counts.mean())
            if mean < 100:
                raise CalibrationError(f"{files[0]}: {mean:.1f} counts a bin are too few: measure longer")
            widths = counts / mean
            return BinWidths(
                **origin(BinWidths, [scan]),
                valid_days=365,
                bin_width_s=scan.bin_width_s,
                first_bin_s=scan.first_bin_s,
                widths=[round(float(width), 6) for width in widths],
                counts_per_bin=mean,
                nonlinearity=float(np.sqrt(max(widths.var() - 1 / mean, 0.0))),
            )

    def figure(self, files: Sequence[Path], calibration: Calibration) -> Figure:
        """Draw widths over bins."""
        assert isinstance(calibration, BinWidths)
        figure = Figure(figsize=(8, 3), layout="constrained")
        axes = figure.subplots()
        axes.plot(calibration.widths, ".", markersize=1)
        axes.set(xlabel="bin", ylabel="width [nominal bins]")
        return figure


def _counts(scan: ScanFile) -> np.ndarray:
    total = np.zeros(scan.bins)
    for _, counts in scan.capture().histograms.blocks():
        total += counts.sum(axis=0, dtype=np.float64)
    return total
