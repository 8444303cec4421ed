"""What came of a reconstruction, for people and for programs."""

from dataclasses import dataclass
from typing import Any

from rig.files.volume import Volume
from rig.model.quantities import show, show_length


@dataclass(frozen=True)
class Result:
    """What was imaged, and how.

    Attributes
    ----------
    volume
        Intensity, axes and depth map.
    reason
        Why this wavelength.
    warnings
        What may spoil the image.
    positions
        Positions used.
    took_s
        Computer time from opening the scan to the picture; of a preview, after reading.
    read_s
        How long a preview read the scan; 0 where it did not, or was none.
    """

    volume: Volume
    reason: str
    warnings: tuple[str, ...]
    positions: int
    took_s: float
    read_s: float = 0.0

    def as_dict(self) -> dict[str, Any]:
        """Return the result as plain values."""
        volume = self.volume
        moments = {} if volume.t_s is None else {"frames": len(volume.t_s)}
        return {
            **volume.parameters,
            "scan": volume.scan,
            "scan_digest": volume.scan_digest,
            "positions": self.positions,
            "voxels": (len(volume.x_m), len(volume.y_m), len(volume.z_m)),
            **moments,
            **({"wavelength_reason": self.reason} if self.reason else {}),
            "warnings": list(self.warnings),
            "took_s": round(self.took_s, 2),
            **({"read_s": round(self.read_s, 2)} if "preview_cell_m" in volume.parameters else {}),
        }

    def summary(self) -> dict[str, str]:
        """Return the result as a person reads it."""
        volume, parameters = self.volume, self.volume.parameters
        width, height, depth = len(volume.x_m), len(volume.y_m), len(volume.z_m)
        moments = {}
        if volume.t_s is not None:
            first, last = (show(float(t_s), "s") for t_s in (volume.t_s[0], volume.t_s[-1]))
            after = "of the scan" if parameters.get("each_frame") else "after the flash"
            moments = {"frames": f"{len(volume.t_s)}, {first} to {last} {after}"}
        wave = {}
        if "wavelength_m" in parameters:
            wave = {
                "camera": parameters["camera"],
                "wavelength": f"{show_length(parameters['wavelength_m'])}: {self.reason}",
                "pulse": f"{parameters['cycles']:g} cycles",
            }
        return {
            **wave,
            "solver": str(parameters["solver"]),
            "positions": f"{self.positions:,}",
            **({"calibrated": "; ".join(parameters["calibrated"])} if "calibrated" in parameters else {}),
            **({"estimated": "; ".join(parameters["estimated"])} if "estimated" in parameters else {}),
            "voxels": f"{width} x {height} x {depth}, depths {volume.z_m[0]:.2f} to {volume.z_m[-1]:.2f} m",
            **moments,
            "took": f"{self.took_s:.1f} s" + (f", and {self.read_s:.1f} s to read" if self.read_s else ""),
        }
