"""The library of FFTs, told how many threads it may have in words that it understands.

It reads ``OMP_NUM_THREADS`` itself, once, and fails where that is a list for nested loops, as OpenMP allows.
"""

from os import environ

from recon.computer import usual_threads

environ.setdefault("DUCC0_NUM_THREADS", str(usual_threads()))

from ducc0.fft import c2c, c2r, dct, good_size, r2c

__all__ = ["c2c", "c2r", "dct", "good_size", "r2c"]
