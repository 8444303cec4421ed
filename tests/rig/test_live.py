"""The live view's process: it shows what there is, and whatever becomes of it, the scan is the same."""

import os
import queue
import subprocess
import sys
import time
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.image import imread
from test_until import description

from recon.accumulate import Coming, GrowingPicture
from recon.window import Window
from rig.acquire.acquisition import Watch, acquire
from rig.acquire.events import Ended, LightChanged, Noticed, Outcome, StepDone
from rig.files import ScanFile
from rig.live import feed as live_feed
from rig.live.feed import LiveFeed, Outbox, folder_of
from rig.live.lateness import Lateness
from rig.live.messages import Begun, Block, Gap
from rig.live.process import STEPS_AT_ONCE, Worker, block_of
from rig.model.config import built_in
from rig.model.plan import ScanPlan
from rig.model.state import RigState

SMALL = ("--grid", "16x12", "--spacing", "10cm", "--exposure", "10ms")
ASLEEP = (sys.executable, "-c", "import time; time.sleep(600)")
MISSING = (sys.executable + "-missing",)
GONE = (sys.executable, "-c", "raise SystemExit(1)")


@pytest.fixture(scope="module")
def scanned(tmp_path_factory):
    """A scan, the file of which is read."""
    path = tmp_path_factory.mktemp("live") / "a.h5"
    plan = ScanPlan.grid(built_in(), columns=16, rows=12, spacing_m=0.1, exposure_s=0.01, order="progressive")
    acquire(plan, RigState.resolve(built_in()), path)
    return path


def begun(path, folder):
    with ScanFile(path) as scan:
        return Begun(description(scan), path, folder, window=False)


def blocks(path):
    with ScanFile(path) as scan:
        return [
            block_of(scan, range(first, min(first + STEPS_AT_ONCE, scan.steps)))
            for first in range(0, scan.steps, STEPS_AT_ONCE)
        ]


def worked(started, messages):
    """Return a worker that was told all these messages, and has ended."""
    inbox = queue.Queue()
    for message in (*messages, None):
        inbox.put(message)
    worker = Worker(started, inbox)
    worker.run()
    assert worker.done
    assert worker.news.is_set()
    return worker


def usual_picture(path):
    """The picture of all positions of a file, from its histograms."""
    with ScanFile(path) as scan:
        capture, rounds = scan.capture(), scan.plan.passes[0].positions.rounds
        window = Window(start_s=scan.fade_from_s)
        growing = GrowingPicture(Coming(capture, rounds, window, scan.instrument_response_s))
        for positions, counts in capture.histograms.blocks():
            growing.add(positions.start, np.asarray(counts))
        return growing.picture()


def complete(steps):
    return Ended(Outcome.COMPLETE, steps, "all positions measured")


def test_the_last_image_is_the_usual_one_of_all_positions(scanned, tmp_path):
    parts = blocks(scanned)
    steps = parts[-1].steps.stop
    worker = worked(begun(scanned, tmp_path), [*parts, complete(steps)])
    seen, usual = worker.state.seen(), usual_picture(scanned)
    assert (seen.final, seen.picture.positions, seen.picture.pulse) == (True, steps, usual.pulse)
    np.testing.assert_array_equal(seen.picture.grid.z_m, usual.grid.z_m)
    # sums of some thousand photons in single precision, in another order
    np.testing.assert_allclose(seen.picture.front, usual.front, atol=1e-4 * float(usual.front.max()))


class Watched(queue.Queue):
    """An inbox that tells what was known each time that a message was taken."""

    def __init__(self):
        super().__init__()
        self.seen = []

    def get(self, *arguments, **named):
        self.seen.append(self.worker.state.seen())
        return super().get(*arguments, **named)


def test_the_last_image_does_not_wait_for_the_end_of_the_scan(scanned, tmp_path):
    """All positions are there before the laser is dark: it is made then, once, and none is made after it."""
    parts, inbox = blocks(scanned), Watched()
    steps = parts[-1].steps.stop
    for message in (*parts, LightChanged(False, "2026-11-27T15:00:00+00:00"), complete(steps), None):
        inbox.put(message)
    inbox.worker = Worker(begun(scanned, tmp_path), inbox)
    inbox.worker.run()
    *_, dark, ended, last = inbox.seen
    assert (dark.final, dark.ended, dark.picture.positions) == (True, None, steps)
    assert ended.picture is last.picture is inbox.worker.state.seen().picture


