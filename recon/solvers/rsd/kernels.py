"""Elementwise passes of the RSD solver, each over memory once.

Complex numbers that are transformed by DCT are kept as two planes (real, imaginary), those that are
transformed by FFT interleaved, as each library wants them.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

F64 = NDArray[np.float64]
F32 = NDArray[np.float32]
C64 = NDArray[np.complex64]
INT = NDArray[np.intp]


@njit(nogil=True, cache=True, inline="always")
def _unit(turns: float) -> tuple[np.float32, np.float32]:
    """Cosine and sine of 2 pi `turns`, to 3e-7; vectorises, unlike the library's.

    The fraction of a turn is taken in double precision, Taylor series of its half follow in single precision,
    and the double-angle formulae.
    """
    x = np.float32((turns - np.floor(turns + 0.5)) * np.pi)
    q = x * x
    s = x * (1 - q * (1 / 6 - q * (1 / 120 - q * (1 / 5040 - q * (1 / 362880 - q / 39916800)))))
    c = 1 - q * (0.5 - q * (1 / 24 - q * (1 / 720 - q * (1 / 40320 - q * (1 / 3628800 - q / 479001600)))))
    return 1 - 2 * s * s, 2 * s * c


@njit(nogil=True, cache=True, error_model="numpy")
def spherical_wave(
    y_m: F64, x_m: F64, z_m: float, turns_per_m: float, step_turns_per_m: float, wave: F32, step: F32
) -> None:
    """Evaluate exp(2 pi i a r)/r, and the factor exp(2 pi i b r) that takes it one frequency up.

    Parameters
    ----------
    y_m, x_m, z_m
        Offsets along the axes, and depth; r is their norm.
    turns_per_m, step_turns_per_m
        a and b: lowest frequency and spacing, in turns of phase for each metre of r.
    wave, step
        (2, y, x) float32 results.
    """
    for j in range(len(y_m)):
        across = y_m[j] * y_m[j] + z_m * z_m
        for i in range(len(x_m)):
            r = np.sqrt(across + x_m[i] * x_m[i])
            c, s = _unit(turns_per_m * r)
            wave[0, j, i] = c / r
            wave[1, j, i] = s / r
            c, s = _unit(step_turns_per_m * r)
            step[0, j, i] = c
            step[1, j, i] = s


@njit(nogil=True, cache=True, error_model="numpy")
def phase(times_s: F64, turns_per_s: float, turned: C64) -> None:
    """Evaluate exp(2 pi i a t) into `turned`, both (y, x)."""
    for j in range(times_s.shape[0]):
        for i in range(times_s.shape[1]):
            c, s = _unit(turns_per_s * times_s[j, i])
            turned[j, i] = complex(c, s)


@njit(nogil=True, cache=True, fastmath=True)
def next_frequency(wave: F32, step: F32) -> None:
    """Multiply `wave` by `step`, both (2, y, x)."""
    for j in range(wave.shape[1]):
        for i in range(wave.shape[2]):
            re, im = wave[0, j, i], wave[1, j, i]
            a, b = step[0, j, i], step[1, j, i]
            wave[0, j, i] = re * a - im * b
            wave[1, j, i] = re * b + im * a


@njit(nogil=True, cache=True, fastmath=True)
def multiply(wall: C64, kernel: F32, out: C64, add: bool) -> None:
    """Multiply a spectrum (2 h, 2 w) by an even kernel's quarter (2, h + 1, w + 1), into or onto `out`.

    The product is folded into `out` where that is shorter by whole factors: parts of its length are added up.
    """
    height, width = wall.shape
    high, wide = out.shape
    half = width // 2
    line = np.empty(width, np.complex64)  # the kernel's row as a whole: so the compiler vectorises products
    for folded in range(high):
        target = out[folded]
        for j in range(folded, height, high):
            re, im = kernel[0, min(j, height - j)], kernel[1, min(j, height - j)]
            for i in range(half + 1):
                line[i] = complex(re[i], im[i])
            for i in range(1, half):
                line[width - i] = line[i]
            for start in range(0, width, wide):
                source, factors = wall[j, start : start + wide], line[start : start + wide]
                if add or j > folded or start > 0:
                    for i in range(wide):
                        target[i] += source[i] * factors[i]
                else:
                    for i in range(wide):
                        target[i] = source[i] * factors[i]


@njit(nogil=True, cache=True, fastmath=True)
def unfold(kernel: F32, whole: C64) -> None:
    """Write out an even kernel's quarter (2, h + 1, w + 1) as the whole (2 h, 2 w)."""
    height, width = whole.shape
    half = width // 2
    for j in range(height):
        re, im = kernel[0, min(j, height - j)], kernel[1, min(j, height - j)]
        for i in range(half + 1):
            whole[j, i] = complex(re[i], im[i])
        for i in range(half + 1, width):
            whole[j, i] = complex(re[width - i], im[width - i])


