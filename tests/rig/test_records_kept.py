"""Records kept beside a scan are what the instrument gave, and import to what the scan file holds."""

import shutil
import struct
from types import SimpleNamespace

import numpy as np
import pytest

from drivers.harp.records import T3, Batch, Decoder, Encoder
from drivers.harp.stream import TaggedRecords
from rig.acquire.acquisition import Watch, acquire, interrupted, resume
from rig.acquire.assembly import Assembler, LineRead, Timing
from rig.acquire.events import LineDone
from rig.errors import DataFileError, UsageError
from rig.files import ScanDescription, ScanFile
from rig.files.picoquant import STEPS, SWEEPS, place_of, read_head
from rig.files.records import PtuRecorder, beside
from rig.importers import import_scan
from rig.model.config import built_in, built_in_with
from rig.model.delays import PathDelays
from rig.model.plan import ScanPlan
from rig.model.state import RigState
from rig.model.sweep import POINT, Trajectories
from support.scan_files import load

TICK_S, BINS, INPUTS = 1e-3, 50, (2, 0)
STATE = RigState(built_in())
SYNC_HZ = STATE.config.laser.repetition_hz
TICK = round(TICK_S * SYNC_HZ)
PLAN = ScanPlan.grid(
    STATE.config, columns=6, rows=4, skip_m=0.0, order="snake", motion="continuous", exposure_s=TICK_S
)
COLUMNS = 6


@pytest.fixture(scope="module")
def description():
    from rig.model.state import Channel

    channels = tuple(
        Channel(
            name=str(one),
            input=one,
            spot_m=(0.1 * one, 0.2, 0.0),
            delay_s=1e-9 * one,
            response_s=None,
            dark_hz=None,
        )
        for one in INPUTS
    )
    return ScanDescription(
        laser_m=PLAN.spots_m,
        detector_m=np.array([[channel.spot_m for channel in channels]]),
        bins=BINS,
        bin_width_s=4e-12,
        first_bin_s=30e-9,
        delays=PathDelays(np.array([0.3, -0.5, 2.0]), np.array([-0.2, -0.4, 1.7]), 23e-9),
        channels=channels,
        plan=PLAN,
        state=STATE,
        tagged=True,
    )


def batch_of(sweep, seed, lacking=None):
    """Return photons and markers of a sweep, without the n-th marker."""
    rng = np.random.default_rng(seed)
    ticks = np.flatnonzero(sweep.marks)
    if lacking is not None:
        ticks = np.delete(ticks, lacking)
    marker_tag = 777 + ticks * TICK
    tag = np.flatnonzero(rng.random(777 + (len(sweep.marks) + 5) * TICK) < 0.002)
    photons = len(tag)
    return Batch(
        tag,
        rng.integers(0, BINS + 5, photons).astype(np.uint16),
        rng.choice([0, 1, 2], photons).astype(np.int8),
        marker_tag,
        sweep.marks[ticks].copy(),
        np.searchsorted(tag, marker_tag),
    )


def measure(recorder, first, seed, lacking=None):
    """Sweep from a step on as the engine does; return the exposures of the lines that were read."""
    angles = STATE.pointing.angles_rad(PLAN.spots_m)
    (sweep,) = Trajectories(PLAN, angles, 5e-3).sweeps(range(first, len(PLAN)))
    batch = batch_of(sweep, seed, lacking)
    words = Encoder(T3).encode(batch)
    for number, piece in enumerate(np.array_split(words, 7)):
        recorder.add(piece, None if number else first)
    assembler = Assembler(sweep, Timing(INPUTS, BINS, SYNC_HZ, STATE.mirror_lag_s))
    last = int(batch.tag[-1])
    nothing = Batch(
        *(one[:0] for one in (batch.tag, batch.dtime, batch.channel)), *(batch.marker_tag[:0],) * 3
    )
    found = [
        *assembler.add(TaggedRecords(words, batch, last, ())),
        *assembler.add(TaggedRecords(words[:0], nothing, last, ())),
    ]
    return [exposure for one in found if isinstance(one, LineRead) for exposure in one.exposures], words


