"""An image of what is hidden, as Python programs have it."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rig.api import html
from rig.errors import UsageError, refuse_folder
from rig.exporters import page
from rig.exporters.convert import VOLUME_LAYOUTS, write_volume_as
from rig.files.taken import is_scan
from rig.files.volume import Volume, read_volume, write_volume
from rig.files.words import parameters_line
from rig.image.measures import measure
from rig.image.picture import picture
from rig.image.result import Result
from rig.image.truth import true_depth
from rig.show.endings import check_picture
from rig.show.saving import save

#: Endings of the program's own volume files.
_OWN = (".h5", ".hdf5")


class Image:
    """What a virtual camera sees of a hidden scene: `Scan.image` makes it, `rig.open_volume` reads it.

    Attributes
    ----------
    volume
        All that a volume file holds.
    reason
        Why this wavelength was chosen; empty where nobody chose, or it was read from a file.
    warnings
        What may spoil the image, in sentences.

    Examples
    --------
    >>> img = scan.image(wavelength="30cm", depth="0.8m:1.7m:5cm")
    >>> img.intensity.shape == (len(img.z_m), len(img.y_m), len(img.x_m))
    True
    >>> img.save("volume.h5").save("front.png").save("volume.npz")
    <rig.Image of letters.h5: ...>
    """

    def __init__(self, volume: Volume, result: Result | None = None) -> None:
        self.volume = volume
        self.reason = result.reason if result else ""
        self.warnings = result.warnings if result else ()
        self._result = result

    @property
    def intensity(self) -> NDArray[np.float32]:
        """(z, y, x) squared magnitude of the phasor field; of a film (t, y, x) or (t, z, y, x)."""
        return self.volume.intensity

    @property
    def x_m(self) -> NDArray[np.float64]:
        """(x,) voxel centres, to the right for one who faces the wall."""
        return self.volume.x_m

    @property
    def y_m(self) -> NDArray[np.float64]:
        """(y,) voxel centres, up."""
        return self.volume.y_m

    @property
    def z_m(self) -> NDArray[np.float64]:
        """(z,) depths from the wall."""
        return self.volume.z_m

    @property
    def t_s(self) -> NDArray[np.float64] | None:
        """(t,) moments of a film; None of an image."""
        return self.volume.t_s

    @property
    def depth_m(self) -> NDArray[np.float32] | None:
        """(y, x) depth of the surface that is seen, NaN where there is none; None where it was not made."""
        return self.volume.depth_m

    @property
    def confidence(self) -> NDArray[np.float32] | None:
        """(y, x) probability that noise alone stays below what is seen; None where it was not made."""
        return self.volume.confidence

    @property
    def parameters(self) -> Mapping[str, Any]:
        """How it was made: camera, solver, wavelength and so on, numbers in SI units."""
        return self.volume.parameters

    def plot(self) -> Figure:
        """Draw it as `rig recon` does: projections, depth map and confidence, or the frames of a film."""
        return picture(self.volume)

    def measure(self, truth: str | os.PathLike[str] | NDArray[np.floating] | None = None) -> dict[str, Any]:
        """Return the numbers of `rig measure`.

        Parameters
        ----------
        truth
            What is really there: ``"scene:letters"``, a file, or (y, x) depths, NaN where nothing is.

        Raises
        ------
        rig.errors.UsageError
            If it is a film, or dark, or the truth is not known.
        rig.errors.DataFileError
            If the file of the truth is damaged.
        """
        if truth is None or isinstance(truth, np.ndarray):
            truth_m = None if truth is None else np.asarray(truth, np.float64)
        else:
            truth_m = true_depth(os.fspath(truth), self.x_m, self.y_m)
        if truth_m is not None and truth_m.shape != self.intensity.shape[-2:]:
            raise UsageError(
                f"the truth has {truth_m.shape} pixels, the image {self.intensity.shape[-2:]}; give depths "
                "at the image's own y_m and x_m"
            )
        return measure(self.volume, truth_m).document

    def save(self, path: str | os.PathLike[str], *, replace: bool = False) -> "Image":
        """Write it to a file, whole or not at all; the ending says as what.

        Parameters
        ----------
        path
            ``.h5``: a volume file. ``.png``, ``.pdf``, ``.svg``: the picture of `plot`. ``.html``: a page to
            turn it by hand. ``.npz``, ``.mat``, ``.vti``, ``.tif``, ``.ply``, ``.glb``: for other programs.
        replace
            Whether a file of this name is replaced; a scan never is.

        Returns
        -------
        Image
            Itself.

        Raises
        ------
        rig.errors.UsageError
            If the name is taken, or the ending is not known.
        rig.errors.DataFileError
            If the file cannot be written.
        """
        target = Path(path)
        _require_free(target, replace)
        ending = target.suffix.lower()
        if ending in _OWN:
            write_volume(target, self.volume)
        elif any(ending in layout.ENDINGS for layout in VOLUME_LAYOUTS):
            write_volume_as(self.volume, target, replaces=replace)
        else:
            check_picture(target)
            save(self.plot(), target)
        return self

    def page(self, path: str | os.PathLike[str], *, replace: bool = False) -> "Image":
        """Write a web page on which it is turned by hand; raises as `save`."""
        if Path(path).suffix.lower() not in page.ENDINGS:
            raise UsageError(f"cannot write the page {path}: its ending must be {' or '.join(page.ENDINGS)}")
        return self.save(path, replace=replace)

    def _facts(self) -> dict[str, str]:
        if self._result:
            return self._result.summary()
        volume = self.volume
        size = " x ".join(str(len(axis)) for axis in (volume.x_m, volume.y_m, volume.z_m))
        depths = f"{volume.z_m[0]:.2f} to {volume.z_m[-1]:.2f} m"
        return {"made with": parameters_line(volume), "voxels": f"{size}, depths {depths}"}

    def __repr__(self) -> str:
        shape, name = " x ".join(map(str, self.intensity.shape)), self.volume.scan or "an unnamed scan"
        return f"<rig.Image of {name}: {shape}, {parameters_line(self.volume)}>"

    def __str__(self) -> str:
        return html.lines(f"Image of {self.volume.scan}", self._facts(), self.warnings)

    def _repr_html_(self) -> str:
        facts = html.table(f"Image of {self.volume.scan}", self._facts(), self.warnings)
        return facts + html.picture(self.plot(), f"projections of the image of {self.volume.scan}")


def open_volume(path: str | os.PathLike[str]) -> Image:
    """Read a volume file, as `rig recon` and `Image.save` write it.

    Raises
    ------
    rig.errors.DataFileError
        If the file is missing, damaged, or no volume.

    Examples
    --------
    >>> rig.open_volume("volume.h5").z_m[[0, -1]].round(2)
    array([0.8, 1.7])
    """
    return Image(read_volume(Path(path)))


def _require_free(path: Path, replace: bool) -> None:
    """Refuse a name that is taken."""
    if not os.path.lexists(path):
        return
    refuse_folder(path)
    if not replace:
        raise UsageError(
            f"{path} exists and is not overwritten; give another name, or replace it with replace=True"
        )
    if is_scan(path):
        raise UsageError(f"{path} is a scan, which replace=True does not replace; give another name")