@njit(nogil=True, cache=True, fastmath=True)
def read_rows(lattice: C64, first: INT, weights: F32, out: C64) -> None:
    """Interpolate (lattice rows, width) along its first axis into (rows, width)."""
    for j in range(len(first)):
        # Rows taken out first: so the compiler vectorises the loops over them.
        target, source, weight = out[j], lattice[first[j]], weights[j, 0]
        for i in range(len(target)):
            target[i] = weight * source[i]
        for t in range(1, weights.shape[1]):
            source, weight = lattice[first[j] + t], weights[j, t]
            for i in range(len(target)):
                target[i] += weight * source[i]


@njit(nogil=True, cache=True, fastmath=True)
def _along(row: C64, first: INT, weights: F32, line: C64) -> C64:
    """Interpolate a row at the voxels, into `line`; where they are its points in turn, return these."""
    if weights.shape[1] == 1 and first[-1] - first[0] + 1 == len(first):
        return row[first[0] : first[-1] + 1]
    for i in range(len(first)):
        field = weights[i, 0] * row[first[i]]
        for t in range(1, weights.shape[1]):
            field += weights[i, t] * row[first[i] + t]
        line[i] = field
    return line


@njit(nogil=True, cache=True, fastmath=True)
def add_field(total: C64, step: C64, rows: C64, first: INT, weights: F32) -> None:
    """Take Horner's step, total <- total * step + field, the field interpolated along the rows."""
    line = np.empty(len(first), np.complex64)
    for j in range(total.shape[0]):
        fields, sums, turns = _along(rows[j], first, weights, line), total[j], step[j]
        for i in range(len(sums)):
            sums[i] = sums[i] * turns[i] + fields[i]


@njit(nogil=True, cache=True, fastmath=True)
def add_field_and_slope(total: C64, slope: C64, step: C64, rows: C64, first: INT, weights: F32) -> None:
    """Take the derivative's step, slope <- (slope + total) * step, and then that of `add_field`."""
    line = np.empty(len(first), np.complex64)
    for j in range(total.shape[0]):
        fields, sums, turns = _along(rows[j], first, weights, line), total[j], step[j]
        slopes = slope[j]
        for i in range(len(sums)):
            before = sums[i]
            slopes[i] = (slopes[i] + before) * turns[i]
            sums[i] = before * turns[i] + fields[i]


@njit(nogil=True, cache=True, fastmath=True)
def add_turned(total: C64, turn: C64, step: C64, rows: C64, first: INT, weights: F32) -> None:
    """Add `turn` times the field, interpolated along the rows; then `turn` <- `turn` * `step`."""
    line = np.empty(len(first), np.complex64)
    for j in range(total.shape[0]):
        fields, sums, turns, steps = _along(rows[j], first, weights, line), total[j], turn[j], step[j]
        for i in range(len(sums)):
            sums[i] += turns[i] * fields[i]
        for i in range(len(turns)):
            turns[i] *= steps[i]


@njit(nogil=True, cache=True, fastmath=True)
def spread_rows(rows: C64, first: INT, weights: F32, lattice: C64) -> None:
    """Add (rows, width) onto (lattice rows, width): the adjoint of `read_rows`."""
    for j in range(len(first)):
        source = rows[j]
        for t in range(weights.shape[1]):
            target, weight = lattice[first[j] + t], weights[j, t]
            for i in range(len(source)):
                target[i] += weight * source[i]


@njit(nogil=True, cache=True, fastmath=True)
def outer(y: C64, x: C64, kernel: F32) -> None:
    """Multiply two axes' transforms into a kernel's, (2, y, x)."""
    for j in range(len(y)):
        for i in range(len(x)):
            kernel[0, j, i] = y[j].real * x[i].real - y[j].imag * x[i].imag
            kernel[1, j, i] = y[j].real * x[i].imag + y[j].imag * x[i].real
