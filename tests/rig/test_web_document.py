"""What the page is told: of the light above all, in words; images as the virtual camera sees them."""

import base64
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_live_state import PLAN, block, described, histograms

from recon.capture import C_M_PER_S
from recon.grid import VoxelGrid
from rig.acquire.events import Ended, LightChanged, Noticed, Outcome, Phase, PhaseChanged
from rig.live.messages import Begun, Next
from rig.live.state import LiveState, Subject
from rig.live.wall import WallMap
from rig.live.web.document import Beside, Document, imaged_s, light

WHEN = "2026-11-27T15:04:05+01:00"
ON, DARK, UNKNOWN = (LightChanged(on, WHEN) for on in (True, False, None))
COMPLETE = Ended(Outcome.COMPLETE, len(PLAN), "all positions measured")
BESIDE = Beside(heard_s=1000.0)


def told(tmp_path, *messages, reads=False, lost=False):
    """Return the document of a scan of which this was said, through JSON as the page gets it."""
    description = described()
    begun = Begun(description, tmp_path / "a.h5", tmp_path, False,
                  then=Next("rig resume a.h5", "rig recon a.h5"), reads=reads)  # fmt: skip
    state = LiveState(Subject.of("a.h5", description))
    for message in messages:
        state(message)
    if lost:
        state.lose()
    document = Document(begun, state.subject).of(state.seen(), BESIDE)
    return json.loads(json.dumps(document, allow_nan=False))


@pytest.mark.parametrize(
    ("messages", "lost", "kind", "words"),
    [
        ([], False, "unsaid", "not known yet"),
        ([ON], False, "on", "LASER ON since 15:04:05"),
        ([ON, DARK], False, "dark", "laser dark, read back twice at 15:04:05"),
        ([ON, UNKNOWN], False, "unknown", "treat it as EMITTING"),
        ([ON], True, "unknown", "treat the laser as EMITTING"),
        ([ON, UNKNOWN], True, "unknown", "treat it as EMITTING"),
        ([ON, COMPLETE], False, "unknown", "treat the laser as EMITTING"),
        ([ON, DARK, COMPLETE], False, "dark", "laser dark"),
    ],
)
def test_light_is_said_in_words_and_never_better_than_it_is(tmp_path, messages, lost, kind, words):
    said = told(tmp_path, *messages, lost=lost)["light"]
    assert said["is"] == kind
    assert words in said["words"]


def test_light_of_a_file_is_marked_as_from_its_log(tmp_path):
    assert "log" in told(tmp_path, ON, reads=True)["light"]["from"]
    assert "log" not in told(tmp_path, ON)["light"]["from"]


@pytest.mark.parametrize("event", [ON, DARK, UNKNOWN, LightChanged(False, WHEN, "no light at the detector")])
def test_light_is_read_back_from_the_words_of_a_scan_file(event):
    assert LightChanged.from_words(event.words) == event
    assert LightChanged.from_words(f"it is not so that {event.words}, or is it") is None


def test_the_page_says_how_far_the_scan_is_and_how_it_ended(tmp_path):
    counts = histograms()
    said = [PhaseChanged(Phase.EXPOSING), ON, block(counts, 0, 30, 1000.0)]
    noticed = Noticed("<b>bad</b>", 3, 4, when_s=1000.0)
    document = told(tmp_path, *said, noticed)
    assert document["progress"] == {"part": 0.75, "words": "30 of 40 positions (75%)"}
    assert document["phase"] == "exposing"
    assert document["stop"] == {"possible": True, "asked": None}
    numbers = dict(document["numbers"])
    assert numbers["photons"] == f"{counts[:30].sum():,}"
    assert {"time left", "ends about"} <= set(numbers)
    (warning,) = document["warnings"]
    assert (warning["sentence"], warning["where"]) == ("<b>bad</b>", "positions 3 to 4")
    assert warning["when"]
    assert sum(document["histogram"]["photons"]) == counts[:30].sum()
    assert [edge["name"] for edge in document["histogram"]["gate"]] == ["gate opens", "gate closes"]
    stopped = Ended(Outcome.INTERRUPTED, 30, "stopped by the operator")
    for ended, command in ((stopped, "rig resume a.h5"), (COMPLETE, "rig recon a.h5")):
        document = told(tmp_path, *said, DARK, ended)
        assert ended.reason in document["end"]["words"]
        assert document["end"]["next"] == command
        assert document["stop"]["possible"] is False
    assert told(tmp_path, *said, reads=True)["stop"]["possible"] is False


