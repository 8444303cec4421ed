"""A scan file gives back what was written, in the wall's time, and refuses what it cannot trust."""

import json

import h5py
import numpy as np
import pytest

from recon.capture import BLOCK_BYTES
from rig.errors import UsageError
from rig.files import ScanDescription, ScanFile, ScanWriter, start
from rig.model.config import built_in
from rig.model.delays import PathDelays
from rig.model.plan import Pass, ScanPlan, Spots
from rig.model.state import RigState
from support.scan_files import C_M_PER_S, dense

PLAN = ScanPlan.grid(built_in(), columns=37, rows=1, skip_m=0.0)


def describe(positions=37, bins=130, **changes):
    rng = np.random.default_rng(1)
    laser_m = np.column_stack([rng.uniform(-1, 1, (positions, 2)), np.zeros(positions)])
    given = {
        "laser_m": laser_m,
        "detector_m": np.array([[0.1, -0.2, 0.0]]),
        "bins": bins,
        "bin_width_s": 4e-12,
        "first_bin_s": 1e-9,
        "plan": PLAN,
        "state": RigState(built_in()),
        "simulated": True,
        "command": "rig scan --seed 3",
        "devices": {"galvo": {"identity": "Mirror 7", "gain": 1.5, "closed_loop": True, "samples": 3}},
    }
    return ScanDescription(**(given | changes))


def draw(positions=37, bins=130, seed=2):
    return np.random.default_rng(seed).poisson(0.4, (positions, bins)).astype("u4")


def write(path, description, counts, measured=None):
    with ScanWriter.create(path, description) as writer:
        for number, row in enumerate(counts[:measured]):
            writer.append(row, 0.01)
            if number % 10 == 9:
                writer.checkpoint()
    return path


def test_what_is_written_is_read_back(tmp_path):
    description, counts = describe(), draw()
    path = write(tmp_path / "a.h5", description, counts)
    with ScanFile(path) as scan:
        assert scan.status == "complete"
        assert scan.done.all()
        assert scan.plan == PLAN
        assert scan.state == RigState(built_in())
        assert scan.simulated
        assert scan.command == "rig scan --seed 3"
        assert scan.devices == {
            "galvo": {"identity": "Mirror 7", "gain": 1.5, "closed_loop": True, "samples": 3}
        }
        np.testing.assert_array_equal(scan.live_time_s, np.full(37, 0.01, "f4"))
        capture = scan.capture()
        np.testing.assert_array_equal(dense(capture), counts)
        np.testing.assert_array_equal(capture.laser_m, description.laser_m)
        np.testing.assert_array_equal(capture.detector_m, description.detector_m)
        assert capture.bin_width_s == 4e-12
        np.testing.assert_array_equal(capture.first_bin_s, [1e-9])
        text = str(scan)
    assert "simulated, rig scan --seed 3" in text
    assert "37" in text
    with h5py.File(path) as file:
        assert file["stop"].attrs["photons"] == counts.sum()
        # HDF5's own filters must undo what the writer did by hand
        np.testing.assert_array_equal(file["transients/counts"][:, 0], counts)
        assert file["transients/counts"].attrs["description"] == "photons in each bin"


@pytest.mark.parametrize("dtype", ["u1", "u2", "u4", "u8", "f4"])
def test_all_types_of_counts(tmp_path, dtype):
    counts = draw().astype(dtype)
    path = write(tmp_path / "a.h5", describe(dtype=np.dtype(dtype)), counts)
    with ScanFile(path) as scan:
        np.testing.assert_array_equal(dense(scan.capture()), counts)
        assert scan.expectation == (dtype == "f4")


def test_blocks_can_be_a_part_of_the_bins(tmp_path):
    counts = draw()
    with ScanFile(write(tmp_path / "a.h5", describe(), counts)) as scan:
        parts = [block for _, block in scan.capture().histograms.blocks(slice(7, 20))]
    np.testing.assert_array_equal(np.concatenate(parts), counts[:, 7:20])


