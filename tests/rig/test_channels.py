"""Several detector channels in one scan: kept apart in the file, pairs of spots where imaging begins."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from rig.files import ScanDescription, ScanFile, ScanWriter
from rig.model.config import built_in_with
from rig.model.delays import PathDelays
from rig.model.plan import ScanPlan
from rig.model.state import RigState
from support.scan_files import C_M_PER_S, dense

BINS = 30
CHANNELS = [
    {"name": "left", "input": 3, "spot": ["-20cm", "5cm", "0cm"], "delay": "0.7ns"},
    {"name": "middle", "input": 0, "spot": ["0cm", "0cm", "0cm"]},
    {"name": "right", "input": 1, "spot": ["30cm", "-10cm", "0cm"], "delay": "-1.1ns"},
]


def state_with(channels):
    return RigState(built_in_with({"channels": channels}))


def describe(state, plan, **changes):
    given = {
        "laser_m": plan.spots_m,
        "detector_m": np.array([[channel.spot_m for channel in state.channels]]),
        "bins": BINS,
        "bin_width_s": 4e-12,
        "first_bin_s": 40e-9,
        "delays": PathDelays(np.array([0.3, -0.5, 2.0]), np.array([-0.2, -0.4, 1.7]), 23e-9),
        "channels": state.channels,
        "plan": plan,
        "state": state,
    }
    return ScanDescription(**(given | changes))


def draw(steps, channels, seed=1):
    return np.random.default_rng(seed).poisson(0.5, (steps, channels, BINS)).astype("u4")


def write(path, description, counts):
    with ScanWriter.create(path, description) as writer:
        for row in counts:
            writer.append(row, 0.01)
    return path


def test_each_channel_keeps_its_counts_its_name_and_its_delay(tmp_path):
    state = state_with(CHANNELS)
    plan = ScanPlan.grid(state.config, columns=5, rows=4, spacing_m=0.1, skip_m=0.0)
    counts = draw(20, 3)
    with ScanFile(write(tmp_path / "a.h5", describe(state, plan), counts)) as scan:
        assert scan.channels == state.channels
        assert [channel.input for channel in scan.channels] == [3, 0, 1]
        np.testing.assert_array_equal(scan.counts(range(20)), counts)
        assert "3 channels" in str(scan)


def test_imaging_begins_with_pairs_of_spots_each_in_rectified_time(tmp_path):
    state = state_with(CHANNELS)
    plan = ScanPlan.grid(state.config, columns=5, rows=4, spacing_m=0.1, skip_m=0.0)
    counts = draw(20, 3)
    description = describe(state, plan)
    with ScanFile(write(tmp_path / "a.h5", description, counts)) as scan:
        capture = scan.capture()
        np.testing.assert_array_equal(dense(capture), counts.reshape(60, BINS))
        assert capture.round_trip
    pair = 0
    for spot_m in plan.spots_m:
        for channel in state.channels:
            assert capture.laser_m[pair] == pytest.approx(spot_m)
            assert capture.detector_m[pair] == pytest.approx(channel.spot_m)
            out_m = np.linalg.norm(spot_m - [0.3, -0.5, 2.0])
            back_m = np.linalg.norm(np.subtract(channel.spot_m, [-0.2, -0.4, 1.7]))
            expected_s = 40e-9 - 23e-9 - channel.delay_s - (out_m + back_m) / C_M_PER_S
            assert capture.first_bin_s[pair] == pytest.approx(expected_s, abs=1e-18)
            pair += 1


@pytest.mark.parametrize("channels", [1, 2, 16])
def test_an_interrupted_scan_of_many_channels_is_resumed(tmp_path, channels):
    described = [{"name": str(n), "input": n} for n in range(channels)]
    state = state_with(described)
    plan = ScanPlan.grid(state.config, columns=10, rows=3, spacing_m=0.1, skip_m=0.0)
    counts, path = draw(30, channels), tmp_path / "a.h5"
    with ScanWriter.create(path, describe(state, plan)) as writer:
        for row in counts[:17]:
            writer.append(row, 0.01)
        writer.checkpoint()
    with ScanWriter.resume(path) as writer:
        assert writer.appended == 17
        for row in counts[17:]:
            writer.append(row, 0.01)
    with ScanFile(path) as scan:
        np.testing.assert_array_equal(scan.counts(range(30)), counts)
        assert scan.photons == counts.sum()


def test_a_measured_delay_of_each_pair_stands_in_place_of_all_others(tmp_path):
    state = state_with(CHANNELS)
    plan = ScanPlan.grid(state.config, columns=2, rows=2, spacing_m=0.1, skip_m=0.0)
    delay_s = 1e-9 * np.arange(12.0).reshape(4, 3)
    path = write(tmp_path / "a.h5", describe(state, plan, delays=None, delay_s=delay_s), draw(4, 3))
    with ScanFile(path) as scan:
        assert scan.capture().first_bin_s == pytest.approx(40e-9 - delay_s.ravel(), abs=1e-20)


def test_time_tagged_photons_of_channels_are_read_pair_by_pair(tmp_path):
    counts = draw(4, 3)
    flat = counts.reshape(12, BINS)
    path = tmp_path / "tagged.h5"
    with h5py.File(path, "w") as file:
        file.attrs.update({"format": "rig-scan", "version": 2})
        file["geometry/laser_m"] = np.zeros((4, 3))
        file["geometry/detector_m"] = np.zeros((1, 3, 3))
        file["transients/photons"] = np.concatenate(
            [np.repeat(np.arange(BINS, dtype="u2"), row) for row in flat]
        )
        file["transients/photon_offset"] = np.append(0, np.cumsum(flat.sum(axis=1))).astype("u8")
        file["transients"].attrs.update(
            {"bin_width_s": 4e-12, "first_bin_s": 0.0, "time_origin": "wall", "bins": BINS}
        )
    with ScanFile(path) as scan:
        np.testing.assert_array_equal(dense(scan.capture()), flat)
        np.testing.assert_array_equal(scan.counts(range(1, 3)), counts[1:3])


def as_version_1(path, older):
    """Write a scan of one channel as programs wrote it before there were channels."""
    with h5py.File(path) as new, h5py.File(older, "w") as old:
        for name in new:
            if name not in {"channels", "transients", "geometry"}:
                new.copy(name, old)
        old.attrs.update(new.attrs)
        old.attrs["version"] = 1
        for group, flattened in (("geometry", "detector_m"), ("transients", "counts")):
            old.create_group(group).attrs.update(new[group].attrs)
            for name, dataset in new[group].items():
                values = dataset[()]
                old[group][name] = values[:, 0] if name == flattened else values
        grid = ScanPlan.from_json(new["start"].attrs["plan"], path).passes[0]
        old["start"].attrs["plan"] = (
            f'{{"columns": {grid.positions.columns}, "rows": {grid.positions.rows}, '
            f'"spacing_m": {grid.positions.spacing_m}, "exposure_s": {grid.exposure_s}, '
            '"detector_spot_m": [0.0, 0.0, 0.0], "skip_m": 0.0, "bins": 30, "bin_width_s": 4e-12}'
        )


def test_a_file_of_version_1_is_read_as_one_of_version_2(tmp_path):
    state = RigState(built_in_with({}))
    plan = ScanPlan.grid(state.config, columns=5, rows=4, spacing_m=0.1, skip_m=0.0)
    path = write(tmp_path / "new.h5", describe(state, plan), draw(20, 1))
    as_version_1(path, tmp_path / "old.h5")
    with ScanFile(path) as new, ScanFile(tmp_path / "old.h5") as old:
        assert (new.version, old.version) == (2, 1)
        assert old.plan == new.plan == plan
        assert old.state == new.state == state
        ours, theirs = new.capture(), old.capture()
        np.testing.assert_array_equal(dense(ours), dense(theirs))
        for name in ("laser_m", "detector_m", "first_bin_s"):
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
        np.testing.assert_array_equal(old.counts(range(20)), new.counts(range(20)))


def test_an_interrupted_file_of_version_1_is_resumed_as_what_it_is(tmp_path):
    state = RigState(built_in_with({}))
    plan = ScanPlan.grid(state.config, columns=5, rows=4, spacing_m=0.1, skip_m=0.0)
    counts = draw(20, 1)
    path = write(tmp_path / "new.h5", describe(state, plan), counts)
    older = tmp_path / "old.h5"
    as_version_1(path, older)
    with h5py.File(path) as new, h5py.File(older, "r+") as file:
        rows = new["transients/counts"].chunks[0]
        stored = file["transients/counts"][()]
        del file["transients/counts"], file["stop"]
        file["transients"].create_dataset(
            "counts", data=stored, chunks=(rows, BINS), compression="gzip", compression_opts=1, shuffle=True
        )
        file["transients/done"][7:] = False
    with ScanWriter.resume(older) as writer:
        assert writer.appended == 7
        for row in counts[7:]:
            writer.append(row, 0.01)
    with ScanFile(older) as scan:
        assert (scan.version, scan.status) == (1, "complete")
        np.testing.assert_array_equal(scan.counts(range(20)), counts)


ROW = Path(__file__).parents[2] / "configs" / "row.toml"
COARSE = ("--grid", "18x13", "--spacing", "10cm", "--exposure", "4ms")


def test_a_row_of_16_pixels_is_scanned_and_imaged(rig):
    """A point 1 m before the wall: every pixel sees it at its own time, all together show it there."""
    done = rig("scan", "--config", ROW, "--scene", "point", *COARSE, "--out", "row.h5")
    assert done.code == 0, done.err
    with ScanFile("row.h5") as scan:
        assert [channel.name for channel in scan.channels] == [f"pixel {n}" for n in range(1, 17)]
        capture = scan.capture()
        counts = dense(capture)
        assert capture.histograms.shape[0] == 16 * scan.steps
    point_m = np.array([0.0, 0.0, 1.0])
    path_m = np.linalg.norm(capture.laser_m - point_m, axis=1)
    path_m += np.linalg.norm(capture.detector_m - point_m, axis=1)
    times_s = capture.first_bin_s[:, None] + (np.arange(counts.shape[1]) + 0.5) * capture.bin_width_s
    near = np.abs(times_s - path_m[:, None] / C_M_PER_S) < 0.3e-9
    # 510 dark and ambient counts a second while the gate is open, 0.4 of the time, come at any time
    background = 510 * 0.4 * 4e-3 * len(counts)
    beside = counts.sum(dtype=float) - (counts * near).sum(dtype=float)
    assert abs(beside - background) < 5 * np.sqrt(background)
    each = (counts * near).reshape(-1, 16, counts.shape[1]).sum(axis=(0, 2))
    assert each.min() > 0.5 * each.max() > 100
    arguments = ("--wavelength", "24cm", "--depth", "0.6m:1.4m:4cm", "--out", "v.h5", "--json")
    done = rig("recon", "row.h5", *arguments)
    assert done.code == 0, done.err
    assert json.loads(done.out)["positions"] == len(counts)
    with h5py.File("v.h5") as volume:
        intensity = volume["volume/intensity"][()]
        z, y, x = np.unravel_index(intensity.argmax(), intensity.shape)
        found_m = [volume[f"volume/{axis}_m"][i] for axis, i in zip("xyz", (x, y, z), strict=True)]
    # the nearest voxel, 10 cm apart on the wall, and half a wavelength in depth
    assert np.abs(np.subtract(found_m, point_m)).max() <= 0.12
