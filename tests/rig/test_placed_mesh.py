"""A mesh as the hidden scene: scaled, turned, placed, and the same for scan, resume and truth."""

import json
import os

import numpy as np
import pytest

import rig as rig_program
from rig.bench.placed import looked_at
from rig.errors import ConfigError, RefusedError
from rig.files import ScanFile
from rig.model import asked
from simulators.scenes import Placement, scene

pytest.importorskip("trimesh", reason="reading meshes needs the extra 'mesh'")

#: A plate in millimetres, 400 x 200, its middle at (1000, 0, 0), facing x.
PLATE = "v 1000 -200 -100\nv 1000 200 -100\nv 1000 200 100\nv 1000 -200 100\nf 1 2 3\nf 1 3 4\n"
#: What brings it 1.2 m before the wall, facing it: 20 cm wide, 40 cm high.
PLACED = ("--scale", "0.001", "--rotate", "0deg,90deg,0deg", "--place", "10cm,0cm,1.2m")
SMALL = ("--grid", "6x4", "--spacing", "30cm", "--exposure", "2ms")
SPOTS_M = np.array([[-0.9, -0.6, 0.0], [0.9, 0.6, 0.0]])


@pytest.fixture
def plate(tmp_path):
    path = tmp_path / "plate.obj"
    path.write_text(PLATE)
    return path


def test_a_mesh_is_scaled_then_turned_then_placed(plate):
    built = scene(str(plate), Placement((0.1, 0.0, 1.2), (0.0, np.pi / 2, 0.0), 0.001))
    corners_m = built.triangles_m.reshape(-1, 3)
    # about y by 90 degrees: what was along z is along x, what faced x faces the wall
    assert corners_m.min(axis=0) == pytest.approx([0.0, -0.2, 1.2], abs=1e-12)
    assert corners_m.max(axis=0) == pytest.approx([0.2, 0.2, 1.2], abs=1e-12)


def test_turns_are_about_x_then_y_then_z(tmp_path):
    """A corner at y = 1: about x it comes to z = 1, then about y to x = 1, then about z to y = 1 again."""
    path = tmp_path / "a.obj"
    path.write_text("v 0 1 5\nv 0 -1 5\nv 0.1 0 5\nv -0.1 0 5\nf 1 2 3\nf 1 2 4\n")
    right = np.pi / 2
    placed = scene(str(path), Placement((0, 0, 5), (right, right, right)))
    assert placed.meshes[0].vertices_m[0] == pytest.approx([0, 1, 5], abs=1e-12)
    alone = scene(str(path), Placement((0, 0, 5), (right, 0.0, 0.0)))
    assert alone.meshes[0].vertices_m[0] == pytest.approx([0, 0, 6], abs=1e-12)


