"""Attack the readers: ``python -m attacks.files --parser scan --number 100000``, with ``tests`` on the path.

Each input follows from its seed. It is read by a worker process with limits; a reader may read it, or refuse
it with an error of this program. Anything else is told, with the seed: another exception, a death, more than
ten seconds, or more than 1 GB.
"""

import argparse
import multiprocessing
import shutil
import tempfile
import time
import traceback
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
import scipy.io

from attacks import layouts
from attacks.mutants import by_bytes, by_structure
from attacks.shared import Shared
from recon.errors import ReconError
from rig.errors import RigError

#: Seconds and bytes that one input may cost; a busy machine is given twice the time.
DEADLINE_S, MEMORY_BYTES = 20.0, 2**30
#: Files that one process reads from the command line: what a library lost in one must not gather.
AT_MOST = 5000
#: Where files cost no disk, if there is such a place.
QUICK = next((one for one in ("/dev/shm",) if Path(one).is_dir()), None)


def tagged_scan_file(folder: Path) -> Path:
    return scan_file(folder, tagged=True)


def scan_file(folder: Path, *, tagged: bool = False) -> Path:
    from rig.files import ScanDescription, ScanWriter
    from rig.model.config import built_in
    from rig.model.plan import ScanPlan
    from rig.model.state import RigState

    config = built_in()
    plan = ScanPlan.grid(config, columns=8, rows=5, skip_m=0.0)
    laser_m = np.random.default_rng(5).normal(size=(40, 3))
    described = ScanDescription(
        laser_m, np.zeros((1, 3)), 400, 16e-12, 0.0, plan=plan, state=RigState(config), tagged=tagged
    )
    with ScanWriter.create(folder / "good.h5", described) as writer:
        for step in range(40):
            writer.append(np.random.default_rng([7, step]).poisson(0.5, 400).astype("u4"), 0.01)
        writer.close("interrupted", "stopped")
    return folder / "good.h5"


def volume_file(folder: Path) -> Path:
    from rig.files import Volume, write_volume

    axes = np.linspace(-0.3, 0.3, 9), np.linspace(-0.2, 0.2, 7), np.linspace(0.5, 1.0, 6)
    values = np.random.default_rng(5).random((6, 7, 9), np.float32)
    write_volume(
        folder / "good.h5",
        Volume(values, *axes, depth_m=np.full((7, 9), 0.8, np.float32), parameters={"wavelength_m": 0.04}),
    )
    return folder / "good.h5"


def packed_matlab_file(folder: Path) -> Path:
    return matlab_file(folder, packed=True)


def matlab_file(folder: Path, *, packed: bool = False) -> Path:
    """Write a file of MATLAB v5; the check sum of a packed one refuses nearly all that is changed in it."""
    cube = np.random.default_rng(3).poisson(3.0, (6, 6, 40)).astype(float)
    scipy.io.savemat(folder / "good.mat", {"sig": cube, "width": 0.3}, do_compression=packed)
    return folder / "good.mat"


def tal_file(folder: Path) -> Path:
    grid_m = (
        np.stack(np.meshgrid(np.linspace(-0.3, 0.3, 4), np.linspace(-0.2, 0.2, 3), [0.0])).reshape(3, -1).T
    )
    with h5py.File(folder / "good.h5", "w") as file:
        file["H"] = np.random.default_rng(8).random((20, 12), np.float32)
        file["H_format"] = [3]
        file["sensor_xyz"], file["laser_xyz"] = [0.1, 0.2, 1.5], [-0.3, 0.1, 1.2]
        file["sensor_grid_xyz"], file["laser_grid_xyz"] = grid_m, [[0.05, -0.1, 0.0]]
        file["sensor_grid_normals"], file["laser_grid_normals"] = h5py.Empty(float), h5py.Empty(float)
        file["delta_t"], file["t_start"], file["t_accounts_first_and_last_bounces"] = 0.003, 1.5, False
    return folder / "good.h5"


def records_file(folder: Path) -> Path:
    from rig.exporters import export

    export(scan_file(folder), folder / "good.ptu")
    return folder / "good.ptu"


