"""How an exhaustive capture is imaged by one worker of a cluster and by two: time, memory, traffic.

    python tests/benchmarks/exhaustive_workers.py FOLDER [--lasers 16x16] [--pixels 64x64] [--limit-gb 2]

Each worker has one thread, one core of its own and a limit of memory. The capture is rendered once, and stays
in the folder. Times are by the clock, from a cluster that stands to a picture, so the machine is to be quiet.
Traffic is what the loopback interface carried meanwhile: run this where nothing else uses it. At last a
worker is killed in mid run, by the id of its process, and the image compared.
"""

import argparse
import os
import resource
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import Any

from exhaustive_speed import (
    BINS,
    DEPTH_M,
    MEMORY_BYTES,
    ONE_THREAD,
    WAVELENGTH_M,
    alone,
    crop_error,
    render,
)


def imaged(path: Path, out: Path, workers: int, limit_bytes: int, *, kill: bool = False) -> dict[str, Any]:
    """Image on so many workers; say how long it took, and what it took."""
    from distributed import Client, LocalCluster

    from rig.cluster.imaging import Crew
    from rig.image.drawing import Drawing
    from rig.image.reconstruct import reconstruct
    from rig.image.request import Request

    killed: list[int] = []
    with (
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            memory_limit=limit_bytes,
            dashboard_address=None,
            env=dict.fromkeys(ONE_THREAD, "1"),
        ) as cluster,
        Client(cluster) as client,
    ):
        cores = count()
        for address in client.run(os.getpid):
            client.run(_pinned, next(cores), workers=[address])

        def progress(fraction: float) -> None:
            if kill and not killed:
                killed.append(min(client.run(os.getpid).values()))
                os.kill(killed[0], signal.SIGKILL)

        sent, began_s = _loopback_bytes(), time.monotonic()
        result = reconstruct(
            path,
            Request(wavelength_m=WAVELENGTH_M, depth_m=DEPTH_M),
            out,
            Drawing(out.with_suffix(".png")),
            progress,
            elsewhere=Crew(client),
        )
        clock_s, sent = time.monotonic() - began_s, _loopback_bytes() - sent
        used = client.run(_used)
    return {
        "intensity": result.volume.intensity,
        "clock_s": clock_s,
        "worker_cpu_s": [round(cpu_s, 1) for cpu_s, _ in used.values()],
        "worker_peak_bytes": max(peak for _, peak in used.values()),
        "sent_bytes": sent,
        "killed": killed,
    }


def crop(path: str, volume: str) -> dict[str, Any]:
    """Hold the workers' image against one process, and a crop of that against the sum over all pairs."""
    import numpy as np

    from recon.by_lasers import image
    from recon.defaults import voxels
    from recon.wave import VirtualPulse
    from rig.files.scan import ScanFile
    from rig.files.volume import read_volume

    pulse, intensity = VirtualPulse(WAVELENGTH_M), read_volume(volume).intensity
    with ScanFile(path) as scan:
        whole = scan.exhaustive()
        assert whole is not None
        grid = voxels(whole.outline(), pulse, depth_m=DEPTH_M)
        found = image(whole, pulse, grid, memory_bytes=MEMORY_BYTES // 2)
        here = np.abs(found.field) ** 2
        pairs, frequencies = (
            len(whole.pixel_m) * whole.lasers,
            sum(len(one.band) for one in found.depth_blocks),
        )
        return {
            "voxels": grid.shape,
            "workers beside one process": float(np.abs(intensity - here).max() / here.max()),
            "crop beside the direct sum": crop_error(whole, found),
            "bytes of all counts": 4 * BINS * pairs,
            "bytes of all spectra": 8 * frequencies * pairs,
        }


def _pinned(core: int) -> None:
    if hasattr(os, "sched_setaffinity"):
        all_cores = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {all_cores[core % len(all_cores)]})


def _used() -> tuple[float, int]:
    spent = resource.getrusage(resource.RUSAGE_SELF)
    return spent.ru_utime + spent.ru_stime, 1024 * spent.ru_maxrss


def _loopback_bytes() -> int:
    """Return what the loopback interface has carried since the start of the machine; 0 where Linux is not."""
    with suppress(OSError):
        for line in Path("/proc/net/dev").read_text().splitlines():
            name, _, numbers = line.partition(":")
            if name.strip() == "lo":
                return int(numbers.split()[0])
    return 0


def main(arguments: argparse.Namespace) -> None:
    """Print the table."""
    limit_bytes = int(arguments.limit_gb * 1e9)
    arguments.folder.mkdir(parents=True, exist_ok=True)
    rendered = alone(render, arguments.folder, "patches", arguments.lasers, arguments.pixels)
    path = Path(rendered["file"])
    cases: dict[str, Callable[[], dict[str, Any]]] = {
        "1": lambda: imaged(path, arguments.folder / "on-1.h5", 1, limit_bytes),
        "2": lambda: imaged(path, arguments.folder / "on-2.h5", 2, limit_bytes),
        "2, one killed": lambda: imaged(path, arguments.folder / "killed.h5", 2, limit_bytes, kill=True),
    }
    print(
        "| workers | clock [s] | times as quick | efficiency | processor [s] | peak of a worker [MB] | "
        "sent [MB] | greatest difference |"
    )
    first: dict[str, Any] = {}
    for name, work in cases.items():
        found = work()
        first = first or found
        quicker = first["clock_s"] / found["clock_s"]
        far = abs(found["intensity"] - first["intensity"]).max() / first["intensity"].max()
        print(
            f"| {name} | {found['clock_s']:.1f} | {quicker:.2f} | {quicker / int(name[0]):.2f} | "
            f"{found['worker_cpu_s']} | {found['worker_peak_bytes'] / 1e6:.0f} | "
            f"{found['sent_bytes'] / 1e6:.0f} | {far:.1e} |",
            flush=True,
        )
    print(alone(crop, str(path), str(arguments.folder / "on-2.h5")))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--lasers", default="16x16")
    parser.add_argument("--pixels", default="64x64")
    parser.add_argument("--limit-gb", type=float, default=2.0)
    os.environ |= dict.fromkeys(ONE_THREAD, "1")
    main(parser.parse_args())