def imported(path, tmp_path):
    target = tmp_path / f"{path.stem}-imported.h5"
    target.unlink(missing_ok=True)
    report = import_scan(path, target)
    capture, counts = load(target)
    return capture, counts.reshape(-1, len(INPUTS), BINS), " ".join(report.assumed)


def counts_of(exposures):
    return np.array([one.counts for one in exposures])


def test_records_are_kept_as_they_came_and_import_to_what_the_scan_holds(tmp_path, description):
    recorder = PtuRecorder(tmp_path / "a.ptu", description)
    exposures, words = measure(recorder, 0, seed=1)
    recorder.close(len(PLAN))
    assert len(exposures) == len(PLAN)
    head = read_head(tmp_path / "a.ptu")
    kept = np.fromfile(tmp_path / "a.ptu", "<u4", offset=head.end)
    np.testing.assert_array_equal(kept, words)
    assert head.values["TTResult_NumberOfRecords"] == len(words)
    capture, counts, told = imported(tmp_path / "a.ptu", tmp_path)
    np.testing.assert_array_equal(counts, counts_of(exposures))
    np.testing.assert_array_equal(capture.laser_m[:: len(INPUTS)], PLAN.spots_m)
    delay_s = description.rectified_by_s()
    np.testing.assert_allclose(capture.first_bin_s, 30e-9 - delay_s.ravel(), rtol=0, atol=1e-18)
    assert "points are in the file" not in told


def test_a_line_that_failed_counts_once(tmp_path, description):
    recorder = PtuRecorder(tmp_path / "a.ptu", description)
    # the first marker is that with which the sweep sets off, each line has an end; so this is of line 3
    first, _ = measure(recorder, 0, seed=1, lacking=1 + 2 * (COLUMNS + 1) + 3)
    assert len(first) == 2 * COLUMNS
    second, _ = measure(recorder, 2 * COLUMNS, seed=2, lacking=COLUMNS + 1)
    assert len(second) == 0
    third, _ = measure(recorder, 2 * COLUMNS, seed=3)
    recorder.close(len(PLAN))
    _, counts, _ = imported(tmp_path / "a.ptu", tmp_path)
    np.testing.assert_array_equal(counts, counts_of(first + third))


def test_a_scan_that_was_stopped_and_taken_up_has_two_files(tmp_path, description):
    path = beside(tmp_path / "scan.h5")
    recorder = PtuRecorder(path, description)
    first, _ = measure(recorder, 0, seed=1, lacking=1 + 2 * (COLUMNS + 1) + 3)
    recorder.close(2 * COLUMNS)
    again = beside(tmp_path / "scan.h5", again=True)
    assert (path.name, again.name) == ("scan.ptu", "scan-2.ptu")
    recorder = PtuRecorder(again, description, first=2 * COLUMNS)
    second, _ = measure(recorder, 2 * COLUMNS, seed=2)
    recorder.close(len(PLAN))
    assert beside(tmp_path / "scan.h5", again=True).name == "scan-3.ptu"
    _, counts, told = imported(path, tmp_path)
    np.testing.assert_array_equal(counts, counts_of(first))
    assert "the first 12 of 24 points are in the file" in told
    capture, counts, _ = imported(again, tmp_path)
    np.testing.assert_array_equal(counts, counts_of(second))
    np.testing.assert_array_equal(capture.laser_m[:: len(INPUTS)], PLAN.spots_m[2 * COLUMNS :])


