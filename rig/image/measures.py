"""Measures of a volume file: resolution, contrast and noise, and its distance from a truth."""

from dataclasses import asdict, dataclass
from math import isnan
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.depth import compensate_falloff, depth_map, front_view
from recon.measures import (
    CLOSE_M,
    contrast,
    depth_error,
    displacement_m,
    overlap,
    predicted,
    pulse_depth_m,
    signal_to_noise,
    surroundings,
    widths,
)
from rig.errors import UsageError
from rig.files import ScanFile, Volume
from rig.model.quantities import show_length


@dataclass(frozen=True)
class Wall:
    """The aperture that made a volume.

    Attributes
    ----------
    width_m, height_m
        From the first to the last laser spot.
    confocal
        Whether laser and detector both scan.
    """

    width_m: float
    height_m: float
    confocal: bool


def wall_of(volume: Volume, volume_path: Path, scan_path: Path | None) -> Wall | None:
    """Find the wall in a scan file: the one given, else the volume's own, if it lies beside the volume.

    Raises
    ------
    DataFileError
        If a given scan file cannot be read.
    """
    if scan_path is None:
        beside = volume_path.parent / Path(volume.scan).name if volume.scan else None
        if beside is None or not beside.is_file():
            return None
        with ScanFile(beside) as scan:
            if scan.digest != volume.scan_digest:
                return None
        scan_path = beside
    with ScanFile(scan_path) as scan:
        extent_m = np.ptp(scan.laser_m, axis=0)
        return Wall(float(extent_m[0]), float(extent_m[1]), scan.capture().confocal)


@dataclass(frozen=True)
class Measures:
    """What was measured; lengths in metres, None where it has no meaning.

    Attributes
    ----------
    document
        Nested plain values, ready for JSON.
    """

    document: dict[str, Any]

    def summary(self) -> dict[str, str]:
        """Return it as a person reads it."""
        found = self.document
        peak = found["peak"]
        lines = {"peak": f"x {_length(peak['x_m'])}, y {_length(peak['y_m'])}, z {_length(peak['z_m'])}"}
        for axis, width in found["widths"].items():
            line = f"{_length(width['fwhm_m'])} at half maximum"
            if width["first_minimum_m"] is not None:
                line += f", first minimum {_length(width['first_minimum_m'])} away"
            theory = width["theory"]
            if "rayleigh_m" in theory:
                line += f"; Rayleigh {_length(theory['rayleigh_m'])}"
            if "fwhm_m" in theory:
                line += f"; theory {_length(theory['fwhm_m'])} at half maximum"
            lines[f"width {axis}"] = line
        lines["contrast"] = _number(found["contrast"])
        lines["signal to noise"] = _number(found["signal_to_noise"])
        lines["pixels seen"] = f"{found['pixels_seen']:,}"
        if "depth" in found:
            depth = found["depth"]
            lines["overlap"] = f"{_number(found['overlap'])} (intersection over union)"
            aside = found["displacement"]
            lines["displacement"] = f"x {_length(aside['x_m'])}, y {_length(aside['y_m'])}"
            lines["depth error"] = (
                f"median {_length(depth['median_m'])}, mean {_length(depth['mean_m'])}, "
                f"rms {_length(depth['rms_m'])}"
            )
            lines["absolute"] = (
                f"median {_length(depth['median_absolute_m'])}, mean {_length(depth['mean_absolute_m'])}, "
                f"over {depth['pixels']:,} pixels"
            )
            if depth["close"] is not None:
                lines[f"within {show_length(CLOSE_M)}"] = f"{100 * depth['close']:.1f} %"
        return lines