def test_blocks_are_small_and_follow_the_chunks(tmp_path):
    positions, bins = 200, 60_000
    path = tmp_path / "a.h5"
    with ScanWriter.create(path, describe(positions, bins)) as writer:
        for number in range(positions):
            writer.append(np.full(bins, number, "u4"))
    with ScanFile(path) as scan:
        blocks = list(scan.capture().histograms.blocks())
    assert len(blocks) > 1
    for where, block in blocks:
        assert where.start % 16 == 0
        assert block.nbytes <= BLOCK_BYTES
        np.testing.assert_array_equal(block[:, 0], np.arange(where.start, where.stop))


def test_rectified_time_subtracts_each_leg(tmp_path):
    legs = PathDelays(np.array([0.3, -0.5, 2.0]), np.array([-0.2, -0.4, 1.7]), electronics_delay_s=23e-9)
    description = describe(delays=legs, first_bin_s=40e-9)
    with ScanFile(write(tmp_path / "a.h5", description, draw())) as scan:
        assert scan.time_origin == "laser"
        first_bin_s = scan.capture().first_bin_s
    for position, spot in enumerate(description.laser_m):
        out_m = sum((spot[axis] - legs.laser_head_m[axis]) ** 2 for axis in range(3)) ** 0.5
        back_m = (
            sum((description.detector_m[0][axis] - legs.detector_head_m[axis]) ** 2 for axis in range(3))
            ** 0.5
        )
        expected_s = 40e-9 - 23e-9 - out_m / C_M_PER_S - back_m / C_M_PER_S
        # double precision on numbers of 40 ns leaves 1e-23 s; a femtosecond is far below any bin
        assert first_bin_s[position] == pytest.approx(expected_s, abs=1e-18)


def test_an_interrupted_file_gives_what_is_there_and_can_be_resumed(tmp_path):
    description, counts = describe(), draw()
    path = write(tmp_path / "a.h5", description, counts, measured=21)
    with ScanFile(path) as scan:
        assert scan.status == "interrupted"
        capture = scan.capture()
        assert capture.positions == 21
        np.testing.assert_array_equal(dense(capture), counts[:21])
        np.testing.assert_array_equal(capture.laser_m, description.laser_m[:21])
    with ScanWriter.resume(path) as writer:
        assert writer.appended == 21
        for row in counts[21:]:
            writer.append(row, 0.01)
    whole = write(tmp_path / "b.h5", description, counts)
    with h5py.File(path) as resumed, h5py.File(whole) as uninterrupted:
        for name in ("counts", "done", "live_time_s"):
            np.testing.assert_array_equal(
                resumed["transients"][name][()], uninterrupted["transients"][name][()]
            )
        assert resumed["stop"].attrs["photons"] == counts.sum()
        assert len(json.loads(resumed["start"].attrs["resumed"])) == 1


@pytest.mark.parametrize("kept", [0, 3, 15, 16, 17, 30, 32, 36, 37])
@pytest.mark.parametrize("measured", [33, 37])
@pytest.mark.parametrize("saved_at", [0, 20, 33])
def test_positions_taken_back_are_measured_again(tmp_path, kept, measured, saved_at):
    path, counts = tmp_path / "a.h5", draw()
    with ScanWriter.create(path, describe()) as writer:
        for number, row in enumerate(counts[:measured]):
            writer.append(row + np.uint32(number >= kept), 0.01)  # wrong from there on
            if number == saved_at:
                writer.checkpoint()
        writer.withdraw(kept)
        writer.close("failed", "the laser went dark")
    kept = min(kept, measured)
    with ScanFile(path) as scan:
        assert scan.done.sum() == kept
        assert np.isnan(scan.live_time_s[kept:]).all()
        if kept:
            assert (dense(scan.capture()) == counts[:kept]).all()
    with h5py.File(path) as file:
        assert file["stop"].attrs["photons"] == counts[:kept].sum()
    with ScanWriter.resume(path) as writer:
        assert writer.appended == kept
        for row in counts[kept:]:
            writer.append(row, 0.01)
    with ScanFile(path) as scan:
        assert scan.status == "complete"
        assert (dense(scan.capture()) == counts).all()


def test_a_complete_file_is_not_resumed(tmp_path):
    path = write(tmp_path / "a.h5", describe(), draw())
    with pytest.raises(UsageError, match="complete"):
        ScanWriter.resume(path)


