"""Attacks on everything that reads text: options, configurations, plans, calibrations, meshes.

PYTHONPATH=tests python -m attacks.texts --number 100000 [NAME...]
"""

import contextlib
import json
import tempfile
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from attacks.running import Attack, main
from attacks.spoiled import NUMBERS, WORDS, spoiled_bytes, spoiled_json, spoiled_text, spoiled_tree
from drivers.errors import DeviceError
from recon.errors import ReconError
from rig.errors import RigError
from rig.model import config as configuration
from rig.model.quantities import KINDS

_CONFIGS = Path(__file__).parents[2] / "configs"
_UNITS = ["s", "ms", "ps", "m", "cm", "mm", "nm", "Hz", "MHz", "deg", "rad", "V", "mV", "GB", "byte"]
_UNITS += [
    "dB",
    "dBm",
    "degC",
    "mdegC",
    "Np",
    "kg",
    "m/s",
    "m**999",
    "%",
    "pH",
    "bel",
    "cents",
    "µm",
    "octave",
]


@cache
def folder() -> Path:
    """Return a folder for the files of this run."""
    return Path(tempfile.mkdtemp(prefix="attacks-"))


def written(place: Path, text: str) -> Path:
    """Return a file with a text in it, which may be none that UTF-8 knows."""
    place.parent.mkdir(exist_ok=True)
    place.write_bytes(text.encode("utf-8", "surrogatepass"))
    return place


# quantities and ranges


def quantity(random: Random) -> tuple[str, str]:
    """Return a text, nearly a quantity, and the kind that it is to be."""
    text = (
        random.choice([*NUMBERS, "10", "4.5", "1e-3"]) + random.choice(["", "", " "]) + random.choice(_UNITS)
    )
    if random.random() < 0.5:
        text = spoiled_text(random, text, 2)
    return text, random.choice(sorted(KINDS))


def read_quantity(given: tuple[str, str]) -> None:
    """Read it, and write it back."""
    from rig.model.quantities import parse, show, show_duration, show_length

    value = parse(*given)
    show(value, "s")
    show_length(value)
    show_duration(value)


def grid_option(random: Random) -> tuple[str, str, str]:
    """Return values of --grid, --spacing and --exposure."""
    grid = f"{random.choice([*NUMBERS, '180', '60'])}x{random.choice([*NUMBERS, '130', '2'])}"
    grid = spoiled_text(random, "180x130", 2) if random.random() < 0.3 else grid
    return grid, quantity(random)[0], quantity(random)[0]


def read_grid(given: tuple[str, str, str]) -> None:
    """Make a plan of it, and look at what a dry run looks at."""
    from rig.acquire.preflight import check
    from rig.model.asked import columns_and_rows
    from rig.model.plan import ScanPlan
    from rig.model.quantities import parse
    from rig.model.state import RigState

    columns, rows = columns_and_rows(given[0])
    state = RigState(configuration.built_in())
    spacing_m, exposure_s = (
        _or_usual(text, kind) for text, kind in zip(given[1:], ("length", "time"), strict=True)
    )
    plan = ScanPlan.grid(state.config, columns=columns, rows=rows, spacing_m=spacing_m, exposure_s=exposure_s)
    found = check(plan, state, folder())
    assert found.bins > 0
    assert parse("1s", "time") == 1


def _or_usual(text: str, kind: str) -> float | None:
    from rig.model.quantities import parse

    try:
        return parse(text, kind)
    except RigError:
        return None


def voxel_options(random: Random) -> tuple[str, str, str, str, str, float]:
    """Return values of --depth, --width, --height, --voxel, --wavelength and --cycles."""
    length = lambda: quantity(random)[0] if random.random() < 0.4 else random.choice(_LENGTHS)  # noqa: E731
    depth = ":".join(length() for _ in range(3))
    depth = spoiled_text(random, "0.5m:3m:2cm", 3) if random.random() < 0.3 else depth
    return (
        depth,
        length(),
        length(),
        length(),
        length(),
        random.choice([2.0, 6.0, 1e9, float("nan"), 1e308, -1.0]),
    )


_LENGTHS = [
    "1m",
    "0.5m",
    "2cm",
    "1nm",
    "0.01mm",
    "1e400m",
    "1e300m",
    "1e-300m",
    "3m",
    "10km",
    "0m",
    "-1m",
    "5cm",
]


