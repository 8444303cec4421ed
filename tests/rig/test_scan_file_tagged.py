"""The time-tagged form of a scan file holds what was given, in order, and is read as histograms are."""

import shutil
from unittest.mock import patch

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rig.errors import DataFileError
from rig.files import ScanDescription, ScanFile, ScanWriter, form_photons
from rig.image.drawing import Drawing
from rig.image.reconstruct import reconstruct
from rig.image.request import Request
from support.scan_files import dense
from support.tagged_scans import photons_of, write_tagged

STEPS, BINS = 12, 30


def describe(steps=STEPS, channels=1, bins=BINS, **changes):
    detector_m = np.zeros((1, channels, 3))
    return ScanDescription(np.zeros((steps, 3)), detector_m, bins, 4e-12, 0.0, tagged=True, **changes)


def create(path, description, chunk=16):
    with patch.object(form_photons, "CHUNK_PHOTONS", chunk):  # so that few photons are of many chunks
        return ScanWriter.create(path, description)


class Model:
    """What a file is to hold: photons and their number by channel, step by step."""

    def __init__(self, channels, seed):
        self.channels, self.rng = channels, np.random.default_rng(seed)
        self.photons, self.of_channel = [], []

    def step(self, most):
        """Draw a further step."""
        of_channel = self.rng.integers(0, most + 1, self.channels)
        self.photons.append(self.rng.integers(0, BINS, of_channel.sum()).astype("u2"))
        self.of_channel.append(of_channel)
        return self.photons[-1], of_channel

    def cut(self, first):
        del self.photons[first:], self.of_channel[first:]

    def counts(self, steps):
        counts = np.zeros((steps, self.channels, BINS), int)
        for step in range(steps):
            channel = np.repeat(np.arange(self.channels), self.of_channel[step])
            np.add.at(counts[step], (channel, self.photons[step]), 1)
        return counts

    def assert_in(self, path):
        """All steps of the model are in a closed file, and nothing else."""
        with h5py.File(path) as file:
            transients = file["transients"]
            together = np.concatenate([*self.photons, np.zeros(0, "u2")])
            np.testing.assert_array_equal(transients["photons"][()], together)
            offset = np.cumsum([0, *np.ravel(self.of_channel)])
            np.testing.assert_array_equal(transients["photon_offset"][: len(offset)], offset)
            assert (transients["photon_offset"][len(offset) :] == len(together)).all()
            done = transients["done"][()]
            assert done[: len(self.photons)].all()
            assert not done[len(self.photons) :].any()
            assert len(transients["checksum"]) == -(-len(together) // transients["photons"].chunks[0])

    def assert_marked_in(self, path):
        """Steps that are marked in a file that is being written have their photons there."""
        with h5py.File(path, "r") as file:
            transients, channels = file["transients"], self.channels
            for step in np.flatnonzero(transients["done"][()]).tolist():
                edges = transients["photon_offset"][step * channels : (step + 1) * channels + 1].astype(int)
                np.testing.assert_array_equal(np.diff(edges), self.of_channel[step])
                np.testing.assert_array_equal(transients["photons"][edges[0] : edges[-1]], self.photons[step])


actions = st.lists(
    st.one_of(
        st.tuples(st.just("append"), st.sampled_from([0, 1, 5, 16, 40])),
        st.tuples(st.just("checkpoint"), st.just(0)),
        st.tuples(st.just("withdraw"), st.integers(0, STEPS)),
        st.tuples(st.just("resume"), st.just(0)),
    ),
    max_size=30,
)


@settings(max_examples=25, deadline=None)
@given(actions, st.sampled_from([1, 2, 3]), st.sampled_from([8, 16, 64]), st.integers(0, 99))
def test_whatever_is_done_the_file_holds_what_was_given(tmp_path_factory, todo, channels, chunk, seed):
    folder = tmp_path_factory.mktemp("any")
    path, model = folder / "scan.h5", Model(channels, seed)
    writer = create(path, describe(channels=channels), chunk)
    for action, number in todo:
        if action == "append" and writer.appended < STEPS:
            writer.append_photons(*model.step(number), 0.01)
        elif action == "checkpoint":
            writer.checkpoint()
            assert writer.safe == writer.appended
            shutil.copy2(path, folder / "copy.h5")  # as another program sees it meanwhile
            model.assert_marked_in(folder / "copy.h5")
        elif action == "withdraw":
            writer.withdraw(number)
            model.cut(number)
        elif action == "resume" and writer.appended < STEPS:
            writer.close("interrupted")
            model.assert_in(path)
            writer = ScanWriter.resume(path)
        assert writer.appended == len(model.photons)
    writer.close("interrupted")
    model.assert_in(path)
    with ScanFile(path) as scan:
        assert scan.tagged
        assert scan.photons == sum(map(len, model.photons))
        assert not scan.altered.any()
        measured = len(model.photons)
        np.testing.assert_array_equal(scan.counts(range(STEPS))[:measured], model.counts(measured))
        if measured:
            np.testing.assert_array_equal(dense(scan.capture()), model.counts(measured).reshape(-1, BINS))


@pytest.fixture
def written(tmp_path):
    """A file of one channel with 12 steps, and what it holds."""
    model = Model(1, 5)
    with create(tmp_path / "scan.h5", describe()) as writer:
        for _ in range(STEPS):
            writer.append_photons(*model.step(20), 0.01)
    return tmp_path / "scan.h5", model


def test_counts_are_listed_in_the_order_of_their_bins(tmp_path):
    counts = np.random.default_rng(2).poisson(0.4, (STEPS, 2, BINS)).astype("u4")
    with create(tmp_path / "a.h5", describe(channels=2)) as writer:
        for row in counts:
            writer.append(row, 0.01)
        with pytest.raises(ValueError, match="all its 12"):
            writer.append(counts[0])
    with ScanFile(tmp_path / "a.h5") as scan:
        np.testing.assert_array_equal(scan.counts(range(STEPS)), counts)
        assert scan.photons == counts.sum()
    with create(tmp_path / "b.h5", describe()) as writer:
        with pytest.raises(ValueError, match=r"counts must be \(1, 30\)"):
            writer.append(np.zeros(31, "u4"))
        with pytest.raises(TypeError, match="whole numbers"):
            writer.append(np.full(BINS, 0.5))


@pytest.mark.parametrize(
    ("photons", "of_channel", "said"),
    [
        (np.array([1, 30]), [2, 0], "0 to 29, not 1 to 30"),
        (np.array([-1, 3]), [2, 0], "0 to 29, not -1 to 3"),
        (np.array([1.0, 3.0]), [2, 0], "whole numbers"),
        (np.array([1, 3]), [2, 1], r"must be \(3,\)"),
        (np.array([1, 3]), [2], "photons of 2 channels"),
        (np.array([1, 3]), [3, -1], "photons of 2 channels"),
        (np.array([[1, 3]]), [1, 1], r"must be \(2,\)"),
    ],
)
def test_only_photons_that_fit_are_appended(tmp_path, photons, of_channel, said):
    with create(tmp_path / "a.h5", describe(channels=2)) as writer:
        with pytest.raises(ValueError, match=said):
            writer.append_photons(photons, np.array(of_channel))
        assert writer.appended == 0
        writer.append_photons(np.array([1, 29], "u1"), np.array([1, 1], "u2"))
    with ScanFile(tmp_path / "a.h5") as scan:
        assert scan.counts(range(1)).sum(axis=2).tolist() == [[1, 1]]


def test_a_file_of_histograms_takes_no_photons(tmp_path):
    description = ScanDescription(np.zeros((2, 3)), np.zeros((1, 3)), BINS, 4e-12, 0.0)
    with (
        ScanWriter.create(tmp_path / "a.h5", description) as writer,
        pytest.raises(ValueError, match="holds histograms"),
    ):
        writer.append_photons(np.array([1]), np.array([1]))
    with pytest.raises(ValueError, match="expectation values cannot be listed as photons"):
        describe(dtype="f4")


@pytest.mark.parametrize(("bins", "dtype"), [(2**16, "u2"), (2**16 + 1, "u4")])
def test_bins_take_no_more_bytes_than_they_need(tmp_path, bins, dtype):
    with create(tmp_path / "a.h5", describe(bins=bins)) as writer:
        for step in range(STEPS):
            writer.append_photons(np.array([bins - 1 - step] * 3), np.array([3]))
    with ScanFile(tmp_path / "a.h5") as scan:
        assert scan.counts(range(3, 4))[0, 0, bins - 4] == 3
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["transients/photons"].dtype == dtype


def test_no_photon_at_all_is_a_measurement(tmp_path):
    with create(tmp_path / "a.h5", describe()) as writer:
        for _ in range(STEPS):
            writer.append_photons(np.zeros(0, "u2"), np.zeros(1, int), 0.01)
            writer.checkpoint()
    with ScanFile(tmp_path / "a.h5") as scan:
        assert scan.done.all()
        assert dense(scan.capture()).sum() == 0


def test_what_is_said_of_steps_that_are_not_measured_is_not_trusted(written):
    path, model = written
    with h5py.File(path, "r+") as file:
        file["transients/done"][4:7] = False
        file["transients/photon_offset"][5:7] = [2**40, 3]
        del file["transients/step_checksum"]  # as in a file of another program
    with ScanFile(path) as scan:
        expected = model.counts(STEPS)
        expected[4:7] = 0
        np.testing.assert_array_equal(scan.counts(range(STEPS)), expected)
        assert len(dense(scan.capture())) == STEPS - 3


@pytest.mark.parametrize("entry", [0, 5, 12])
def test_an_altered_offset_is_noticed_at_the_steps_to_which_it_belongs(written, entry):
    path, model = written
    with h5py.File(path, "r+") as file:
        file["transients/photon_offset"][entry] += 1
    wrong = sorted({max(entry - 1, 0), min(entry, STEPS - 1)})
    with ScanFile(path) as scan:
        assert np.flatnonzero(scan.altered).tolist() == wrong
        right = np.setdiff1d(np.arange(STEPS), wrong)
        np.testing.assert_array_equal(dense(scan.capture()), model.counts(STEPS)[right, 0])
    with ScanWriter.resume(path) as writer:
        assert writer.appended == wrong[0]
        for step in range(wrong[0], STEPS):
            writer.append_photons(model.photons[step], model.of_channel[step])
    model.assert_in(path)


def test_photons_that_were_never_written_are_not_measured(written):
    path, model = written
    with h5py.File(path, "r+") as file:
        photons, transients = len(file["transients/photons"]), file["transients"]
        transients["photons"].resize((0,))
        transients["photons"].resize((photons,))
    with ScanFile(path) as scan:
        assert scan.altered.tolist() == [len(photons) > 0 for photons in model.photons]
    with h5py.File(path, "r+") as file:
        del file["transients/checksum"]
    with pytest.raises(DataFileError, match="bytes of photons were measured, but chunks of 0 bytes"):
        ScanFile(path)


@pytest.mark.parametrize("measured", [None, 17])
def test_images_of_both_forms_are_the_same(tmp_path, measured):
    rng = np.random.default_rng(7)
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 6), np.linspace(-0.4, 0.4, 5))
    laser_m = np.column_stack([x.ravel(), y.ravel(), np.zeros(30)])
    description = ScanDescription(laser_m, np.array([[0.1, 0.0, 0.0]]), 3000, 16e-12, 0.0)
    one, other = tmp_path / "counts.h5", tmp_path / "photons.h5"
    with ScanWriter.create(one, description) as writer:
        for _ in range(30 if measured is None else measured):
            writer.append(rng.poisson(0.05, 3000).astype("u4"), 0.01)
    with patch.object(form_photons, "CHUNK_PHOTONS", 1000):
        write_tagged(one, other, measured)
    images = [
        reconstruct(
            path, Request(), path.with_suffix(".volume.h5"), Drawing(path.with_suffix(".png"))
        ).volume.intensity
        for path in (one, other)
    ]
    np.testing.assert_array_equal(*images)


def test_photons_keep_the_order_in_which_they_came(tmp_path):
    rng = np.random.default_rng(3)
    photons, of_channel = photons_of(rng.poisson(3.0, (2, BINS)), rng)
    with create(tmp_path / "a.h5", describe(steps=1, channels=2)) as writer:
        writer.append_photons(photons, of_channel)
    with h5py.File(tmp_path / "a.h5") as file:
        np.testing.assert_array_equal(file["transients/photons"][()], photons)
