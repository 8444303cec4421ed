"""What every solver and camera gives: an image, or a video."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from recon.camera import Camera
from recon.grid import VoxelGrid
from recon.registry import SOLVERS
from recon.sampling import CONFOCAL, Slab
from recon.wave import VirtualPulse
from recon.window import Fades

#: How depths are put into one picture: the greatest intensity, or the sum of all, or what is on the surface.
Over = Literal["max", "sum", "surface"]


@dataclass(frozen=True)
class Image:
    """A focused volume, or a front view at many moments, and what it was made from.

    Attributes
    ----------
    grid
        Its voxels.
    solver, fades, pulse, camera
        What was asked; there is no pulse where no virtual wave was formed.
    field
        (z, y, x) complex64 field U. Of a solver without a wave the float32 amplitude, not negative and
        linear in photon counts as |U| is. None of a video.
    slabs
        Which bins and frequencies image which planes; the back-projection solver uses the pulse itself.
    snr
        Ratio of signal to noise power of the Wiener filter; None where there is none.
    notes
        What a reader has to know, in sentences.
    times_s, surface_m, frames, over
        Of a video: (T,) moments since the flash of the virtual source, the (T, y, x) float32 front views,
        and how depths were put into them.
    """

    grid: VoxelGrid
    solver: str
    fades: Fades
    field: NDArray | None = None
    pulse: VirtualPulse | None = None
    camera: Camera = CONFOCAL
    slabs: tuple[Slab, ...] = ()
    snr: float | None = None
    notes: tuple[str, ...] = ()
    times_s: NDArray[np.float64] | None = None
    surface_m: NDArray[np.float32] | None = None
    frames: NDArray[np.float32] | None = None
    over: Over | None = None

    @property
    def amplitude(self) -> NDArray[np.float32]:
        """(z, y, x) float32 |U|, linear in photon counts."""
        assert self.field is not None
        return np.abs(self.field)

    @property
    def intensity(self) -> NDArray[np.float32]:
        """(z, y, x) float32 intensity I = |U|^2; of a video (T, y, x)."""
        if self.frames is not None:
            return self.frames
        assert self.field is not None
        if self.field.dtype.kind == "f":
            return np.asarray(self.field**2)
        return np.asarray(self.field.real**2 + self.field.imag**2)

    @property
    def falloff_power(self) -> float:
        """Power of 1/depth left in the intensity that `compensate_falloff` should undo for the eye."""
        return SOLVERS[self.solver].falloff_power
