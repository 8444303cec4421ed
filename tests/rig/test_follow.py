"""A scan file is followed while another program writes it: what is new, once, and how it ended."""

import json
import queue
import threading
import time
import urllib.request

import numpy as np
import pytest
from test_live_state import histograms

from rig.acquire.events import Ended, LightChanged, Noticed, Outcome
from rig.errors import DataFileError, UsageError
from rig.files import ScanDescription, ScanFile, ScanWriter
from rig.files.following import Closed, Following, Steps, Unread
from rig.live import follow, watching
from rig.live.follow import Follower
from rig.live.messages import Block, Gap
from rig.live.watching import Watching
from rig.live.web.address import address
from rig.model.config import built_in
from rig.model.plan import ScanPlan

PLAN = ScanPlan.grid(built_in(), columns=10, rows=4, spacing_m=0.1, skip_m=0.0)
BINS, CHANNELS = 3000, 2
DARK = LightChanged(False, "2026-11-27T15:04:05+01:00")


def description(tagged):
    spots_m = np.zeros((1, CHANNELS, 3))
    return ScanDescription(PLAN.spots_m, spots_m, BINS, 16e-12, 0.0, plan=PLAN, tagged=tagged)


def histograms_of(news):
    """Return the steps of news, and their histograms from their photons."""
    found = {}
    for one in news:
        row = np.repeat(np.arange(len(one.of_pair)), one.of_pair)
        counts = np.zeros((len(one.of_pair), BINS), np.uint32)
        np.add.at(counts, (row, one.photon_bins), 1)
        for number, step in enumerate(counts.reshape(-1, CHANNELS, BINS)):
            assert one.first + number not in found  # no step comes twice
            found[one.first + number] = step
    return found


@pytest.mark.parametrize("tagged", [False, True], ids=["histograms", "photons"])
def test_what_is_new_in_a_growing_file_comes_once_and_in_order(tmp_path, tagged):
    counts, path, found = histograms(CHANNELS), tmp_path / "a.h5", {}
    with ScanWriter.create(path, description(tagged)) as writer:
        following = Following(path)
        assert list(following.news()) == []
        for stop in (7, 8, 30, 40):  # in the middle of chunks, and over their ends
            for step in range(writer.appended, stop):
                writer.append(counts[step], 0.01)
            writer.note("the mirror is slow", stop - 1, stop - 1)
            writer.checkpoint()
            news = list(following.news())
            steps = [one for one in news if isinstance(one, Steps)]
            found |= histograms_of(steps)
            assert sum(len(one.live_time_s) for one in steps) == len(histograms_of(steps))
            assert sorted(found) == list(range(stop))
            assert {one.sentence for one in news if one not in steps} == {"the mirror is slow"}
        with ScanFile(path) as growing:
            assert growing.growing  # it was read meanwhile, and is written still
        writer.close("complete", "all positions measured")
    np.testing.assert_array_equal(np.stack([found[step] for step in range(40)]), counts)
    assert list(following.news())[-1] == Closed("complete", "all positions measured", 40)
    following.close()


def test_steps_that_came_between_two_looks_and_the_end_are_in_the_closed_file(tmp_path):
    counts, path = histograms(CHANNELS), tmp_path / "a.h5"
    with ScanWriter.create(path, description(False)) as writer:
        following = Following(path)
        for step in range(20):
            writer.append(counts[step], 0.01)
        writer.close("interrupted", "stopped by the operator")
    assert list(following.news()) == [Unread(0, 20), Closed("interrupted", "stopped by the operator", 20)]
    following.close()


def test_a_file_whose_program_was_killed_ends_as_interrupted(tmp_path):
    counts, path = histograms(CHANNELS), tmp_path / "a.h5"
    writer = ScanWriter.create(path, description(False))
    for step in range(20):
        writer.append(counts[step], 0.01)
    writer.checkpoint()
    writer._journal.close()  # as the system does when the program is gone
    following = Following(path)
    *steps, closed = following.news()
    assert sorted(histograms_of(steps)) == list(range(20))
    assert (closed.status, closed.steps_done) == ("interrupted", 20)
    following.close()


def test_a_follower_gives_the_messages_of_a_scan_that_runs(tmp_path, monkeypatch):
    monkeypatch.setattr(follow, "LOOK_S", 0.02)
    counts, path, inbox = histograms(CHANNELS), tmp_path / "a.h5", queue.Queue()
    with ScanWriter.create(path, description(False)) as writer:
        writer.append(counts[0], 0.01)
        writer.checkpoint()
        follower = Follower(path)
        thread = threading.Thread(target=follower.run, args=(inbox, threading.Event()))
        thread.start()
        first = inbox.get(timeout=30)
        for step in range(1, 40):
            writer.append(counts[step], 0.01)
        writer.note(DARK.words, 39, 39, "light")
        writer.note("it is warm", 3, 39)
        writer.checkpoint()
        messages = [inbox.get(timeout=30) for _ in range(3)]
        writer.close("complete", "all positions measured")
    messages += iter(inbox.get, None)
    thread.join()
    assert follower.trouble == ""
    assert isinstance(first, Block)
    assert np.isnan(first.when_s)  # it was there before
    blocks = [one for one in messages if isinstance(one, Block | Gap)]
    assert all(np.isfinite(one.when_s) for one in blocks if isinstance(one, Block))
    assert DARK in messages
    (noticed,) = {one.sentence for one in messages if isinstance(one, Noticed)}
    assert noticed == "it is warm"
    assert messages[-1] == Ended(Outcome.COMPLETE, 40, "all positions measured")


def test_what_is_no_scan_with_a_plan_is_refused(tmp_path):
    with pytest.raises(DataFileError):
        Follower(tmp_path / "missing.h5")
    path = tmp_path / "imported.h5"
    with ScanWriter.create(path, ScanDescription(PLAN.spots_m, np.zeros((1, 3)), 8, 4e-12, 0.0)) as writer:
        writer.append(np.ones(8, np.uint32))
    with pytest.raises(UsageError, match="rig report"):
        Follower(path)


@pytest.mark.parametrize("killed", [False, True], ids=["stopped", "killed"])
def test_a_scan_that_is_resumed_while_it_is_watched_is_followed(tmp_path, monkeypatch, killed):
    for module in (follow, watching):
        monkeypatch.setattr(module, "LOOK_S", 0.02)
    counts, path, troubles = histograms(CHANNELS), tmp_path / "a.h5", []
    writer = ScanWriter.create(path, description(False))
    for step in range(20):
        writer.append(counts[step], 0.01)
    if killed:
        writer.checkpoint()
        writer._journal.close()  # as the system does when the program is gone
    else:
        writer.close("interrupted", "stopped by the operator")

    def shows(words):
        deadline_s = time.monotonic() + 60
        while time.monotonic() < deadline_s:
            with urllib.request.urlopen(f"{seen.address.url}state") as answer:
                state = json.load(answer)
            end = state["end"] or {"words": "runs"}
            if words == (end["words"].partition(" positions")[0], state["progress"]["words"]):
                return True
        return False

    with Watching(path, address("127.0.0.1"), troubles.append) as seen:
        assert shows(("Interrupted after 20", "20 of 40 positions (50%)"))
        with ScanWriter.resume(path) as resumed:
            for step in range(20, 30):
                resumed.append(counts[step], 0.01)
            resumed.checkpoint()
            assert shows(("runs", "30 of 40 positions (75%)"))
            for step in range(30, 40):
                resumed.append(counts[step], 0.01)
            resumed.close("complete", "all positions measured")
        assert shows(("Complete after 40", "40 of 40 positions (100%)"))
        seen.stop()
    assert troubles == []