def test_scale_alone_keeps_the_origin(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text("v 100 0 900\nv 300 0 1100\nv 100 200 1100\nf 1 2 3\n")
    corners_m = scene(str(path), Placement(scale=0.001)).triangles_m[0]
    assert corners_m == pytest.approx(np.array([[0.1, 0, 0.9], [0.3, 0, 1.1], [0.1, 0.2, 1.1]]), abs=1e-12)


def test_scan_resume_and_truth_agree(rig, plate):
    rig("scan", "--scene", plate, *PLACED, *SMALL, "--out", "whole.h5")
    done = rig("scan", "--scene", plate, *PLACED, *SMALL, "--out", "a.h5", "--until", "time 1ms")
    assert done.code == 0, done.err
    assert (
        "plate.obj: 20 cm x 40 cm x 0 mm, x 0.00 to 0.20 m, y -0.20 to 0.20 m, z 1.20 to 1.20 m" in done.err
    )
    resumed = rig("resume", "a.h5")
    assert resumed.code == 0, resumed.err
    with ScanFile("a.h5") as scan, ScanFile("whole.h5") as whole:
        assert scan.config.simulation.place_m == (0.1, 0.0, 1.2)
        np.testing.assert_array_equal(scan.counts(range(24)), whole.counts(range(24)))
    done = rig("recon", "a.h5", "--wavelength", "60cm", "--depth", "1m:1.4m:5cm")
    assert done.code == 0, done.err
    found = json.loads(rig("measure", "a-volume.h5", "--truth", "a.h5", "--json").out)["depth"]
    assert found["pixels"] > 0
    assert found["median_absolute_m"] < 0.06  # a tenth of the wavelength is what so coarse an image promises
    plate.write_text(PLATE.replace("1000", "1001"))
    changed = rig("measure", "a-volume.h5", "--truth", "a.h5")
    assert changed.code == 2
    assert "plate.obj is not the file that the scan began with" in changed.err


@pytest.mark.parametrize(
    ("place", "error", "told"),
    [
        ("0cm,0cm,-1m", ConfigError, r"all of it is on or behind the relay wall \(z from -1 to -1 m\)"),
        ("0cm,0cm,0cm", ConfigError, r"all of it is on or behind the relay wall \(z from 0 to 0 m\)"),
        ("0cm,0cm,20m", RefusedError, r"plate\.obj would not be measured at all: .* --place 0cm,0cm,"),
        ("50m,0cm,1m", RefusedError, r"the record holds 0\.00 to 8\.99 m"),
    ],
)
def test_what_cannot_be_seen_is_refused(plate, place, error, told):
    asks = asked.placement(place, "0deg,90deg,0deg", 0.001)
    config = asked.configuration(None, None, {"scene": str(plate), **asks})
    with pytest.raises(error, match=told):
        looked_at(config, SPOTS_M, np.zeros((1, 3)), (0.0, 30e-9))


def test_what_is_seen_in_part_is_warned_of(plate):
    def warnings(place):
        simulation = {"scene": str(plate), **asked.placement(place, None, 0.001)}
        hidden = looked_at(
            asked.configuration(None, None, simulation), SPOTS_M, np.zeros((1, 3)), (0.0, 10e-9)
        )
        return " ".join(hidden.warnings)

    assert warnings("0cm,0cm,0.5m") == ""
    assert "begins at z = -10 cm" in warnings("0cm,0cm,0m")
    assert "what is deeper than about 1.50 m is not seen" in warnings("0cm,0cm,1.3m")


def test_wrong_placements_are_named(rig, plate):
    assert "is not three quantities" in rig("scan", "--scene", plate, "--place", "1m").err
    assert "'0' has no unit" in rig("scan", "--scene", plate, "--place", "0,0,1m").err
    built_in = rig("scan", "--place", "0cm,0cm,1m", "--dry-run")
    assert built_in.code == 2
    assert "place, rotate and scale are for a mesh file, but the scene 'letters' is built in" in built_in.err


def test_a_rendering_says_where_the_mesh_is_and_python_places_it_too(rig, plate):
    done = rig("sim", "render", plate, "r.h5", *PLACED, *SMALL[:4], "--bin-width", "32ps", "--bins", "600")
    assert done.code == 0, done.err
    assert "plate.obj: 20 cm x 40 cm x 0 mm" in done.err
    plan = rig_program.plan(scene=str(plate), place=(0.1, 0, 1.2), rotate=(0, np.pi / 2, 0), scale=0.001)
    with ScanFile("r.h5") as scan:
        assert plan.config.simulation.place_m == scan.config.simulation.place_m
        assert plan.config.simulation.rotate_rad == pytest.approx(scan.config.simulation.rotate_rad)
    assert plan.estimate().hidden.words.startswith("plate.obj: 20 cm x 40 cm")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with names are POSIX")
def test_a_mesh_that_never_ends_is_refused_at_once(rig, tmp_path):
    os.mkfifo(tmp_path / "pipe.obj")
    (tmp_path / "endless.stl").symlink_to("/dev/zero")
    for name in ("pipe.obj", "endless.stl"):
        ended = rig("scan", "--dry-run", "--scene", tmp_path / name)
        assert ended.code == 2
        assert f"{tmp_path / name}: is not a file" in ended.err
