"""The RSD solver in plain array operations, for any library that speaks numpy's: numpy, torch, cupy.

The same sum as `recon.solvers.rsd.regular` on the same lattice, without its fused passes: for one plane and
a batch of frequencies the spherical wave is evaluated, transformed, multiplied by the wall's spectrum and
transformed back. It is for graphics processors, where batches are what counts; elsewhere the fused solver
is quicker.
Only what the three libraries spell alike is used, and nothing but numpy need be installed.
"""

import importlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.aperture import Aperture
from recon.capture import C_M_PER_S
from recon.errors import ParameterError
from recon.grid import VoxelGrid
from recon.solvers.rsd.lattice import AxisPlan, plan_axis
from recon.wave import Band

#: Memory for one batch of frequencies: the wave's phase in double precision, its transform, and the product.
BATCH_BYTES = 512 * 2**20
#: Bytes of one point and frequency of a batch.
POINT_BYTES = 64


@dataclass(frozen=True)
class Backend:
    """Where arrays live.

    Attributes
    ----------
    xp
        The library: numpy, torch or cupy.
    device
        "cpu" or "cuda".
    """

    xp: Any
    device: str

    def array(self, values: NDArray) -> Any:
        """Copy an array there."""
        if self.xp.__name__ == "torch":
            return self.xp.asarray(values, device=self.device)
        return self.xp.asarray(values)

    def numpy(self, values: Any) -> NDArray:
        """Copy an array back."""
        if self.xp.__name__ == "torch":
            return values.cpu().numpy()
        return values.get() if self.xp.__name__ == "cupy" else values


def backend(device: str, library: str | None = None) -> Backend:
    """Open a device.

    Parameters
    ----------
    device
        "cpu" or "cuda".
    library
        "numpy", "torch" or "cupy"; by default numpy on the processor, and torch or cupy, whichever is
        installed, on the graphics processor.

    Raises
    ------
    ParameterError
        If the device or the library is unknown, missing, or without that device.
    """
    known = {"cpu": ("numpy", "torch"), "cuda": ("torch", "cupy")}
    if device not in known or (library is not None and library not in known[device]):
        raise ParameterError(
            "device",
            f"{device!r} by {library or 'any library'}",
            "there is no such device",
            "Choose cpu (numpy, torch) or cuda (torch, cupy).",
        )
    refused = []
    for name in (library,) if library else known[device]:
        try:
            xp = importlib.import_module(name)
        except ImportError:
            refused.append(f"{name} is not installed")
            continue
        if device == "cpu" or _has_cuda(xp):
            return Backend(xp, device)
        refused.append(f"{name} finds no CUDA device")
    raise ParameterError(
        "device",
        device,
        ", ".join(refused),
        "Install torch with CUDA or cupy together with a working driver, or use cpu.",
    )


def _has_cuda(xp: Any) -> bool:
    if xp.__name__ == "torch":
        return bool(xp.cuda.is_available())
    try:
        return int(xp.cuda.runtime.getDeviceCount()) > 0
    except xp.cuda.runtime.CUDARuntimeError:
        return False


