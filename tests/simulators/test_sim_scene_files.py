"""Scenes from mesh files: what was written is read, and what cannot be used is refused by name."""

import json
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from simulators.scenes import scene

trimesh = pytest.importorskip("trimesh", reason="reading meshes needs the extra 'meshes'")

CORNERS = np.array([[-0.3, -0.2, 1.0], [0.3, -0.2, 1.0], [0.3, 0.2, 1.2], [-0.3, 0.2, 1.2]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])

number = st.floats(-2, 2, allow_nan=False).map(lambda value: round(value, 4))
triangles = st.lists(st.tuples(*[st.tuples(number, number, number)] * 3), min_size=1, max_size=8)


def by_size(triangles_m):
    """Triangles in an order that does not depend on how a file stores them."""
    return triangles_m[np.lexsort(triangles_m.mean(axis=1).T)]


@pytest.mark.parametrize("ending", ["obj", "ply", "stl"])
def test_a_mesh_is_placed_as_it_is(tmp_path, ending):
    path = tmp_path / f"plate.{ending}"
    trimesh.Trimesh(CORNERS, FACES).export(path)
    built = scene(str(path))
    assert built.name == path.name
    assert by_size(built.triangles_m) == pytest.approx(by_size(CORNERS[FACES]), abs=1e-6)
    depth_m = built.depth_map(np.array([0.1]), np.array([0.05]))
    assert depth_m[0, 0] == pytest.approx(1.125, abs=1e-6)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(triangles)
def test_every_triangle_of_an_obj_file_is_read(tmp_path, drawn):
    """Written here line by line, with quotes of the format: v x y z, f from 1."""
    triangles_m = np.array(drawn, dtype=float)
    lines = [f"v {x} {y} {z}" for x, y, z in triangles_m.reshape(-1, 3)]
    lines += [f"f {3 * n + 1} {3 * n + 2} {3 * n + 3}" for n in range(len(triangles_m))]
    path = tmp_path / "drawn.obj"
    path.write_text("\n".join(lines) + "\n")
    edges = triangles_m[:, 1:] - triangles_m[:, :1]
    flat = not np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).any()
    if flat or triangles_m[..., 2].max() <= 0:
        with pytest.raises(ValueError, match=r"drawn\.obj: all"):
            scene(str(path))
    else:
        assert scene(str(path)).triangles_m == pytest.approx(triangles_m)


def test_objects_in_a_file_are_told_apart(tmp_path):
    path = tmp_path / "two.obj"
    path.write_text("o near\nv 0 0 1\nv 1 0 1\nv 0 1 1\nf 1 2 3\no far\nv 0 0 2\nv 1 0 2\nv 0 1 2\nf 4 5 6\n")
    built = scene(str(path))
    assert len(built.meshes) == 2
    assert len({mesh.name for mesh in built.meshes}) == 2
    assert sorted(mesh.vertices_m[:, 2].max() for mesh in built.meshes) == [1, 2]


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("none.obj", None, "there is no such file"),
        ("empty.obj", "", "empty.obj: "),
        ("points.obj", "v 0 0 1\nv 1 0 1\n", "points.obj: "),
        ("line.obj", "v 0 0 1\nv 1 0 1\nv 2 0 1\nf 1 2 3\n", "all 1 triangles are degenerate"),
        ("behind.obj", "v 0 0 -1\nv 1 0 -1\nv 0 1 -2\nf 1 2 3\n", "behind the relay wall"),
        ("far.obj", "v 0 0 1000\nv 900 0 1000\nv 0 900 1200\nf 1 2 3\n", "scale a file in millimetres"),
        ("nan.obj", "v 0 0 nan\nv 1 0 1\nv 0 1 1\nf 1 2 3\n", "nan.obj: "),
        ("noise.ply", "what is this", "noise.ply: cannot be read as PLY"),
        ("noise.stl", "\x00\x01" * 50, "noise.stl: "),
    ],
)
def test_what_cannot_be_used_is_refused_by_name(tmp_path, name, text, message):
    path = tmp_path / name
    if text is not None:
        path.write_text(text)
    with pytest.raises(ValueError, match=message):
        scene(str(path))


def test_the_rig_scans_a_mesh_with_interreflections(tmp_path):
    trimesh.Trimesh(CORNERS, FACES).export(tmp_path / "plate.obj")
    config = '[simulation]\nscene = "plate.obj"\nbounces = 5\nroughness = 0.4\n'
    (tmp_path / "rig.toml").write_text(config)

    def rig(*arguments):
        command = [sys.executable, "-m", "rig", "scan", "--config", "rig.toml", "--grid", "3x2", "--spacing"]
        return subprocess.run(
            [*command, "30cm", "--exposure", "1ms", *arguments],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=120,
        )

    done = rig("--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["photons"] > 500
    refused = rig("--scene", "missing.obj")
    assert refused.returncode == 2
    assert "missing.obj: there is no such file" in refused.stderr