def test_a_failure_is_recorded(tmp_path):
    path = tmp_path / "a.h5"
    writer = ScanWriter.create(path, describe())

    def run():
        with writer:
            writer.append(draw()[0])
            raise ZeroDivisionError("mirror")

    with pytest.raises(ZeroDivisionError):
        run()
    with ScanFile(path) as scan:
        assert scan.status == "failed"
        assert "mirror" in scan.reason
        assert scan.done.sum() == 1


def test_nothing_is_overwritten(tmp_path):
    path = tmp_path / "a.h5"
    path.write_bytes(b"precious")
    with pytest.raises(UsageError, match="exists"):
        ScanWriter.create(path, describe())
    assert path.read_bytes() == b"precious"


def test_a_failed_creation_leaves_no_file(tmp_path):
    path = tmp_path / "a.h5"
    with pytest.raises(TypeError):
        ScanWriter.create(path, describe(devices={"galvo": {"identity": object()}}))
    assert not path.exists()
    with pytest.raises(UsageError, match="cannot create"):
        ScanWriter.create(tmp_path / "nowhere" / "a.h5", describe())


def test_only_what_fits_is_appended(tmp_path):
    with ScanWriter.create(tmp_path / "a.h5", describe()) as writer:
        with pytest.raises(ValueError, match=r"\(1, 130\)"):
            writer.append(np.zeros(131, "u4"))
        with pytest.raises(TypeError):
            writer.append(np.full(130, 0.5))
        for row in draw():
            writer.append(row)
        with pytest.raises(ValueError, match="all its 37"):
            writer.append(draw()[0])


@pytest.mark.parametrize("blocks", [[37], [1, 16, 15, 5], [20, 0, 17]])
def test_steps_added_at_once_are_those_added_one_by_one(tmp_path, blocks):
    description, counts = describe(), draw()
    write(tmp_path / "one.h5", description, counts)
    with ScanWriter.create(tmp_path / "many.h5", description) as writer:
        for block in np.split(counts[:, None], np.cumsum(blocks)[:-1]):
            writer.extend(block)
        with pytest.raises(ValueError, match="already has all its 37 steps"):
            writer.extend(counts[:1, None])
        with pytest.raises(ValueError, match="does not accept"):
            writer.extend(counts[:1, None, 1:])
    with h5py.File(tmp_path / "one.h5") as one, h5py.File(tmp_path / "many.h5") as many:
        for name in ("counts", "done", "checksum"):
            np.testing.assert_array_equal(one["transients"][name], many["transients"][name])
    with ScanFile(tmp_path / "many.h5") as scan:
        assert scan.status == "complete"
        assert not scan.doubts


@pytest.mark.parametrize(("bins", "dtype"), [(2**20, "u4"), (2**20, "u8"), (2**19 + 1, "f8")])
def test_the_longest_histograms_that_are_read_can_be_written(tmp_path, bins, dtype):
    """A chunk of sixteen of them would be larger than the chunks that are read."""
    counts = np.ones((17, 1, bins), dtype)
    with ScanWriter.create(tmp_path / "a.h5", describe(17, bins, plan=None, dtype=dtype)) as writer:
        writer.extend(counts)
    with ScanFile(tmp_path / "a.h5") as scan:
        assert scan.photons == counts.size


@pytest.mark.parametrize(
    ("steps", "channels", "bins", "tagged"),
    [(2, 1, 2**20 + 1, False), (2**12 + 1, 2**12, 1, False), (2**12 + 1, 2**11, 1, True)],
    ids=["bins", "histograms", "photons"],
)
def test_what_would_be_too_large_to_be_read_is_not_written(tmp_path, steps, channels, bins, tagged):
    description = ScanDescription(
        np.zeros((steps, 3)), np.zeros((1, channels, 3)), bins, 4e-12, 0.0, tagged=tagged
    )
    with pytest.raises(UsageError, match=r"cannot write .*a\.h5: it would hold"):
        ScanWriter.create(tmp_path / "a.h5", description)
    with (
        pytest.raises(UsageError, match=r"cannot write .*a\.h5: it"),
        ScanWriter.whole(tmp_path / "a.h5", description),
    ):
        pass
    assert not list(tmp_path.iterdir())