def test_how_late_pictures_of_all_positions_are_is_told(scanned, tmp_path):
    """By the first drawing of each, from the newest photon; what was not whole does not count."""
    parts = [replace(one, when_s=1000.0 + number) for number, one in enumerate(blocks(scanned))]
    state = worked(begun(scanned, tmp_path), [*parts, complete(parts[-1].steps.stop)]).state
    late, seen = Lateness(state.subject), state.seen()
    assert seen.newest_s == parts[-1].when_s
    part = replace(seen.picture, positions=seen.picture.positions - 1)
    late.drawn(replace(seen, picture=part, final=False), seen.newest_s - 3.0)
    assert late.words == ""
    for after_s, final in ((0.9, False), (1.9, False), (3.5, True), (4.0, True)):
        late.drawn(replace(seen, final=final), seen.newest_s + after_s)
    assert late.words == "the last photon was seen in its pictures: coarse after 0.9 s, fine after 3.5 s"


def test_what_was_not_sent_is_read_from_the_scan_file(scanned, tmp_path):
    parts = blocks(scanned)
    steps = parts[-1].steps.stop
    first, second, *others = parts
    gap = Gap(second.steps.start, second.steps.stop)
    worker = worked(begun(scanned, tmp_path), [first, gap, *others, complete(steps)])
    whole = worked(begun(scanned, tmp_path), [*parts, complete(steps)])
    found, wanted = worker.state.seen(), whole.state.seen()
    np.testing.assert_array_equal(found.photons, wanted.photons)
    np.testing.assert_array_equal(found.histogram, wanted.histogram)
    front = wanted.picture.front
    np.testing.assert_allclose(found.picture.front, front, atol=1e-4 * float(front.max()))


def test_steps_that_were_taken_back_are_not_in_the_last_image(scanned, tmp_path):
    parts = blocks(scanned)
    trusted = parts[1].steps.stop
    failed = Ended(Outcome.FAILED, trusted, "the laser went dark")
    worker = worked(begun(scanned, tmp_path), [*parts, failed])
    assert worker.state.seen().picture.positions <= trusted
    alone = worked(begun(scanned, tmp_path), [*parts[:2], failed])
    front = alone.state.seen().picture.front
    np.testing.assert_allclose(worker.state.seen().picture.front, front, atol=1e-4 * float(front.max()))


def test_a_scan_without_a_photon_has_no_image_and_ends(scanned, tmp_path):
    seen = worked(begun(scanned, tmp_path), [Ended(Outcome.INTERRUPTED, 0, "stopped")]).state.seen()
    assert (seen.picture, seen.measured, seen.lost) == (None, 0, False)
    assert worked(begun(scanned, tmp_path), []).state.seen().lost


def waiting_for(condition, seconds=120):
    """Wait until a condition holds; on a busy machine the process needs its time to begin."""
    give_up_s = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < give_up_s
        time.sleep(0.1)


def test_pictures_appear_whole_and_change_as_photons_come(scanned, tmp_path):
    folder, parts = tmp_path / "a-live", blocks(scanned)
    steps = parts[-1].steps.stop
    feed = LiveFeed(tmp_path / "a.h5", pytest.fail)
    feed.begun(begun(scanned, folder).description)
    newest = folder / "now.png"
    pictures = []
    light = LightChanged(True, "2026-11-27T15:00:00+00:00")
    half = len(parts) // 2
    for portion in ((light,), parts[:half], parts[half:]):
        for one in portion:
            feed._outbox.put(replace(one, when_s=time.time()) if isinstance(one, Block) else one)
        waiting_for(lambda: newest.exists() and newest.read_bytes() not in pictures)
        pictures.append(newest.read_bytes())
        assert imread(newest).shape[:2] == (800, 1200)
    feed(complete(steps))
    feed.close()
    assert feed._process.returncode == 0
    assert newest.read_bytes() not in pictures
    dated = sorted(one.name for one in folder.iterdir() if one != newest)
    assert dated
    assert all(time.strptime(name, "%Y%m%d-%H%M%S.png") for name in dated)
    assert (folder / dated[-1]).read_bytes() == newest.read_bytes()  # the last one has its time, too