def read_voxels(given: tuple[str, str, str, str, str, float]) -> None:
    """Choose voxels for a small capture."""
    from recon import defaults
    from recon.wave import VirtualPulse
    from rig.model.quantities import depths

    near_far_step = depths(given[0])
    width_m, height_m, voxel_m, wavelength_m = (_or_usual(text, "length") for text in given[1:5])
    pulse = VirtualPulse(0.04 if wavelength_m is None else wavelength_m, given[5])
    grid = defaults.voxels(
        small_capture(), pulse, width_m=width_m, height_m=height_m, voxel_m=voxel_m, depth_m=near_far_step
    )
    grid.check_in_front()
    defaults.warnings(small_capture(), pulse, grid, 65e-12)


@cache
def small_capture() -> Any:
    """Return a capture of 6 positions."""
    from recon.capture import ArrayHistograms, Capture

    x, y = np.meshgrid(np.arange(3) * 0.1, np.arange(2) * 0.1)
    laser_m = np.stack([x.ravel(), y.ravel(), np.zeros(6)], axis=1)
    return Capture(ArrayHistograms(np.ones((6, 2000))), 16e-12, np.zeros(1), laser_m, np.zeros((1, 3)))


# configurations and plans


@cache
def _tomls() -> tuple[str, ...]:
    return tuple(path.read_text() for path in sorted(_CONFIGS.glob("*.toml")))


def toml(random: Random) -> str:
    """Return a spoiled configuration file."""
    return _spoiled_toml(random, random.choice(_tomls()))


def _spoiled_toml(random: Random, text: str) -> str:
    if random.random() < 0.7:  # whole values, so that what comes behind the syntax is reached
        lines = text.splitlines()
        keys = [number for number, line in enumerate(lines) if "=" in line and not line.startswith("#")]
        for at in random.sample(keys, random.randint(1, 3)):
            key = (
                lines[at].split("=")[0]
                if random.random() < 0.9
                else random.choice(["a.b.c", '""', "kind", "x"])
            )
            lines[at] = f"{key} = {_toml_value(random)}"
        return "\n".join(lines)
    if random.random() < 0.05:
        deep = random.choice([100, 2_000, 100_000])
        return random.choice(
            ["a = " + "[" * deep, "a = " + "{b = " * deep, "a" + ".a" * deep + " = 1", "[" + "a." * deep]
        )
    return spoiled_text(random, text)


def _toml_value(random: Random) -> str:
    plain = [
        *NUMBERS[:20],
        "true",
        "[]",
        "{}",
        "[[]]",
        "1979-05-27",
        "'x'",
        "[1, 2, 3]",
        "['1m', '1m']",
        "{kind = 1}",
    ]
    kind = random.random()
    if kind < 0.4:
        return random.choice(plain)
    if kind < 0.5:
        return "[" * 300 + "]" * 300
    return json.dumps(quantity(random)[0] if kind < 0.9 else random.choice(WORDS))


def read_toml(text: str) -> None:
    """Load it, and resolve what a dry run does."""
    from rig.model.plan import ScanPlan
    from rig.model.state import RigState

    read = configuration.load(written(folder() / "rig.toml", text))
    state = RigState(read)
    plan = ScanPlan.grid(read)
    assert len(plan) >= 0
    assert state.channels
    read.differences(configuration.built_in())
    assert state.sync_period_s > 0


@cache
def _recorded_config() -> Any:
    return json.loads(configuration.built_in().model_dump_json())


def read_recorded(text: str) -> None:
    """Read the configuration that a scan file holds."""
    read = configuration.recorded(text)
    read.differences(configuration.built_in())


def plan_text(random: Random) -> str:
    """Return the spoiled plan of a scan file, of this or an older program."""
    return spoiled_json(random, random.choice(_plans()))


@cache
def _plans() -> tuple[Any, ...]:
    from rig.model.plan import Pass, ScanPlan, Spots

    grid = ScanPlan.grid(configuration.built_in(), columns=6, rows=4)
    spots = ScanPlan(
        passes=(Pass(positions=Spots(spots=((0, 0, 0), (0.1, 0, 0))), exposure_s=0.1, frames=2),)
    )
    older = {
        "columns": 6,
        "rows": 4,
        "spacing_m": 0.1,
        "exposure_s": 0.01,
        "skip_m": 0.1,
        "detector_spot_m": [0, 0, 0],
    }
    return json.loads(grid.model_dump_json()), json.loads(spots.model_dump_json()), older