def measure(
    volume: Volume,
    truth_m: NDArray[np.float64] | None = None,
    wall: Wall | None = None,
    *,
    threshold: float | None = None,
    falloff: float = 4.0,
    margin_m: float | None = None,
) -> Measures:
    """Measure a volume.

    Parameters
    ----------
    volume
        Of a camera whose image has no time axis.
    truth_m
        (y, x) true depth on the volume's axes, NaN where nothing is.
    wall
        The aperture, for the formulas of diffraction.
    threshold
        Pixels whose front view is at least this part of the greatest are seen; None takes the volume's own
        depth map as it is, or 0.05 where it has none.
    falloff
        Power of depth that intensity is multiplied by first, except for the widths.
    margin_m
        The background begins this far from the object; None takes the wavelength, or a pixel where the volume
        has none.

    Raises
    ------
    UsageError
        If the volume has a time axis, or is dark throughout.
    """
    if volume.t_s is not None:
        raise UsageError("a volume with a time axis has no single depth or peak; measure a confocal image")
    if not volume.intensity.max() > 0:
        raise UsageError("the volume is zero everywhere: there is nothing to measure; choose other depths")
    compensated = compensate_falloff(volume.intensity, volume.z_m, power=falloff)
    depth_m = volume.depth_m
    if threshold is not None or depth_m is None:
        depth_m = depth_map(
            compensated, volume.z_m, 0.05 if threshold is None else threshold, lifted=falloff - 2
        )
    seen = np.isfinite(depth_m)
    occupied = seen if truth_m is None else np.isfinite(truth_m)
    if margin_m is None:
        pitch_m = float(volume.x_m[1] - volume.x_m[0]) if len(volume.x_m) > 1 else 0.0
        margin_m = max(float(volume.parameters.get("wavelength_m", 0.0)), pitch_m)
    around = surroundings(occupied, volume.x_m, volume.y_m, margin_m)
    front = front_view(compensated)
    found: dict[str, Any] = {
        "peak": _peak(volume),
        "widths": _widths(volume, wall),
        "contrast": contrast(front, occupied, around),
        "signal_to_noise": signal_to_noise(front, around),
        "background_margin_m": margin_m,
        "threshold": threshold,
        "falloff": falloff,
        "pixels_seen": int(seen.sum()),
    }
    if truth_m is not None:
        found["overlap"] = overlap(seen, occupied)
        aside = displacement_m(seen, occupied, volume.x_m, volume.y_m)
        found["displacement"] = dict(zip(("x_m", "y_m"), aside, strict=True))
        found["depth"] = asdict(depth_error(depth_m, truth_m))
    return Measures(_plain(found))


def _peak(volume: Volume) -> dict[str, float]:
    k, j, i = np.unravel_index(int(volume.intensity.argmax()), volume.intensity.shape)
    return {
        "x_m": float(volume.x_m[i]),
        "y_m": float(volume.y_m[j]),
        "z_m": float(volume.z_m[k]),
        "intensity": float(volume.intensity[k, j, i]),
    }


def _widths(volume: Volume, wall: Wall | None) -> dict[str, dict[str, Any]]:
    measured = widths(volume.intensity, volume.x_m, volume.y_m, volume.z_m)._asdict()
    wavelength_m, cycles = (volume.parameters.get(name) for name in ("wavelength_m", "cycles"))
    theory: dict[str, dict[str, float]] = {axis: {} for axis in measured}
    depth_m = _peak(volume)["z_m"]
    if wavelength_m and wall:
        for axis, aperture_m in (("x", wall.width_m), ("y", wall.height_m)):
            if aperture_m > 0:
                bound = predicted(wavelength_m, depth_m, aperture_m)
                sides = 2 if wall.confocal else 1
                theory[axis] = {
                    "aperture_m": aperture_m,
                    "paraxial_m": bound.both_m if wall.confocal else bound.one_m,
                    "rayleigh_m": bound.near_m / sides,
                    "fwhm_m": bound.slit_fwhm_m / sides,
                }
    if wavelength_m and cycles:
        theory["z"] = {"fwhm_m": pulse_depth_m(wavelength_m, cycles)}
    return {axis: asdict(width) | {"theory": theory[axis]} for axis, width in measured.items()}


def _plain(value: Any) -> Any:
    """Replace NaN, which JSON cannot hold, by None."""
    if isinstance(value, dict):
        return {name: _plain(inner) for name, inner in value.items()}
    return None if isinstance(value, float) and isnan(value) else value


def _length(value_m: float | None) -> str:
    return "unknown" if value_m is None else show_length(value_m)


def _number(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.3g}"
