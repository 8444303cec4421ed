"""What imaging gives, by whatever solver and camera."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.camera import Camera
from recon.errors import ReconError
from recon.grid import VoxelGrid
from recon.sampling import CONFOCAL, DepthBlock
from recon.wave import VirtualPulse
from recon.window import Window

#: Largest part of a field: its square, 1e36, and 200 times that are within single precision.
MOST_FIELD = 1e18


def require_bounded(largest: float) -> None:
    """Refuse a field whose intensity is not within single precision.

    Parameters
    ----------
    largest
        Its largest part, or magnitude.

    Raises
    ------
    recon.errors.ReconError
        If it is larger than `MOST_FIELD`, or no number.
    """
    if not largest <= MOST_FIELD:  # NaN is not, either
        raise ReconError(
            "image",
            "an intensity in single precision",
            f"the field reaches {largest:.2g}, and its square is too large or not finite",
            "No detector counts so many photons: divide the counts by a constant.",
        )


@dataclass(frozen=True)
class Image:
    """A volume, or the front view of a volume at many moments, and what it was made from.

    Attributes
    ----------
    grid
        Its voxels.
    field
        (z, y, x) complex64 field U of a virtual wave, or float32 amplitude of an earlier method, not
        negative; both are linear in photon counts. None for a video.
    solver, window, camera
        What was asked.
    pulse
        The virtual illumination; None for an earlier method.
    depth_blocks
        Which bins and frequencies image which planes; empty where that is not how it was made.
    times_s, frames
        (T,) moments since the flash, and (T, y, x) float32 intensity over depth of a video; None for an
        image.
    late_s
        (z, y, x) float32: by how much later than each voxel is read its pulse is at its peak; None where that
        was not asked. It is zero on a surface, see `recon.depth`.
    falloff_power
        Power of 1/depth left in the intensity that `recon.depth.compensate_falloff` should undo for the eye.
    snr
        Ratio of signal to noise power of a Wiener filter; None where there is none.
    notes
        What a reader has to know, in sentences.

    Raises
    ------
    recon.errors.ReconError
        If the field or a film is not finite, or so large that its intensity would not be.
    """

    grid: VoxelGrid
    field: NDArray[np.complex64] | NDArray[np.float32] | None
    solver: str
    window: Window
    camera: Camera = CONFOCAL
    pulse: VirtualPulse | None = None
    depth_blocks: tuple[DepthBlock, ...] = ()
    times_s: NDArray[np.float64] | None = None
    frames: NDArray[np.float32] | None = None
    late_s: NDArray[np.float32] | None = None
    falloff_power: float = 4.0
    snr: float | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.frames is not None and self.frames.size:
            require_bounded(float(np.sqrt(self.frames.max())))
        if self.field is None or not self.field.size:
            return
        parts = (self.field.real, self.field.imag) if np.iscomplexobj(self.field) else (self.field,)
        require_bounded(max(max(float(part.max()), -float(part.min())) for part in parts))

    @property
    def amplitude(self) -> NDArray[np.float32]:
        """Square root of the intensity, linear in counts."""
        return np.sqrt(self.intensity) if self.field is None else np.abs(self.field)

    @property
    def intensity(self) -> NDArray[np.float32]:
        """(z, y, x) float32 square of the field's magnitude; (T, y, x) of a video."""
        if self.field is None:
            assert self.frames is not None
            return self.frames
        if np.iscomplexobj(self.field):
            return self.field.real**2 + self.field.imag**2
        return np.square(self.field.real)