def read_plan(text: str) -> None:
    """Read it, and walk through it."""
    from rig.model.plan import ScanPlan

    plan = ScanPlan.from_json(text, "scan.h5")
    if len(plan):
        next(plan.steps(len(plan) - 1))
    plan.duration_s(configuration.built_in())
    assert np.isfinite(plan.exposure_total_s) or plan.exposure_total_s > 1e300


# calibrations


def calibration_text(random: Random) -> str:
    """Return a spoiled calibration whose digest was made anew, so that it is read on."""
    from rig.model.calibrations.base import digest

    good = random.choice(_calibrations())
    if random.random() < 0.15:
        return spoiled_json(random, good)
    content = spoiled_tree(random, good)
    if isinstance(content, dict):
        content.pop("digest", None)
        try:
            content["digest"] = digest(content)
        except (TypeError, ValueError):
            content["digest"] = "0"
    return json.dumps(content)


@cache
def _calibrations() -> tuple[Any, ...]:
    """Return one calibration of each kind, every number small and positive."""
    from rig.model.calibrations.kinds import KINDS

    common = {"valid_days": 30, "rig_name": "simulated rig", "devices": {"spad": "a"}, "measured_from": {}}
    found = []
    for kind in KINDS.values():
        own = {
            name: _EXAMPLES[str(field.annotation).replace("typing.", "")]
            for name, field in kind.model_fields.items()
            if field.is_required() and name not in common
        }
        found.append(json.loads(kind.model_validate({**common, "simulated": True, **own}).document()))
    return tuple(found)


#: A value for each type that a calibration's fields have.
_EXAMPLES: dict[str, Any] = {
    "<class 'float'>": 1e-3,
    "float | None": 1e-3,
    "<class 'int'>": 5,
    "tuple[float, float, float]": (0.1, 0.0, 2.5),
    "tuple[float, float]": (1.0, 1.0),
    "list[float]": [1e-9, 2e-9],
    "list[float | None]": [1.0, 1.01],
    "list[bool]": [True, False],
    "list[tuple[float, float]]": [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)],
    "Literal['cameras', 'flight']": "cameras",
    "Literal[1, 2]": 1,
}


def read_calibration(text: str) -> None:
    """Read it from a file, and do with it what every command does."""
    from rig.model.calibrations.chosen import choose
    from rig.model.calibrations.headlines import headline
    from rig.model.calibrations.kinds import KINDS
    from rig.model.calibrations.store import CalibrationStore, doubts

    kind = next((name for name in KINDS if f'"kind": "{name}"' in text[:2000]), "dark")
    path = written(folder() / "calibrations" / f"{kind}-20260101T000000Z.json", text)
    place = path.parent
    try:
        stored = CalibrationStore(place).newest(kind)
        if stored is not None:
            one = stored.calibration
            headline(one)
            doubts(one, datetime(2026, 6, 1, tzinfo=UTC))
            f"{one.expires:%Y-%m-%d} {one.created:%Y}"
            choose(CalibrationStore(place), one.rig_name, one.simulated)
    finally:
        path.unlink()


# meshes


def mesh(random: Random) -> tuple[str, bytes]:
    """Return the ending and the bytes of a spoiled mesh."""
    ending, good = random.choice(_meshes())
    if ending != "stl" and not good.startswith(b"ply\nformat binary") and random.random() < 0.7:
        return ending, spoiled_text(random, good.decode()).encode("utf-8", "surrogatepass")
    return ending, spoiled_bytes(random, good)


@cache
def _meshes() -> tuple[tuple[str, bytes], ...]:
    import trimesh

    box = trimesh.creation.box((0.4, 0.3, 0.2))
    box.apply_translation((0, 0, 1))
    found = [("obj", box.export(file_type="obj")), ("stl", box.export(file_type="stl"))]
    found += [("stl", box.export(file_type="stl_ascii")), ("ply", box.export(file_type="ply"))]
    found += [("ply", box.export(file_type="ply", encoding="ascii"))]
    return tuple((ending, good.encode() if isinstance(good, str) else bytes(good)) for ending, good in found)


def read_mesh(given: tuple[str, bytes]) -> None:
    """Read it as a hidden scene, and as a truth."""
    from rig.bench.simulated import hidden_scene
    from rig.image.truth import true_depth
    from rig.model.config import built_in_with

    path = folder() / f"mesh.{given[0]}"
    path.write_bytes(given[1])
    axis_m = np.linspace(-0.2, 0.2, 5)
    with contextlib.suppress(RigError):
        hidden_scene(built_in_with({"simulation": {"scene": str(path)}})).depth_map(axis_m, axis_m)
    true_depth(str(path), axis_m, axis_m)