def older_records_file(folder: Path) -> Path:
    from support.older_picoquant_files import hydraharp, in_t3
    from support.picoquant_files import scan_events

    (folder / "good.ht3").write_bytes(hydraharp(b"2.0", 3, records=in_t3(scan_events(3, 40), several=True)))
    return folder / "good.ht3"


def older_curves_file(folder: Path) -> Path:
    from support.older_picoquant_files import thd

    (folder / "good.thd").write_bytes(thd(np.random.default_rng(3).poisson(3.0, (3, 40))))
    return folder / "good.thd"


def read_scan(path: Path) -> None:
    from rig.acquire.acquisition import interrupted
    from rig.files import ScanFile
    from rig.show.statistics import tally

    with ScanFile(path) as scan:
        str(scan)
        _ = scan.state, scan.devices, scan.mirror_rad, scan.passes()
        tally(scan.capture(), 0.0)
    interrupted(path)


def read_volume(path: Path) -> None:
    from rig.files import read_volume
    from rig.image.measures import measure

    measure(read_volume(path), None, None)


def import_any(path: Path) -> None:
    from rig.importers import import_scan

    import_scan(path, path.with_suffix(".imported"), bin_width_s=32e-12, wall_size_m=0.5, time_origin="wall")


def kept_records_file(folder: Path) -> Path:
    """Two sweeps of 4 points each; the second begins with the third point."""
    from rig.files import ScanDescription
    from rig.files.records import PtuRecorder
    from support.picoquant_files import records_of

    recorder = PtuRecorder(
        folder / "good.ptu", ScanDescription(np.eye(4, 3), np.zeros((1, 3)), 400, 16e-12, 0.0, tagged=True)
    )
    for first in (0, 2):
        marks = [(1000 * tick, "marker", mask) for tick, mask in enumerate([4, 3, 1, 3, 1, 2])]
        photons = [(137 * number, "photon", 7 * number, 0) for number in range(40)]
        recorder.add(records_of(sorted(marks + photons, key=lambda event: event[0])), first)
    recorder.close(4)
    return folder / "good.ptu"


def import_as_it_is(path: Path) -> None:
    from rig.importers import import_scan

    import_scan(path, path.with_suffix(".imported"))


def import_older(path: Path) -> None:
    from rig.importers import import_scan

    plan = {"grid": (3, 1), "spacing_m": 0.1, "detector": "confocal"}
    if path.suffix == ".ht3":
        plan["point_marker"] = 1
    import_scan(path, path.with_suffix(".imported"), **plan)


#: By name: what makes a good file, and what reads any.
PARSERS = {
    "scan": (scan_file, read_scan),
    "scan-tagged": (tagged_scan_file, read_scan),
    "volume": (volume_file, read_volume),
    "import": (matlab_file, import_any),
    "import-packed": (packed_matlab_file, import_any),
    "import-tal": (tal_file, import_as_it_is),
    "import-scan": (scan_file, import_any),
    "import-records": (records_file, import_as_it_is),
    "import-kept-records": (kept_records_file, import_as_it_is),
    "import-older-records": (older_records_file, import_older),
    "import-older-curves": (older_curves_file, import_older),
    **layouts.parsers(),
}


@dataclass(frozen=True)
class Fault:
    """What a reader may not do."""

    seed: int
    what: str


def write_input(good: Path, folder: Path, seed: int) -> Path:
    """Write the file of a seed, and those of MATLAB beside it; return it.

    Even seeds mutate one of them by bytes, odd ones by structure where it is HDF5.
    """
    files = [good, *sorted(path for path in good.parent.glob("*.mat") if path != good)]
    spoiled = files[int(np.random.default_rng([seed, 3]).integers(len(files)))]
    for path in files:
        shutil.copy(path, folder)
    target = folder / spoiled.name
    if seed % 2 and h5py.is_hdf5(target):
        with suppress(OSError, RuntimeError, ValueError, KeyError, TypeError, MemoryError):
            by_structure(target, seed)  # what the library does not write, it need not read
    else:
        target.write_bytes(by_bytes(target.read_bytes(), seed))
    return folder / good.name