def test_after_a_kill_at_any_byte_whole_points_are_read(tmp_path, description):
    recorder = PtuRecorder(tmp_path / "a.ptu", description)
    exposures, words = measure(recorder, 0, seed=1)
    whole = (tmp_path / "a.ptu").read_bytes()  # not closed: what a killed program leaves
    end, rng = len(whole) - words.nbytes, np.random.default_rng(5)
    lag = round(STATE.mirror_lag_s * SYNC_HZ)
    seen = []
    for size in [len(whole), *rng.integers(end, len(whole), 20).tolist()]:
        cut = tmp_path / "cut.ptu"
        cut.write_bytes(whole[:size])
        kept = Decoder(T3).decode(words[: (size - end) // 4])
        ends = kept.marker_tag[kept.marker_mask & POINT > 0] + TICK + lag
        seen.append(int(np.count_nonzero(ends <= kept.tag[-1])) if kept.photons else 0)
        if not seen[-1]:
            with pytest.raises(DataFileError):
                imported(cut, tmp_path)
            continue
        _, counts, told = imported(cut, tmp_path)
        np.testing.assert_array_equal(counts, counts_of(exposures[: seen[-1]]))
        assert "the file is cut off" in told
        assert "ended before the scan did" in told
    recorder.close(None)
    assert seen[0] == len(PLAN)
    assert len(set(seen)) > 5


def test_what_cannot_be_trusted_is_not_imported(tmp_path, description):
    recorder = PtuRecorder(tmp_path / "a.ptu", description)
    exposures, _ = measure(recorder, 0, seed=1)
    recorder.close(7)
    _, counts, _ = imported(tmp_path / "a.ptu", tmp_path)
    np.testing.assert_array_equal(counts, counts_of(exposures[:7]))


def test_nothing_is_overwritten_and_nothing_recorded_leaves_nothing(tmp_path, description):
    path = tmp_path / "a.ptu"
    PtuRecorder(path, description).close(None)
    assert not path.exists()
    path.write_bytes(b"precious")
    with pytest.raises(UsageError, match=r"a\.ptu exists"):
        PtuRecorder(path, description)
    assert path.read_bytes() == b"precious"
    with pytest.raises(UsageError, match="cannot create"):
        PtuRecorder(tmp_path / "nowhere" / "a.ptu", description)


def test_a_disk_that_fills_up_ends_the_records_and_says_so(tmp_path, description, monkeypatch):
    left = iter([10**12] * 3 + [50 << 20] * 100)
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(free=next(left)))
    recorder = PtuRecorder(tmp_path / "a.ptu", description)
    exposures, words = measure(recorder, 0, seed=1)
    assert "only 52 MB free. The scan goes on" in recorder.problem
    recorder.close(len(PLAN))
    head = read_head(tmp_path / "a.ptu")
    kept = sum(len(piece) for piece in np.array_split(words, 7)[:3])
    assert head.values["TTResult_NumberOfRecords"] == kept
    _, counts, _ = imported(tmp_path / "a.ptu", tmp_path)
    assert 0 < len(counts) < len(PLAN)
    np.testing.assert_array_equal(counts, counts_of(exposures[: len(counts)]))


def test_more_sweeps_than_the_head_has_room_for_end_the_records(tmp_path, description):
    recorder = PtuRecorder(tmp_path / "a.ptu", description)
    for _ in range(4 + 64):
        recorder.add(np.zeros(1, np.uint32), 0)
        assert not recorder.problem
    recorder.add(np.zeros(1, np.uint32), 0)
    assert "room for 68 sweeps" in recorder.problem


def test_time_goes_on_between_sweeps(tmp_path, description):
    recorder = PtuRecorder(tmp_path / "a.ptu", description)
    measure(recorder, 0, seed=1)
    measure(recorder, 0, seed=2)
    recorder.close(len(PLAN))
    head = read_head(tmp_path / "a.ptu")
    batch = Decoder(T3).decode(np.fromfile(tmp_path / "a.ptu", "<u4", offset=head.end))
    assert (np.diff(batch.tag) >= 0).all()
    tag, step = head.numbers(SWEEPS)[2:4]
    assert step == 0
    # the tags of the second sweep, counted from where it begins, are those of the instrument
    (sweep,) = Trajectories(PLAN, STATE.pointing.angles_rad(PLAN.spots_m), 5e-3).sweeps(range(len(PLAN)))
    expected = batch_of(sweep, seed=2).tag
    np.testing.assert_array_equal(batch.tag[-len(expected) :] - int(tag), expected)


@pytest.mark.parametrize(
    ("tag", "number", "value", "said"),
    [
        (SWEEPS, 0, 1e18, "times that are impossible in a scan"),
        (SWEEPS, 1, 25.0, "do not follow one another"),
        (SWEEPS, 1, float("nan"), "is not a list of numbers"),
        (SWEEPS, 0, -1.0, "no complete point of 24"),
        ("NLOS_Inputs", 0, 2.0**64, "different whole numbers from 0 to 63"),
        ("NLOS_Inputs", 0, 64.0, "different whole numbers from 0 to 63"),
        ("NLOS_Inputs", 0, -1.0, "different whole numbers from 0 to 63"),
        ("NLOS_Inputs", 0, 0.5, "different whole numbers from 0 to 63"),
    ],
)
def test_damaged_tags_are_named(tmp_path, description, tag, number, value, said):
    recorder = PtuRecorder(tmp_path / "a.ptu", description)
    measure(recorder, 0, seed=1)
    recorder.close(len(PLAN))
    content = bytearray((tmp_path / "a.ptu").read_bytes())
    struct.pack_into("<d", content, place_of(bytes(content), tag) + 8 + 8 * number, value)
    (tmp_path / "b.ptu").write_bytes(content)
    with pytest.raises(DataFileError, match=said):
        imported(tmp_path / "b.ptu", tmp_path)


@pytest.fixture(scope="module")
def rig():
    """A simulated rig whose mirror is followed, and a plan for it."""
    config = built_in_with({"galvo": {"kind": "analogue"}, "simulation": {"seed": 4}})
    plan = ScanPlan.grid(config, columns=8, rows=6, spacing_m=0.15, exposure_s=0.01, motion="continuous")
    return RigState(config), plan


def scanned(path):
    with ScanFile(path) as scan:
        return scan.counts(range(scan.steps)), scan.status, scan.done.sum(), scan.warnings


def test_records_of_a_scan_import_to_what_its_file_holds(tmp_path, rig):
    state, plan = rig
    path, asked = tmp_path / "scan.h5", []
    stop = Watch(
        [lambda event: asked.append(event) if isinstance(event, LineDone) else None],
        should_stop=lambda: bool(asked),
        records=beside(path),
    )
    acquire(plan, state, path, stop)
    counts, status, measured, _ = scanned(path)
    assert status == "interrupted"
    assert 0 < measured < len(plan)
    import_scan(beside(path), tmp_path / "first.h5")
    np.testing.assert_array_equal(load(tmp_path / "first.h5")[1], counts[:measured, 0])

    resume(*interrupted(path), path)
    counts, status, _, _ = scanned(path)
    assert status == "complete"
    import_scan(tmp_path / "scan-2.ptu", tmp_path / "second.h5")
    np.testing.assert_array_equal(load(tmp_path / "second.h5")[1], counts[measured:, 0])


def test_a_scan_goes_on_without_its_records_and_says_so(tmp_path, rig, monkeypatch):
    state, plan = rig
    path = tmp_path / "scan.h5"
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(free=50 << 20))
    acquire(plan, state, path, Watch(records=beside(path)))
    _, status, _, warnings = scanned(path)
    assert status == "complete"
    assert any("scan.ptu ends here, its disk has only 52 MB free" in said for said in warnings)


def test_ptufile_reads_records_of_a_killed_scan(tmp_path, description):
    ptufile = pytest.importorskip("ptufile", reason="ptufile is not installed: pip install 'nlos-rig[dev]'")
    recorder = PtuRecorder(tmp_path / "a.ptu", description)
    _, words = measure(recorder, 0, seed=1)
    with ptufile.PtuFile(tmp_path / "a.ptu") as file:
        np.testing.assert_array_equal(np.asarray(file.read_records()), words)
    recorder.close(len(PLAN))
    with ptufile.PtuFile(tmp_path / "a.ptu") as file:
        assert file.number_records == len(words)
        assert file.tags[STEPS] == len(PLAN)