# lists of jobs, what came of them, and other lists that programs and people write

JOBS = """[[job]]
scans = ["a.h5", "b*.h5"]
wavelength = ["4cm", "6cm"]
cycles = 2
depth = "0.5m:2m:2cm"
even-bins = true

[[job]]
scans = "c.h5"
solver = "rsd"
voxel = ["1cm", "2cm", "4cm"]
"""


def jobs_text(random: Random) -> str:
    """Return a spoiled list of jobs; some ask for more images than a disk can hold."""
    if random.random() < 0.05:
        many = json.dumps(["4cm"] * random.choice([100, 1000, 10_000]))
        keys = ("wavelength", "depth", "voxel", "width", "height")
        return JOBS + "\n".join(f"{key} = {many}" for key in keys[: random.randint(1, 5)])
    return _spoiled_toml(random, JOBS)


def read_list_of_jobs(text: str) -> None:
    """Read it, where some of its scans are."""
    from rig.cluster.jobs import read_jobs

    path = written(folder() / "jobs" / "jobs.toml", text)
    for name in ("a.h5", "b1.h5", "b2.h5", "c.h5"):
        (path.parent / name).touch()
    for job in read_jobs(path)[:100]:
        job.files(path.parent)
        assert job.key


#: A line of a batch's record, of an image that is done.
DONE = {
    "name": "a", "key": "k", "status": "done", "scan": "a.h5", "settings": {"cycles": 2}, "took_s": 1.5,
    "found": {"signal": True}, "sizes": [1, 2],
}  # fmt: skip


def record_text(random: Random) -> str:
    """Return a spoiled record of a batch."""
    lines = [spoiled_json(random, random.choice([DONE, {**DONE, "name": "c"}])) for _ in range(3)]
    return spoiled_text(random, "\n".join(lines)) if random.random() < 0.5 else "\n".join(lines)


def read_record(text: str) -> None:
    """Read it, and ask it for each image of a list."""
    from rig.cluster.batch import RECORD, Record
    from rig.cluster.jobs import Job
    from rig.image.request import Request

    record = Record(written(folder() / "record" / RECORD, text).parent)
    for name in ("a", "c"):
        record.kept(Job(name, Path("a.h5"), {}, Request()))


def read_scheduler(text: str) -> None:
    """Read it as the file in which a scheduler of workers wrote its address."""
    from rig.cluster.joined import scheduler_of

    scheduler_of(str(written(folder() / "scheduler.json", text)))


SCHEDULER = {"type": "Scheduler", "address": "tcp://10.0.0.1:8786", "workers": {}, "started": 1.5e9}


def read_wall_marks(text: str) -> None:
    """Read it as the marks to which a person steered the beam."""
    from rig.calibrate.galvo.flight import read_marks

    read_marks(written(folder() / "marks.json", text))


MARKS = {
    "format": "rig-wall-marks",
    "version": 1,
    "galvo": "Optotune 1",
    "marks": [{"mark_m": [0.1 * n, -0.2], "mirror_rad": [0.01 * n, 0.02]} for n in range(4)],
}


_OURS = (RigError, ReconError, DeviceError)
ATTACKS = (
    Attack("quantity", quantity, read_quantity, _OURS),
    Attack("grid", grid_option, read_grid, _OURS),
    Attack("voxels", voxel_options, read_voxels, _OURS),
    Attack("toml", toml, read_toml, _OURS),
    Attack(
        "recorded configuration",
        lambda random: spoiled_json(random, _recorded_config()),
        read_recorded,
        _OURS,
    ),
    Attack("plan", plan_text, read_plan, _OURS),
    Attack("calibration", calibration_text, read_calibration, _OURS),
    Attack("mesh", mesh, read_mesh, _OURS),
    Attack("jobs", jobs_text, read_list_of_jobs, _OURS),
    Attack("record of a batch", record_text, read_record, _OURS),
    Attack("scheduler", lambda random: spoiled_json(random, SCHEDULER), read_scheduler, _OURS),
    Attack("marks", lambda random: spoiled_json(random, MARKS), read_wall_marks, _OURS),
)

if __name__ == "__main__":
    main(ATTACKS)
