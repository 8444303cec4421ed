"""What a comparison found: each method's part, and the numbers of it that a person reads."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rig.image.work import Work
from rig.model.quantities import show, show_length


@dataclass(frozen=True)
class Compared:
    """One method's part of a comparison.

    Attributes
    ----------
    method
        Its name as a solver.
    reason
        Why there is no image; empty where there is one.
    approximate
        Whether the data had to be converted for it.
    found
        Costs, and measures as of `rig.image.measures.measure`; plain values, empty where there is no image.
    notes
        What a reader has to know, in sentences.
    """

    method: str
    reason: str = ""
    approximate: bool = False
    found: dict[str, Any] | None = None
    notes: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain values."""
        told = {"method": self.method, "applies": not self.reason}
        if self.reason:
            return {**told, "reason": self.reason}
        return {**told, "approximate": self.approximate, "notes": list(self.notes), **(self.found or {})}


@dataclass(frozen=True)
class Comparison:
    """A capture by all methods.

    Attributes
    ----------
    file, sheet
        What was compared, and the picture.
    truth
        What is really there, as `rig.image.truth.true_depth` takes it; None where nobody knows.
    work
        Pulse and voxels.
    reason
        Why this wavelength.
    low_pass_s
        Full width at half maximum of the Gaussian that the record of all but the phasor field is convolved
        with.
    methods
        One for each.
    """

    file: Path
    sheet: Path
    truth: str | None
    work: Work
    reason: str
    low_pass_s: float
    methods: tuple[Compared, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain values."""
        grid = self.work.grid
        return {
            "file": str(self.file),
            "sheet": str(self.sheet),
            "truth": self.truth,
            "positions": self.work.capture.positions,
            "wavelength_m": self.work.pulse.wavelength_m,
            "wavelength_reason": self.reason,
            "cycles": self.work.pulse.cycles,
            "low_pass_fwhm_s": self.low_pass_s,
            "voxels": (len(grid.x_m), len(grid.y_m), len(grid.z_m)),
            "depth_m": (float(grid.z_m[0]), float(grid.z_m[-1])),
            "methods": [one.as_dict() for one in self.methods],
        }

    def summary(self) -> str:
        """Return what all methods have in common, in a line."""
        pulse, grid = self.work.pulse, self.work.grid
        voxels = " x ".join(str(len(axis)) for axis in (grid.x_m, grid.y_m, grid.z_m))
        return (
            f"wavelength {show_length(pulse.wavelength_m)}, {pulse.cycles:g} cycles; the others' record "
            f"low-passed by {show(self.low_pass_s, 's')}; {voxels} voxels, depths {grid.z_m[0]:.2f} to "
            f"{grid.z_m[-1]:.2f} m"
        )


#: Heads of the table of numbers, and what stands where there is none.
HEADS = (
    "time",
    "processor",
    "memory",
    "across",
    "deep",
    "contrast",
    "signal/noise",
    "overlap",
    "depth error",
    "within 5 cm",
)
NOTHING = "–"


def row(one: Compared) -> dict[str, str]:
    """Return a method's numbers as a person reads them, by the heads of the table."""
    found = one.found or {}
    depth = found.get("depth", {})

    def told(value: float | None, form: Callable[[float], str]) -> str:
        return NOTHING if value is None else form(value)

    cells = (
        told(found.get("took_s"), _seconds),
        told(found.get("processor_s"), _seconds),
        told(found.get("memory_bytes"), lambda most: f"{most / 1e6:.0f} MB"),
        told(found.get("across_m"), lambda m: f"{m * 100:.1f} cm"),
        told(found.get("deep_m"), lambda m: f"{m * 100:.1f} cm"),
        told(found.get("contrast"), lambda c: f"{c:.2f}"),
        told(found.get("signal_to_noise"), lambda ratio: f"{ratio:.1f}"),
        told(found.get("overlap"), lambda part: f"{part:.2f}"),
        told(depth.get("median_absolute_m"), lambda m: f"{m * 1000:.0f} mm"),
        told(depth.get("close"), lambda part: f"{100 * part:.0f} %"),
    )
    return dict(zip(HEADS, cells, strict=True))


def _seconds(duration_s: float) -> str:
    return f"{duration_s:.2g} s" if duration_s < 10 else f"{duration_s:.0f} s"