def _outcome(read, path: Path) -> str:
    given = set(path.parent.iterdir())
    try:
        read(path)
    except (RigError, ReconError) as error:
        said, left = str(error), set(path.parent.iterdir()) - given
        if left:
            return f"left behind: {', '.join(one.suffix for one in left)}"
        return "refused" if path.name in said or "\n" not in said else f"said: {said}"
    except BaseException as error:
        where = traceback.extract_tb(error.__traceback__)
        ours = [one for one in where if "/rig/" in one.filename or "/recon/" in one.filename] or list(where)
        return f"{type(error).__name__}: {str(error)[:80]} at {ours[-1].filename}:{ours[-1].lineno}"
    return "read"


def _work(parser: str, folder: Path, seeds: range, pipe, closed) -> None:
    import resource

    closed.close()
    pages = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    make, read = PARSERS[parser]
    with np.errstate(all="ignore"):
        good = make(folder)
        shared = Shared.install(pipe)
        most = pages + MEMORY_BYTES + 2**30  # address space: libraries that are loaded later take some
        resource.setrlimit(resource.RLIMIT_AS, (most, resource.RLIM_INFINITY))
        for seed in seeds:
            pipe.send((seed, ""))
            pipe.send((seed, _read_one(read, good, folder / str(seed), seed)))
        shared.end()
    pipe.send((-1, "end"))


def _read_one(read, good: Path, folder: Path, seed: int) -> str:
    """Write the file of a seed into a folder of its own, and read it."""
    folder.mkdir()
    outcome = _outcome(read, write_input(good, folder, seed))
    shutil.rmtree(folder)
    return outcome


def _comes(pipe, deadline_s: float, look_s: float = 0.5) -> bool:
    """Return whether something comes in time; where this process stood still, that counts as one look."""
    return any(pipe.poll(look_s) for _ in range(int(deadline_s / look_s)))


def attack(
    parser: str, number: int, first: int = 0, told: Counter | None = None, deadline_s: float = DEADLINE_S
) -> list[Fault]:
    """Read the files of so many seeds; return the faults."""
    faults: list[Fault] = []
    late: set[int] = set()  # read once more: a computer that stood still is no fault of the reader
    told = Counter() if told is None else told
    context = multiprocessing.get_context("fork")
    seed, stop = first, first + number
    while seed < stop:
        folder = tempfile.TemporaryDirectory(dir=QUICK)  # here, as a worker may be killed
        ours, theirs = context.Pipe(duplex=False)
        worker = context.Process(
            target=_work, args=(parser, Path(folder.name), range(seed, stop), theirs, ours)
        )
        worker.start()
        theirs.close()
        now, outcome = seed, ""
        seed = stop
        try:
            while _comes(ours, deadline_s):
                now, outcome = ours.recv()
                if outcome == "end":
                    break
                if outcome:
                    told[outcome if outcome in {"read", "refused"} else "fault"] += 1
                    if outcome not in {"read", "refused"}:
                        faults.append(Fault(now, outcome))
            else:
                seed = now + 1 if outcome else now
                if seed in late:
                    faults.append(Fault(seed, f"longer than {deadline_s} s"))
                seed, _ = seed + (seed in late), late.add(seed)
        except EOFError:
            worker.join()
            faults.append(Fault(now, f"the process died: {worker.exitcode}"))
            seed = now + 1
        worker.kill()
        worker.join()
        folder.cleanup()
    return faults


def main() -> None:
    """Run the attack that the command line asks for."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--parser", choices=list(PARSERS), required=True)
    asked.add_argument("--number", type=int, default=1000)
    asked.add_argument("--first", type=int, default=0)
    given = asked.parse_args()
    told: Counter = Counter()
    found: list[Fault] = []
    began_s = time.monotonic()
    stop = given.first + given.number
    for first in range(given.first, stop, AT_MOST):
        new = attack(given.parser, min(AT_MOST, stop - first), first, told)
        found += new
        for what, seeds in _alike(new).items():
            print(f"{len(seeds):6}  {what}  seeds {seeds[:5]}")
        took_s = time.monotonic() - began_s
        print(f"{given.parser}: {dict(told)}, {len(found)} faults, {took_s:.0f} s", flush=True)
    raise SystemExit(bool(found))


def _alike(faults: list[Fault]) -> dict[str, list[int]]:
    found: dict[str, list[int]] = {}
    for fault in faults:
        found.setdefault(fault.what, []).append(fault.seed)
    return found


if __name__ == "__main__":
    main()