def focus_block(
    aperture: Aperture,
    emitted: NDArray[np.complex64],
    band: Band,
    grid: VoxelGrid,
    round_trip_factor: int,
    times_s: Sequence[NDArray[np.float64]],
    progress: Callable[[float], None] | None = None,
    *,
    reference_rad_per_s: float | None = None,
    near_m: float | None = None,
    on: Backend | None = None,
    batch_bytes: int = BATCH_BYTES,
) -> Iterator[NDArray[np.complex64]]:
    """Image all planes of a grid with one band, and yield them in order of depth.

    The wall's spectra at all frequencies stay on the device; its planes leave it one by one.

    Parameters
    ----------
    aperture, emitted, band, grid, round_trip_factor
        As of `recon.solvers.rsd.regular.LatticePropagator`.
    times_s
        For each plane, the (T, y or 1, x or 1) moments at which voxels are read.
    progress
        Called with the fraction that is done.
    reference_rad_per_s
        Frequency omega_0 from which the change with time is counted; None leaves it out.
    near_m
        Depth that the lattice is planned for; None takes the nearest of the voxels.
    on
        Where to compute; numpy by default.
    batch_bytes
        Memory of a batch; it sets how many frequencies are taken at once.

    Yields
    ------
    ndarray
        (T, y, x) complex64 field U, and then as many dU/dt - i omega_0 U where they are asked for; in numpy's
        memory.
    """
    on = on or backend("cpu")
    xp = on.xp
    wavenumber = round_trip_factor * band.finest_rad_per_s / C_M_PER_S
    near_m = float(grid.z_m[0]) if near_m is None else near_m
    y, x = (
        plan_axis(axis, at_m, wavenumber, near_m)
        for axis, at_m in ((aperture.y, grid.y_m), (aperture.x, grid.x_m))
    )
    lateral2 = on.array(_offsets(y)[:, None] ** 2 + _offsets(x) ** 2)
    readings = [(on.array(axis.first), on.array(axis.weights)) for axis in (y, x)]
    factors = [np.ones(len(band), np.complex64)]
    if reference_rad_per_s is not None:
        factors.append((1j * (band.frequencies_rad_per_s - reference_rad_per_s)).astype(np.complex64))
    at_once = max(1, batch_bytes // (POINT_BYTES * y.length * x.length))
    batches = [
        _Batch.of(on, aperture, emitted, band, slice(start, start + at_once), (y, x), factors)
        for start in range(0, len(band), at_once)
    ]
    for plane, (z_m, moments_s) in enumerate(zip(grid.z_m, times_s, strict=True)):
        r = xp.sqrt(lateral2 + float(z_m) ** 2)
        field: Any = 0
        for batch in batches:
            wave = _unit(xp, round_trip_factor / C_M_PER_S * batch.turns_per_s * r) / _single(xp, r)
            spectrum = _fold(xp.fft.fft2(wave) * batch.wall, y, x)
            turned = on.array(moments_s)[:, None] * batch.turns_per_s
            field = field + _at_moments(xp, spectrum, _unit(xp, turned), batch.factors, readings)
        yield on.numpy(field.reshape(-1, *grid.shape[1:]))
        if progress:
            progress((plane + 1) / len(grid.z_m))


@dataclass(frozen=True)
class _Batch:
    """Some frequencies of a band, on the device.

    Attributes
    ----------
    wall
        (F, y, x) spectra of what the wall emits.
    turns_per_s
        (F, 1, 1) frequencies.
    factors
        (S, F, 1, 1) by which each frequency is multiplied for each of the sums.
    """

    wall: Any
    turns_per_s: Any
    factors: Any

    @classmethod
    def of(
        cls,
        on: Backend,
        aperture: Aperture,
        emitted: NDArray[np.complex64],
        band: Band,
        part: slice,
        axes: tuple[AxisPlan, AxisPlan],
        factors: Sequence[NDArray[np.complex64]],
    ) -> "_Batch":
        """Put the frequencies of a part of the band there."""
        turns_per_s = band.frequencies_rad_per_s[part, None, None] / (2 * np.pi)
        return cls(
            on.xp.fft.fft2(on.array(_wall(aperture, emitted[part], *axes))),
            on.array(turns_per_s),
            on.array(np.stack([one[part, None, None] for one in factors])),
        )


def _at_moments(
    xp: Any, spectrum: Any, turned: Any, factors: Any, readings: Sequence[tuple[Any, Any]]
) -> Any:
    """Sum frequencies at moments.

    Parameters
    ----------
    xp
        The library.
    spectrum
        (F, folded y, folded x) spectra of the plane's fields.
    turned
        (T, F, y or 1, x or 1) phases of the moments.
    factors
        (S, F, 1, 1), see `_Batch`.
    readings
        Of both axes, see `_read`.

    Returns
    -------
    array
        (S, T, y, x).
    """
    if turned.shape[2] * turned.shape[3] == 1:  # the same moment everywhere: sum first, then transform once
        flat, moments = spectrum.reshape(len(spectrum), -1), turned[:, :, 0, 0]
        sums = [((moments * factor[:, 0, 0]) @ flat).reshape(-1, *spectrum.shape[1:]) for factor in factors]
        return xp.stack([_read(xp.fft.ifft2(one), *readings) for one in sums])
    fields = _read(xp.fft.ifft2(spectrum), *readings)
    return xp.stack(
        [xp.stack([(fields * moment * factor).sum(0) for moment in turned]) for factor in factors]
    )


def _offsets(axis: AxisPlan) -> NDArray[np.float64]:
    """Return the distance of each point of the FFT from point 0, around the shorter way."""
    index = np.arange(axis.length)
    return np.minimum(index, axis.length - index) * axis.step_m


def _wall(
    aperture: Aperture, emitted: NDArray[np.complex64], y: AxisPlan, x: AxisPlan
) -> NDArray[np.complex64]:
    """Put positions on the lattice: (F, y, x)."""
    flat = np.zeros((len(emitted), aperture.y.count * aperture.x.count), np.complex64)
    at = aperture.row * aperture.x.count + aperture.column
    for points, values in zip(flat, emitted, strict=True):
        np.add.at(points, at, values)
    grid = flat.reshape(len(emitted), aperture.y.count, aperture.x.count)
    wall = np.zeros((len(emitted), y.length, x.length), np.complex64)
    wall[:, y.wall[:, None], x.wall] = _spreading(y) @ grid @ _spreading(x).T
    return wall


def _spreading(axis: AxisPlan) -> NDArray[np.float32]:
    """Return (points, wall points) what each point that emits takes of each point of the wall's axis."""
    if axis.spread is None:
        return np.eye(len(axis.wall), dtype=np.float32)
    first, weights = axis.spread
    matrix = np.zeros((len(axis.wall), len(first)), np.float32)
    columns = np.arange(len(first))[:, None]
    matrix[first[:, None] + np.arange(weights.shape[1]), columns] = weights
    return matrix


def _fold(spectra: Any, y: AxisPlan, x: AxisPlan) -> Any:
    """Fold spectra (F, y, x) to the points that are read; the inverse FFT divides by as many fewer."""
    parts = spectra.reshape(-1, y.fold, y.folded, x.fold, x.folded)
    return parts.sum(3).sum(1) / (y.fold * x.fold)


def _single(xp: Any, values: Any) -> Any:
    return xp.asarray(values, dtype=xp.float32)


def _unit(xp: Any, turns: Any) -> Any:
    """Return exp(2 pi i turns) in single precision; the fraction of a turn is taken in double."""
    return xp.exp(2j * np.pi * _single(xp, turns - xp.floor(turns)))


def _read(fields: Any, rows: tuple[Any, Any], columns: tuple[Any, Any]) -> Any:
    """Interpolate (F, lattice y, lattice x) at the voxels, along y and then along x."""
    first, weights = rows
    fields = sum(fields[:, first + t, :] * weights[:, t][:, None] for t in range(weights.shape[1]))
    first, weights = columns
    return sum(fields[:, :, first + t] * weights[:, t] for t in range(weights.shape[1]))
