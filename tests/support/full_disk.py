"""Write results where no file may grow, as on a full disk: ``python -m support.full_disk FOLDER``.

It prints, as JSON, what came of each kind of result at each size. It is a program of its own, since a library
that cannot close a file may crash.
"""

import json
import resource
import sys
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from attacks.files import scan_file, volume_file
from rig.atomic import appearing, refusals_told
from rig.calibrate.galvo.flight import Mark, WallMarks
from rig.cluster.batch import Outcome, Record
from rig.errors import RigError
from rig.exporters import export
from rig.files import read_volume, write_volume
from rig.files.fresh import FreshFile
from rig.files.volume import Volume, volume_by_planes
from rig.importers import import_scan

SIZES = 16


def film(path: Path, volume: Volume) -> None:
    moments, front = np.arange(5.0), np.zeros((5, *volume.intensity.shape[1:]), np.float32)
    begun = Volume(front, volume.x_m, volume.y_m, volume.z_m, t_s=moments)
    with volume_by_planes(path, begun) as put:
        for plane in range(len(volume.z_m)):
            put(np.s_[:, plane], np.random.default_rng(plane).random(front.shape, np.float32))


def grown(path: Path) -> None:
    """Write data sets that grow, whose handles are let go between."""
    with refusals_told(path), appearing(path) as partial, FreshFile(partial) as file:
        for number in range(20):
            file.create_dataset(f"{number}", (0, 50), "f4", maxshape=(None, 50), chunks=(4, 50))
            file[f"{number}"].resize(8, axis=0)
            file[f"{number}"][:] = np.random.default_rng(number).random((8, 50))


def recorded(path: Path) -> None:
    job = SimpleNamespace(name="a", key="k", scan=path, settings={"x": "y" * 3000}, files=lambda _: [])
    Record(path.parent).add(job, "done", Outcome("a", "done"))


@contextmanager
def no_file_beyond(nbytes: int):
    usual = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (nbytes, usual[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)


def outcomes(folder: Path, name: str, write) -> list[tuple[str, list[str]]]:
    """Return what was said, and what was left, at each of sizes from none to one that is enough."""
    found = []
    whole = folder / "whole" / name
    whole.parent.mkdir()
    write(whole)
    for number in range(SIZES + 1):
        path = folder / str(number) / name
        path.parent.mkdir()
        said = ""
        with no_file_beyond(number * whole.stat().st_size // SIZES):
            try:
                write(path)
            except RigError as error:
                said = str(error)
        found.append((said, sorted(one.name for one in path.parent.iterdir())))
    return found


def main(folder: Path) -> None:
    scan, volume_path = scan_file(folder), folder / "v"
    volume_path.mkdir()
    stored = volume_file(volume_path)
    volume, tal = read_volume(stored), folder / "tal.hdf5"
    export(scan, tal)
    kinds = {
        "volume.h5": lambda path: write_volume(path, volume),
        "film.h5": lambda path: film(path, volume),
        "grown.h5": grown,
        "imported.h5": lambda path: import_scan(tal, path),
        "batch.jsonl": recorded,
        "galvo-marks.json": WallMarks(marks=[Mark(mark_m=(0.1, 0.2), mirror_rad=(0.3, 0.4))] * 200).write,
        **{f"scan.{ending}": lambda path: export(scan, path) for ending in ("hdf5", "mat", "ptu")},
        **{f"volume.{ending}": lambda path: export(stored, path) for ending in ("npz", "vti", "html")},
    }
    found = {}
    for name, write in kinds.items():
        place = folder / f"of-{name}"
        place.mkdir()
        found[name] = outcomes(place, name, write)
    print(json.dumps(found))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