def test_a_plan_that_is_too_long_to_be_read_is_not_written(tmp_path, monkeypatch):
    monkeypatch.setattr(start, "TEXT_BYTES", 300)
    spots = Spots(spots=tuple((0.01 * number, 0.0, 0.0) for number in range(37)))
    plan = ScanPlan(passes=(Pass(positions=spots, exposure_s=0.01),))
    with pytest.raises(UsageError, match="the plan lists 37 positions in"):
        ScanWriter.create(tmp_path / "a.h5", describe(plan=plan))
    assert not list(tmp_path.iterdir())


def test_steps_of_few_bins_do_not_make_many_chunks(tmp_path):
    """Each chunk costs the time of a hundred such steps."""
    steps, bins = 5000, 20
    counts = draw(steps, bins)[:, None]
    with ScanWriter.create(tmp_path / "a.h5", describe(steps, bins, plan=None)) as writer:
        writer.extend(counts)
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["transients/counts"].id.get_num_chunks() <= 50
        np.testing.assert_array_equal(file["transients/counts"], counts)


def test_digest_follows_the_content(tmp_path):
    one = write(tmp_path / "a.h5", describe(), draw())
    other = write(tmp_path / "b.h5", describe(), draw(seed=9))
    copy = tmp_path / "c.h5"
    copy.write_bytes(one.read_bytes())
    with ScanFile(one) as a, ScanFile(other) as b, ScanFile(copy) as c:
        assert a.digest == c.digest != b.digest


def minimal(path, **transients):
    """Write what the contract asks for, and no more, by h5py alone."""
    with h5py.File(path, "w") as file:
        file.attrs["format"] = "rig-scan"
        file.attrs["version"] = 1
        file["geometry/laser_m"] = np.zeros((4, 3))
        file["geometry/detector_m"] = np.zeros((1, 3))
        group = file.create_group("transients")
        group.attrs.update({"bin_width_s": 4e-12, "first_bin_s": 0.0, "time_origin": "wall"})
        for name, value in transients.items():
            group[name] = value
    return path


def test_time_tagged_equals_dense(tmp_path):
    counts = draw(4, 50)
    photons = np.concatenate([np.repeat(np.arange(50), row) for row in counts])
    offset = np.concatenate([[0], np.cumsum(counts.sum(axis=1))])
    one = minimal(tmp_path / "a.h5", counts=counts)
    for dtype in ("u1", "u2", "u8"):
        other = minimal(
            tmp_path / f"{dtype}.h5", photons=photons.astype(dtype), photon_offset=offset.astype("u8")
        )
        with h5py.File(other, "r+") as file:
            file["transients"].attrs["bins"] = 50
        with ScanFile(one) as a, ScanFile(other) as b:
            np.testing.assert_array_equal(dense(a.capture()), dense(b.capture()))
            assert b.tagged
            assert b.status == "interrupted"


def test_time_tagged_without_bins_ends_with_the_last_photon(tmp_path):
    path = minimal(
        tmp_path / "a.h5", photons=np.array([3, 8, 2], "u2"), photon_offset=np.array([0, 1, 1, 3, 3])
    )
    with ScanFile(path) as scan:
        assert scan.bins == 9
        assert dense(scan.capture()).tolist()[2] == [0, 0, 1, 0, 0, 0, 0, 0, 1]


@pytest.mark.parametrize(
    ("bins", "most"),
    [
        (6250, 0.82),  # all low bytes equally likely: they are stored plain, the high ones as 5 bits of 8
        (60, 0.45),  # 6 bits of 8 for the low bytes, 1 of 8 for the high ones, which are all the same
        (100_000, 0.60),  # bins of four bytes: two as they are, 1 bit of 8 for each of the others
    ],
)
def test_photons_are_stored_so_that_hdf5_unpacks_them(tmp_path, bins, most):
    rng = np.random.default_rng(3)
    steps = [rng.integers(0, bins, size) for size in rng.integers(0, 90_000, 37)]
    described = describe(bins=bins, tagged=True)
    with ScanWriter.create(tmp_path / "a.h5", described) as writer:
        for step in steps:
            writer.append_photons(step.astype("u4" if bins > 2**16 else "u2"), np.array([len(step)]))
        writer.close("complete")
    with h5py.File(tmp_path / "a.h5") as file:
        photons = file["transients/photons"]
        np.testing.assert_array_equal(photons[()], np.concatenate(steps))
        assert photons.id.get_storage_size() < most * photons.nbytes
    with ScanFile(tmp_path / "a.h5") as scan:
        assert not scan.altered.any()
