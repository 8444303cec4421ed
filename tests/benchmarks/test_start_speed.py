"""How long the program takes to start, beside the import of its command line library; never asserted.

Run with ``pytest tests/benchmarks/test_start_speed.py -n 0 --benchmark-only -s``.
"""

import os
import subprocess
import sys
from time import perf_counter

import pytest

pytestmark = pytest.mark.benchmark

#: Starts of each; the quickest counts, since a busy computer only ever makes one slower.
STARTS = 5


def start_s(*words):
    """Return the seconds that Python takes with these arguments."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    began_s = perf_counter()
    subprocess.run([sys.executable, *words], env=environment, capture_output=True, check=True)
    return perf_counter() - began_s


@pytest.mark.parametrize("words", ["--help", "recon --help", "version", "scan --preset list", "laser status"])
def test_start(benchmark, words):
    bare_s = min(start_s("-c", "import typer") for _ in range(STARTS))
    benchmark.pedantic(start_s, ("-m", "rig", *words.split()), rounds=STARTS)
    ratio = benchmark.stats["min"] / bare_s
    benchmark.extra_info["ratio to import typer"] = round(ratio, 2)
    print(f"rig {words}: {benchmark.stats['min']:.3f} s, {ratio:.1f} times import typer ({bare_s:.3f} s)")