def scan_with(tmp_path, name, watch=None):
    plan = ScanPlan.grid(built_in(), columns=12, rows=9, spacing_m=0.15, exposure_s=0.005)
    path = tmp_path / name
    acquire(plan, RigState.resolve(built_in()), path, watch)
    with ScanFile(path) as scan:
        return scan.status, scan.counts(range(scan.steps))


@pytest.mark.parametrize("view", [GONE, ASLEEP, MISSING], ids=["gone", "asleep", "none"])
def test_a_view_that_is_gone_or_hangs_disturbs_no_scan_and_is_told_once(tmp_path, monkeypatch, view):
    monkeypatch.setattr(live_feed, "LAST_PICTURE_S", 1.0)
    status, wanted = scan_with(tmp_path, "without.h5")
    told = []
    feed = LiveFeed(tmp_path / "with.h5", told.append, command=view)
    found_status, found = scan_with(tmp_path, "with.h5", Watch([feed], begun=feed.begun))
    began_s = time.monotonic()
    feed.close()
    assert time.monotonic() - began_s < 30  # 1 s, and a busy machine's
    assert (status, found_status) == ("complete", "complete")
    np.testing.assert_array_equal(found, wanted)
    assert len(told) == 1
    assert "live view" in told[0]
    assert feed._process is None or feed._process.wait(30) != 0
    assert not any(thread.is_alive() for thread in feed._threads)


def photons(first, steps, each):
    offset = np.arange(steps + 1) * each
    return Block(first, offset, np.zeros(offset[-1], np.uint16), np.full(steps, 0.01), 1.0)


def test_what_waits_for_a_hanging_view_is_bounded_and_nothing_is_forgotten():
    outbox = Outbox()
    for number in range(400):  # 400 lines of 100 steps with 5000 photons each: 400 MB
        outbox.put(photons(100 * number, 100, 5000))
        outbox.put(Noticed(f"warning {number}", number, number))
        assert outbox.nbytes <= live_feed.WAITING_BYTES
    assert outbox.full
    outbox.put(complete(40_000))
    outbox.close()
    waiting = list(iter(outbox.take, None))
    assert len(waiting) < 2 * live_feed.WAITING_WORDS + 2
    ranges = [
        (one.steps.start, one.steps.stop) if isinstance(one, Block) else (one.first, one.stop)
        for one in waiting
        if isinstance(one, Block | Gap)
    ]
    assert sorted(ranges)[0][0] == 0
    assert all(before[1] == after[0] for before, after in pairwise(ranges))
    assert ranges[-1][1] == 40_000
    assert waiting[-1] == complete(40_000)
    assert sum(isinstance(one, Noticed) for one in waiting) >= live_feed.WAITING_WORDS - 1


def test_the_engine_waits_for_nothing(scanned, tmp_path):
    """A hanging view and a thousand steps: they are taken as fast as their photons are copied."""
    feed = LiveFeed(tmp_path / "a.h5", lambda sentence: None, command=ASLEEP)
    started = begun(scanned, tmp_path)
    feed.begun(started.description)
    with ScanFile(scanned) as scan:
        counts = scan.counts(range(1))[0]
    step = next(started.description.plan.steps())
    exposure = type("Exposure", (), {"counts": counts, "live_time_s": 0.001, "warnings": ()})
    took_s = []
    for index in range(1000):
        event = StepDone(replace(step, index=index), exposure)
        began_s = time.perf_counter()
        feed(event)
        took_s.append(time.perf_counter() - began_s)
    feed._process.kill()
    feed.close()
    # far below the millisecond that a position has; the median, since other programs run here too
    assert np.median(took_s) < 0.5e-3


@pytest.mark.skipif(os.name != "posix", reason="ends a scan by a signal")
def test_the_commands_show_a_scan_and_its_resumption(tmp_path):
    command = [sys.executable, "-m", "rig", "scan", *SMALL, "--live", "--out", "a.h5"]
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as scan:
        for line in scan.stderr:
            if "20 %" in line:
                break
        scan.terminate()
        assert "now.png" not in scan.stderr.read()  # it was said at the beginning
    assert scan.returncode == 6
    newest = folder_of(tmp_path / "a.h5") / "now.png"
    before = newest.read_bytes()
    command = [sys.executable, "-m", "rig", "resume", "a.h5", "--live", "--json"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.count("schema_version") == 1
    assert "warning" not in done.stderr
    assert done.stderr.count("live view: ") == 1
    assert "live view: the last photon was seen in its pictures: " in done.stderr
    assert newest.read_bytes() != before
