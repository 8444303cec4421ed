"""How the time to read a file grows with its chunks: with their number, as far as it can be seen.

Two datasets of chunks of the same size, one of few, one of very many. Told is what a chunk costs in each, in
microseconds, and the ratio; it was 30 when the index was asked for each chunk.
Run with ``pytest tests/benchmarks/test_chunks_speed.py -n 0 --benchmark-only -s``.
"""

import zlib
from time import perf_counter

import h5py
import numpy as np

from rig.files.blocks import read

FEW, MANY, SHAPE = 2_000, 64_000, (4, 20)


def test_reading_very_many_chunks(tmp_path, benchmark):
    packed = zlib.compress(np.zeros(SHAPE, "<f4").tobytes(), 1)
    with h5py.File(tmp_path / "chunks.h5", "w") as file:
        for name, number in (("few", FEW), ("many", MANY)):
            whole = (number * SHAPE[0], SHAPE[1])
            dataset = file.create_dataset(name, whole, "<f4", chunks=SHAPE, compression="gzip")
            for first in range(0, whole[0], SHAPE[0]):
                dataset.id.write_direct_chunk((first, 0), packed)

    def each_us(name, number):
        began_s = perf_counter()
        read(file[name])
        return 1e6 * (perf_counter() - began_s) / number

    with h5py.File(tmp_path / "chunks.h5") as file:
        few_us = min(each_us("few", FEW) for _ in range(3))
        many_us = benchmark.pedantic(each_us, args=("many", MANY), rounds=1)
    print(f"\na chunk of {FEW}: {few_us:.0f} us, of {MANY}: {many_us:.0f} us, ratio {many_us / few_us:.1f}")
