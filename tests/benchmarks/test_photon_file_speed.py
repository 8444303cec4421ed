"""What writing a time-tagged scan costs, beside a floor: h5py writes the same photons at once, then fsync.

The writer does more: a journal, forced to disk at each line, checksums, packing, reading back. The ratio is
told, with the share of a processor core that a scan takes while it runs, and nothing is asserted.
Run with ``pytest tests/benchmarks/test_photon_file_speed.py -n 0 --benchmark-only -s``.
"""

import os
from time import perf_counter, process_time

import h5py
import numpy as np
import pytest

from rig.files import ScanDescription, ScanWriter

BINS, DWELL_S, LINE = 25_000, 1e-3, 180


def photons_of(rate_hz, steps):
    """Light that fades over 10 ns, and a third of background: (steps, photons) bins of 4 ps."""
    rng = np.random.default_rng(0)
    shape = (steps, round(rate_hz * DWELL_S))
    light = 4000 + rng.exponential(2500, shape).astype(np.int64)
    return np.where(rng.random(shape) < 1 / 3, rng.integers(0, BINS, shape), light % BINS).astype("u2")


@pytest.mark.parametrize(("rate_hz", "duration_s"), [(205e3, 25.0), (265e3, 25.0), (10e6, 3.0)])
def test_writing_photons(tmp_path, benchmark, rate_hz, duration_s):
    steps = round(duration_s / DWELL_S)
    photons = photons_of(rate_hz, steps)
    of_channel, path = np.array([photons.shape[1]]), tmp_path / "scan.h5"
    description = ScanDescription(np.zeros((steps, 3)), np.zeros((1, 3)), BINS, 4e-12, 0.0, tagged=True)
    took = {}

    def ours():
        path.unlink(missing_ok=True)
        began_s, computed_s = perf_counter(), process_time()
        writer = ScanWriter.create(path, description)
        for step, bins in enumerate(photons, start=1):
            writer.append_photons(bins, of_channel, DWELL_S)
            if step % LINE == 0:
                writer.checkpoint()
        took["running"] = process_time() - computed_s
        writer.close("complete")
        took["all"] = perf_counter() - began_s

    def floor():
        began_s = perf_counter()
        with (tmp_path / "floor.h5").open("wb") as file, h5py.File(file, "w") as at_once:
            at_once["photons"] = photons.ravel()
            at_once.flush()
            os.fsync(file.fileno())
        return perf_counter() - began_s

    benchmark.pedantic(ours, rounds=1)
    floor_s = min(floor() for _ in range(3))
    share, ratio = took["running"] / duration_s, took["all"] / floor_s
    print(
        f"\n{rate_hz / 1e3:,.0f} kHz for {duration_s:g} s: {share:.1%} of a core while it runs; "
        f"{took['all']:.2f} s in all, {ratio:.0f} times the floor of {floor_s:.3f} s; "
        f"{path.stat().st_size / photons.size:.2f} bytes a photon"
    )