def test_the_wall_is_to_scale_and_grey_where_nothing_was_measured(tmp_path):
    counts = histograms()
    wall = told(tmp_path, block(counts, 0, 25, 1000.0))["wall"]
    shape = wall["y"]["count"], wall["x"]["count"]
    levels = np.frombuffer(base64.b64decode(wall["levels"]), np.uint8).reshape(shape)
    x_m, y_m = (
        wall[axis]["first_m"] + wall[axis]["pitch_m"] * np.arange(wall[axis]["count"]) for axis in "xy"
    )
    at = [(np.abs(y_m - y).argmin(), np.abs(x_m - x).argmin()) for x, y, _ in PLAN.spots_m]
    np.testing.assert_allclose([[x_m[c], y_m[r]] for r, c in at], PLAN.spots_m[:, :2], atol=1e-4)
    found = np.array([levels[place] for place in at])
    assert (found[:25] > 0).all()
    assert (found[25:] == 0).all()
    photons = counts[:25].sum(axis=(1, 2)).astype(float)
    shown = wall["low"] + (found[:25] - 1) / 254 * (wall["high"] - wall["low"])
    step = (wall["high"] - wall["low"]) / 254  # levels are rounded
    np.testing.assert_allclose(shown, np.clip(photons, wall["low"], wall["high"]), atol=step)


def test_scattered_positions_are_in_cells_that_hold_one_on_average():
    spots_m = np.zeros((400, 3))
    spots_m[:, :2] = np.random.default_rng(5).uniform([-1, -0.5], [1, 0.5], (400, 2))
    wall = WallMap.of(spots_m, (400,))
    photons = np.arange(400.0)
    photons[200:] = np.nan
    image, side = wall.image(photons)
    assert (wall.even, side) == (False, 1)
    assert 300 <= image.size <= 500
    for axis, at, values in ((wall.cells.x, wall.cells.column, 0), (wall.cells.y, wall.cells.row, 1)):
        off_m = axis.coordinates_m[at] - spots_m[:, values]
        assert np.abs(off_m).max() <= axis.pitch_m / 2 * (1 + 1e-9)
    row, column = wall.cells.row[7], wall.cells.column[7]
    here = (wall.cells.row == row) & (wall.cells.column == column)
    assert image[row, column] == np.nanmean(photons[here])


def test_the_imaged_time_holds_the_light_of_every_voxel():
    """Its ends, from all voxels of a small grid by themselves."""
    random = np.random.default_rng(2)
    laser_m, detector_m = random.uniform(-0.5, 0.5, (2, 20, 3)) * [1, 1, 0]
    grid = VoxelGrid(np.linspace(-0.3, 0.6, 7), np.linspace(-0.4, 0.4, 5), np.linspace(0.5, 1.5, 6))
    z, y, x = np.meshgrid(grid.z_m, grid.y_m, grid.x_m, indexing="ij")
    voxels_m = np.stack([x, y, z], axis=-1).reshape(-1, 1, 3)
    ways_m = [np.linalg.norm(voxels_m - spots, axis=2) for spots in (laser_m, detector_m)]
    first_s, last_s = imaged_s(SimpleNamespace(laser_m=laser_m, detector_m=detector_m), grid)
    assert first_s <= sum(way.min(axis=1) for way in ways_m).min() / C_M_PER_S
    assert first_s >= 2 * 0.5 / C_M_PER_S
    assert last_s == pytest.approx(sum(way.max(axis=1) for way in ways_m).max() / C_M_PER_S)


def test_light_that_was_lost_says_what_was_known_last(tmp_path):
    state = LiveState(Subject.of("a.h5", described()))
    state(ON)
    state.lose()
    said = light(replace(state.seen()), reads=False)
    assert "LASER ON since 15:04:05" in said["from"]
