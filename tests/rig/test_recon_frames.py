"""``rig recon --each-frame``: a scan of several frames becomes a film of what moved meanwhile."""

import json

import numpy as np
import pytest
from PIL import Image

from rig.errors import UsageError
from rig.files import ScanDescription, ScanFile, ScanWriter, read_volume
from rig.image.truth import true_depth
from rig.model.config import built_in_with
from rig.model.plan import ScanPlan
from rig.model.state import RigState
from support.imaged_points import point_signal

#: Four pixels that fill the gap between lines of the laser.
PIXELS_M = np.array([[0.0, 0.025 * k - 0.0375, 0.0] for k in range(4)])
STATE = RigState(
    built_in_with(
        {
            "channels": [
                {"name": f"pixel {k}", "input": k, "spot": [f"{v}m" for v in spot]}
                for k, spot in enumerate(PIXELS_M.tolist())
            ]
        }
    )
)
PLACES = [np.array([x_m, 0.1, 0.9]) for x_m in (-0.3, -0.1, 0.1, 0.3)]
GRID = {"columns": 24, "rows": 8, "spacing_m": 0.03, "row_spacing_m": 0.1, "skip_m": 0.0}
AROUND = ("--wavelength", "8cm", "--depth", "0.8m:1m:5cm", "--voxel", "5cm", "--json")


def scanned(path, places, measured=None):
    """A scan file in the wall's time, a frame for each place of a hidden point."""
    plan = ScanPlan.grid(STATE.config, **GRID, frames=len(places))
    size = len(plan) // len(places)
    description = ScanDescription(
        plan.spots_m, PIXELS_M[None], 500, 32e-12, 0.0, plan=plan, state=STATE, channels=STATE.channels
    )
    laser_m = np.repeat(plan.spots_m[:size], 4, axis=0)
    rows = [
        row
        for place in places
        for row in point_signal(place, laser_m, np.tile(PIXELS_M, (size, 1)), 500, 32e-12).reshape(
            size, 4, -1
        )
    ]
    with ScanWriter.create(path, description) as writer:
        for row in rows[:measured]:
            writer.append(row.astype("u4"), 0.01)
        writer.close("complete" if measured is None else "interrupted", "as asked")
    return size


@pytest.fixture
def scan(tmp_path):
    scanned(tmp_path / "moving.h5", PLACES)
    return tmp_path / "moving.h5"


def test_a_moving_point_is_filmed_where_it_was(rig, scan, tmp_path):
    done = rig("recon", scan, "--each-frame", "--video", "moving.gif", *AROUND)
    assert done.code == 0, done.err
    told = json.loads(done.out)
    assert told["frames"] == 4
    volume = read_volume(told["volume"])
    assert volume.intensity.shape == (4, 5, len(volume.y_m), len(volume.x_m))
    with ScanFile(scan) as file:
        frame_s = file.plan.duration_s(STATE.config) / 4
    np.testing.assert_allclose(volume.t_s, np.arange(4) * frame_s)
    for frame, place in zip(volume.intensity, PLACES, strict=True):
        k, j, i = np.unravel_index(frame.argmax(), frame.shape)
        found = volume.x_m[i], volume.y_m[j], volume.z_m[k]
        assert found == pytest.approx(place, abs=0.025 + 1e-9)  # half a voxel
    with Image.open(tmp_path / "moving.gif") as film:
        assert (film.n_frames, film.info["duration"]) == (4, 500)  # as fast as it was, but twice a second


def test_only_whole_frames_are_filmed(rig, tmp_path):
    scanned(tmp_path / "part.h5", PLACES, measured=2 * 24 * 8 + 5)
    told = json.loads(rig("recon", "part.h5", "--each-frame", *AROUND).out)
    assert told["frames"] == 2


def test_far_depths_are_averaged(rig, scan):
    fresh = read_volume(json.loads(rig("recon", scan, "--each-frame", *AROUND).out)["volume"])
    many = ("--each-frame", "--fresh-to", "0.3m", "--out", "many.h5")
    averaged = read_volume(json.loads(rig("recon", scan, *many, *AROUND).out)["volume"])
    assert averaged.parameters["fresh_to_m"] == 0.3
    # three frames at 0.9 m and beyond: in the last one the point is seen at its last three places
    front = averaged.intensity[-1, 2:].max(axis=0)
    row = front[np.abs(averaged.y_m - 0.1).argmin()]
    seen = row[[np.abs(averaged.x_m - place[0]).argmin() for place in PLACES]]
    assert (seen[1:] > 10 * seen[0]).all()
    # Each place has a third of the amplitude that it had in its own frame, and two neighbours 20 cm aside,
    # two resolution cells lambda z / d: sidelobes of a tenth each, in or out of phase.
    alone = [float(frame[2:].max()) for frame in fresh.intensity[1:]]
    assert np.sqrt(seen[1:]) == pytest.approx(np.sqrt(alone) / 3, rel=0.25)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--each-frame", "--solver", "lct"), "--each-frame images with the confocal camera"),
        (("--each-frame", "--camera", "photo"), "--each-frame images with the confocal camera"),
        (("--each-frame", "--memory", "1GB"), "--memory would have no effect"),
        (("--fresh-to", "1m"), "--fresh-to would have no effect"),
        (("--each-frame", "--fresh-to", "0m"), "z_0 = 0 m"),
        (("--video", "a.gif"), "or --each-frame"),
    ],
)
def test_what_makes_no_sense_is_refused(rig, scan, options, said):
    done = rig("recon", scan, *options)
    assert done.code == 2
    assert said in done.err


def test_a_scan_of_one_frame_is_no_film(rig, tmp_path):
    scanned(tmp_path / "one.h5", PLACES[:1])
    done = rig("recon", "one.h5", "--each-frame")
    assert done.code == 2
    assert "holds one whole frame" in done.err


def test_the_truth_of_a_moment_is_the_scene_moved():
    x_m, y_m = np.arange(-0.6, 0.6, 0.01) + 1e-4, np.arange(-0.4, 0.4, 0.01) + 1e-4
    still = true_depth("scene:four", x_m, y_m)
    moved = true_depth("scene:four@20cm,-5cm,30cm", x_m, y_m)
    np.testing.assert_allclose(moved[:-5, 20:], still[5:, :-20] + 0.3, atol=1e-12)
    with pytest.raises(UsageError, match="write x, y and z"):
        true_depth("scene:four@20cm", x_m, y_m)
    with pytest.raises(UsageError, match="no scene 'five'"):
        true_depth("scene:five@1cm,0cm,0cm", x_m, y_m)
