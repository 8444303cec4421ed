"""Frames that are imaged while the scan runs are those of ``rig recon --each-frame``."""

import json
import queue
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from test_recon_frames import PLACES, scanned
from test_until import description

from recon.accumulate import likeness
from recon.depth import compensate_falloff, front_view
from rig.acquire.events import Ended, Outcome
from rig.files import ScanFile, read_volume
from rig.live.film import Filming, Gathering
from rig.live.messages import PLAIN, Begun, Block, Film
from rig.live.process import Worker, block_of
from rig.live.state import Subject

STEPS, CHANNELS = 6, 2


def block(first, of_pair, bins, when_s=1.0):
    offset = np.concatenate([[0], np.cumsum(of_pair)]).astype(np.int64)
    return Block(first, offset, bins, np.full(len(of_pair) // CHANNELS, 0.01), when_s)


@given(
    st.lists(st.integers(0, 3), min_size=4 * STEPS * CHANNELS, max_size=4 * STEPS * CHANNELS),
    st.sets(st.integers(1, 4 * STEPS - 1)),
    st.sets(st.integers(0, 9), max_size=3),
)
def test_frames_are_whole_or_missed_wherever_blocks_begin_and_end(counts, cuts, lost):
    """Cut anywhere, some of the pieces left out: frames that have all of their steps come, each once."""
    of_pair = np.array(counts).reshape(-1, CHANNELS)
    bins = np.arange(of_pair.sum(), dtype=np.uint16)
    begins = np.concatenate([[0], np.cumsum(of_pair.sum(axis=1))])
    edges = [0, *sorted(cuts), len(of_pair)]
    there = np.ones(len(of_pair), bool)
    gathering, found = Gathering(STEPS, CHANNELS), []
    for number, (first, stop) in enumerate(pairwise(edges)):
        if number in lost:
            there[first:stop] = False
            continue
        piece = block(first, of_pair[first:stop].ravel(), bins[begins[first] : begins[stop]], float(stop))
        found += gathering.add(piece)
    assert [one.number for one in found] == np.flatnonzero(there.reshape(4, STEPS).all(axis=1)).tolist()
    for one in found:
        steps = slice(one.number * STEPS, (one.number + 1) * STEPS)
        assert np.array_equal(np.diff(one.photons.offset), of_pair[steps].ravel())
        assert np.array_equal(one.photons.bins, bins[begins[steps.start] : begins[steps.stop]])
        assert one.when_s >= steps.stop


@pytest.fixture
def scan(tmp_path):
    """Four frames of a hidden point that moves."""
    size = scanned(tmp_path / "moving.h5", PLACES)
    with ScanFile(tmp_path / "moving.h5") as file:
        yield file, [block_of(file, range(n * size, (n + 1) * size)) for n in range(len(PLACES))]


def filming(file, folder, wish=PLAIN):
    return Filming(Subject.of("moving.h5", description(file)), wish, folder)


def test_each_frame_is_that_of_the_command(rig, scan, tmp_path):
    file, blocks = scan
    film, fronts = filming(file, tmp_path / "live"), []
    for one in blocks:
        assert film.add(one)
        fronts.append(film.picture().front)
    grid = film.grid
    assert [one.name for one in sorted((tmp_path / "live").iterdir())] == [
        f"frame-{n:05d}.png" for n in range(1, 5)
    ]
    z_m, side_m = grid.z_m, grid.x_m[1] - grid.x_m[0]
    around = ("--wavelength", f"{film.pulse.wavelength_m:.9f}m", "--voxel", f"{side_m:.9f}m")
    depth = f"{z_m[0]:.9f}m:{z_m[-1]:.9f}m:{z_m[1] - z_m[0]:.9f}m"
    done = rig("recon", file.path, "--each-frame", *around, "--depth", depth, "--json")
    volume = read_volume(json.loads(done.out)["volume"])
    np.testing.assert_allclose(volume.x_m, grid.x_m, atol=1e-9)
    np.testing.assert_allclose(volume.z_m, z_m, atol=1e-9)
    for front, frame in zip(fronts, volume.intensity, strict=True):
        usual = np.sqrt(front_view(compensate_falloff(frame, z_m, 4.0)))
        assert likeness(front, usual) > 0.9999  # single precision


def test_frames_that_are_not_looked_at_are_averaged_all_the_same(scan, tmp_path):
    file, blocks = scan
    wish = Film(fresh_to_m=0.3)  # three frames at the point's depth
    each, last = filming(file, tmp_path / "a", wish), filming(file, tmp_path / "b", wish)
    for one in blocks:
        each.add(one)
        front = each.picture().front
        last.add(one)
    np.testing.assert_allclose(last.picture().front, front, atol=1e-6 * float(front.max()))
    broken = filming(file, tmp_path / "c", wish)
    for one in (blocks[0], blocks[1], blocks[3]):  # the last one does not follow those before it
        broken.add(one)
    alone = filming(file, tmp_path / "d", wish)
    alone.add(blocks[3])
    found, wanted = broken.picture().front, alone.picture().front
    np.testing.assert_allclose(found, wanted, atol=1e-6 * float(wanted.max()))


def test_a_view_without_time_shows_the_newest_frame_and_says_how_many_it_did_not(scan, tmp_path, capfd):
    """All frames wait when it begins: the last one is shown, and in the video."""
    file, blocks = scan
    steps = blocks[-1].steps.stop
    inbox = queue.Queue()
    for number, one in enumerate(blocks):
        inbox.put(Block(one.first, one.offset, one.photon_bins, one.live_time_s, 1000.0 + number))
    inbox.put(Ended(Outcome.COMPLETE, steps, "all positions measured"))
    inbox.put(None)
    wish = Film(video=tmp_path / "moving.gif")
    worker = Worker(Begun(description(file), file.path, tmp_path / "live", False, wish), inbox)
    worker._next_s = float("inf")  # as while an image is made
    worker.run()
    seen, told = worker.state.seen(), capfd.readouterr().out
    assert seen.title.startswith("frame 4 of 4, ")
    assert seen.measured == steps
    assert seen.photons.shape == (steps // 4,)
    assert "fact 1 of 4 frames were shown; there was no time for 3: each " in told
    assert [one.name for one in (tmp_path / "live").iterdir()] == ["frame-00004.png"]
    with Image.open(tmp_path / "moving.gif") as film:
        assert film.n_frames == 1


def test_the_command_shows_frames_and_makes_their_video(rig, tmp_path):
    asked = ("scan", "--grid", "16x12", "--spacing", "10cm", "--exposure", "1ms", "--mode", "continuous")
    done = rig(*asked, "--frames", "3", "--live", "--video", "film.gif", "--out", "a.h5")
    assert done.code == 0, done.err
    assert "frames were shown" in done.err
    assert "warning" not in done.err
    assert (tmp_path / "a-live" / "frame-00003.png").exists()
    with Image.open(tmp_path / "film.gif") as film:
        assert 1 <= film.n_frames <= 3


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--video", "a.gif", "--frames", "2"), "--video would have no effect without --live and --frames"),
        (("--fresh-to", "1m", "--live"), "--fresh-to would have no effect without --live and --frames"),
        (("--fresh-to", "0m", "--live", "--frames", "2"), "the depth must be above 0"),
        (("--video", "a.png", "--live", "--frames", "2"), "its ending must be .gif or .mp4"),
    ],
)
def test_what_makes_no_sense_is_refused(rig, options, said):
    done = rig("scan", "--grid", "4x3", "--spacing", "20cm", *options)
    assert done.code == 2
    assert said in done.err
