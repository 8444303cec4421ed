"""A killed, truncated or foreign file gives right rows or a DataFileError; nothing else."""

import os
import signal
import struct
import subprocess
import sys
import textwrap
import time
import zlib
from pathlib import Path
from unittest.mock import patch

import h5py
import numpy as np
import pytest

from rig.errors import DataFileError
from rig.files import ScanDescription, ScanFile, ScanWriter, form_photons
from rig.files.blocks import read
from rig.files.form_counts import stored_crc
from rig.files.stored import StoredChunks
from rig.model.config import built_in
from rig.model.plan import ScanPlan
from support.thorough import THOROUGH

ROOT = Path(__file__).parents[2]
POSITIONS, BINS, LINE = 600, 400, 25
#: Many chunks in 600 positions of 200 photons each.
CHUNK_PHOTONS = 4096

#: A writer without end in sight: a line of positions between checkpoints, each line told on stdout.
WRITER = textwrap.dedent(
    f"""
    import sys
    import numpy as np
    from rig.files import ScanDescription, ScanWriter, form_photons

    def row(position):
        return np.random.default_rng([7, position]).poisson(0.5, {BINS}).astype("u4")

    path, mode, form = sys.argv[1:]
    if mode == "create":
        laser_m = np.zeros(({POSITIONS}, 3))
        laser_m[:, 0] = np.arange({POSITIONS})
        description = ScanDescription(
            laser_m, np.zeros((1, 3)), {BINS}, 4e-12, 0.0, tagged=form == "photons"
        )
        form_photons.CHUNK_PHOTONS = {CHUNK_PHOTONS}
        writer = ScanWriter.create(path, description)
    else:
        writer = ScanWriter.resume(path)
    print("line", flush=True)
    while writer.appended < writer.steps:
        writer.append(row(writer.appended), 0.01)
        if writer.appended % {LINE} == 0:
            writer.checkpoint()
            print("line", flush=True)
    writer.close("complete")
    """
)


def row(position):
    return np.random.default_rng([7, position]).poisson(0.5, BINS).astype("u4")


def kill_while_writing(path, mode, form, lines, delay_s):
    """Run the writer and kill it some microseconds after a line; return the lines that it told."""
    arguments = [sys.executable, "-c", WRITER, str(path), mode, form]
    with subprocess.Popen(
        arguments, cwd=ROOT, stdout=subprocess.PIPE, env=os.environ | {"PYTHONPATH": str(ROOT)}
    ) as run:
        told = 0
        for _ in range(lines):
            told += bool(run.stdout.readline())
        # a busy wait: the moment of the kill is what the test varies
        end = time.perf_counter() + delay_s
        while time.perf_counter() < end:
            pass
        run.send_signal(signal.SIGKILL)
        told += len(run.stdout.readlines())
    return told


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="this system has no SIGKILL")
@pytest.mark.parametrize("seed", range(4 if THOROUGH else 1))
@pytest.mark.parametrize("form", ["histograms", "photons"])
def test_a_killed_writer_leaves_no_wrong_row_and_can_be_resumed(tmp_path, form, seed):
    rng = np.random.default_rng(seed)
    path = tmp_path / "scan.h5"
    lines = kill_while_writing(path, "create", form, int(rng.integers(2, 12)), rng.uniform(0, 3e-3))
    promised = (lines - 1) * LINE
    for _ in range(2):
        with ScanFile(path) as scan:
            assert scan.status == "interrupted"
            done = np.flatnonzero(scan.done)
            # a rewritten chunk may take back the marks of its 15 first rows until the next checkpoint
            assert promised - 15 <= len(done)
            for where, block in scan.capture().histograms.blocks():
                for position, counts in zip(done[where], block, strict=True):
                    np.testing.assert_array_equal(counts, row(position))
        lines = kill_while_writing(path, "resume", form, int(rng.integers(1, 6)), rng.uniform(0, 3e-3))
        promised = len(done) // 16 * 16 + max(0, lines - 2) * LINE
    with ScanWriter.resume(path) as writer:
        while writer.appended < POSITIONS:
            writer.append(row(writer.appended), 0.01)
    with ScanFile(path) as scan:
        assert scan.tagged == (form == "photons")
        assert scan.status == "complete"
        (whole,) = [block for _, block in scan.capture().histograms.blocks()]
    np.testing.assert_array_equal(whole, [row(position) for position in range(POSITIONS)])


def good(folder, *, tagged):
    path = folder / "scan.h5"
    laser_m = np.random.default_rng(5).normal(size=(40, 3))
    plan = ScanPlan.grid(built_in(), columns=40, rows=1, skip_m=0.0)
    description = ScanDescription(laser_m, np.zeros((1, 3)), BINS, 4e-12, 0.0, plan=plan, tagged=tagged)
    with (
        patch.object(form_photons, "CHUNK_PHOTONS", CHUNK_PHOTONS),
        ScanWriter.create(path, description) as writer,
    ):
        for position in range(40):
            writer.append(row(position), 0.01)
    return path


@pytest.fixture(scope="module")
def healthy(tmp_path_factory):
    return good(tmp_path_factory.mktemp("healthy"), tagged=False)


@pytest.fixture(scope="module", params=["histograms", "photons"])
def either(request, tmp_path_factory):
    """A file of either form."""
    return good(tmp_path_factory.mktemp("either"), tagged=request.param == "photons")


def read_all(path):
    with ScanFile(path) as scan:
        str(scan)
        _ = scan.plan, scan.state
        blocks = [block for _, block in scan.capture().histograms.blocks()]
        return np.concatenate(blocks), scan.laser_m


def test_a_file_cut_at_any_length_is_refused(either, tmp_path):
    content = either.read_bytes()
    path = tmp_path / "cut.h5"
    lengths = {0, 1, 8, 96, 512, 2048, len(content) - 1} | set(range(100, len(content), len(content) // 60))
    for length in lengths:
        path.write_bytes(content[:length])
        with pytest.raises(DataFileError, match=r"cut\.h5"):
            read_all(path)


def test_a_damaged_file_never_ends_in_a_traceback(either, tmp_path):
    content = either.read_bytes()
    path = tmp_path / "damaged.h5"
    rng = np.random.default_rng(11)
    refused = []
    for _ in range(150 if THOROUGH else 60):
        damaged = bytearray(content)
        start = int(rng.integers(len(content)))
        size = int(rng.choice([1, 8, 200, 4000]))
        damaged[start : start + size] = rng.bytes(min(size, len(content) - start))
        path.write_bytes(damaged)
        try:
            read_all(path)
        except DataFileError as error:
            refused.append(str(error))
    assert len(refused) > 6
    assert all("damaged.h5" in said for said in refused)


def test_a_damaged_chunk_is_noticed(healthy, tmp_path):
    path = tmp_path / "chunk.h5"
    content = bytearray(healthy.read_bytes())
    with h5py.File(healthy) as file:
        chunk = file["transients/counts"].id.get_chunk_info(1)
    content[chunk.byte_offset + chunk.size // 2] ^= 0x10
    path.write_bytes(content)
    with ScanFile(path) as scan:
        assert "positions 16 to 31 changed after they were written" in scan.doubts[0]
        assert np.flatnonzero(~scan.done).tolist() == list(range(16, 32))
    others = [row(position) for position in (*range(16), *range(32, 40))]
    np.testing.assert_array_equal(read_all(path)[0], others)
    with h5py.File(path, "r+") as file:  # as in a file of an older program
        del file["transients/checksum"]
    with pytest.raises(DataFileError, match="damaged"):
        read_all(path)


def test_a_chunk_that_claims_to_be_longer_than_a_chunk_is_refused(tmp_path):
    """Of data that is not packed the library makes room for a chunk, and reads what the file says."""
    path = good(tmp_path, tagged=True)
    said = key_of_the_first_chunk(path, "transients/checksum")
    claimed = struct.unpack_from("<I", said)[0] + 187
    replace_once(path, said, struct.pack("<I", claimed) + said[4:])
    with pytest.raises(
        DataFileError, match=f"transients/checksum has a chunk of {claimed} bytes that claims"
    ):
        ScanFile(path)
    with h5py.File(path) as file:
        checksum = file["transients/checksum"]
        for reader in (read, lambda dataset: StoredChunks(dataset).packed((0,))):
            with pytest.raises(DataFileError, match=f"{claimed} bytes of"):
                reader(checksum)
        assert stored_crc(StoredChunks(checksum), (0,)) is None


def test_it_is_found_also_where_the_index_of_chunks_leads_nowhere(tmp_path):
    """What asks an object for its place walks the index of its chunks, and would not look at it any more."""
    path = good(tmp_path, tagged=True)
    said = key_of_the_first_chunk(path, "transients/checksum")
    node = b"TREE" + bytes([1, 0]) + struct.pack("<H", 1)  # of chunks, a leaf, with one chunk
    at = path.read_bytes().rindex(node, 0, path.read_bytes().index(said))
    replace_once(path, said, struct.pack("<I", struct.unpack_from("<I", said)[0] + 187) + said[4:])
    content = bytearray(path.read_bytes())
    content[at + 16 : at + 24] = struct.pack("<Q", 2**62 + 123)  # the node to its right, which there is not
    path.write_bytes(content)
    with h5py.File(path) as file, pytest.raises(RuntimeError):
        h5py.h5o.get_info(file["transients"].id, b"checksum")
    with pytest.raises(DataFileError, match="transients/checksum has a chunk of"):
        ScanFile(path)


def key_of_the_first_chunk(path, name):
    """Return what HDF5's B-tree says of the first chunk of a dataset of one axis: size, place, address."""
    with h5py.File(path) as file:
        chunk = file[name].id.get_chunk_info(0)
    return struct.pack("<IIQQQ", chunk.size, 0, 0, 0, chunk.byte_offset)


def replace_once(path, old, new):
    content = path.read_bytes()
    assert content.count(old) == 1
    path.write_bytes(content.replace(old, new))


def test_truth_values_are_unpacked_and_held_against_their_size_as_numbers_are(tmp_path):
    done = np.arange(100) % 3 == 0
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, options in {"plain": {}, "packed": {"compression": "gzip", "shuffle": True}}.items():
            file.create_dataset(name, data=done, chunks=(64,), **options)
            assert np.array_equal(read(file[name], slice(10, 90)), done[10:90])
        short = zlib.compress(bytes(40))
        file["packed"].id.write_direct_chunk((0,), short)
        file["plain"].id.write_direct_chunk((0,), bytes([7]) * 64)
    with h5py.File(tmp_path / "a.h5") as file:
        assert read(file["plain"])[:64].sum() == 64  # whatever is not 0 is true
        with pytest.raises(DataFileError, match="40 bytes of 64"):
            read(file["packed"])


def test_other_files_are_refused_by_what_they_are(tmp_path):
    text = tmp_path / "a.txt"
    text.write_text("hello")
    with pytest.raises(DataFileError, match="not an HDF5 file"):
        ScanFile(text)
    with pytest.raises(DataFileError, match="does not exist"):
        ScanFile(tmp_path / "none.h5")
    with pytest.raises(DataFileError, match="is a folder, not a file"):
        ScanFile(tmp_path)
    foreign = tmp_path / "b.h5"
    with h5py.File(foreign, "w") as file:
        file["H"] = np.zeros(3)
    with pytest.raises(DataFileError, match=r"no format attribute.*holds H.*rig import"):
        ScanFile(foreign)


def change(healthy, path, edit):
    path.write_bytes(healthy.read_bytes())
    with h5py.File(path, "r+") as file:
        edit(file)
    return path


def drop_attribute(group, name):
    return lambda file: file[group].attrs.pop(name)


def set_attribute(group, name, value):
    return lambda file: file[group].attrs.__setitem__(name, value)


def replace(path, value):
    def edit(file):
        del file[path]
        file[path] = value

    return edit


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (drop_attribute("transients", "bin_width_s"), "/transients@bin_width_s is missing"),
        (drop_attribute("transients", "time_origin"), "/transients@time_origin is missing"),
        (drop_attribute("/", "version"), "version None"),
        (set_attribute("/", "version", 3), "reads version 1 and 2"),
        (set_attribute("/", "format", "rig-volume"), "is a volume, but a scan is needed"),
        (set_attribute("transients", "time_origin", "moon"), "must be 'wall' or 'laser'"),
        (set_attribute("transients", "time_origin", "laser"), "lacks the attributes laser_head_m"),
        (set_attribute("transients", "bin_width_s", -1.0), "must be positive"),
        (set_attribute("transients", "bin_width_s", float("nan")), "finite"),
        (set_attribute("transients", "bin_width_s", "4ps"), "bin_width_s is '4ps', not number"),
        (lambda file: file.pop("geometry/laser_m"), "/geometry/laser_m is missing"),
        (lambda file: file.pop("geometry"), "/geometry is missing"),
        (lambda file: file.pop("transients/counts"), "it has neither"),
        (replace("geometry/laser_m", np.zeros((39, 3))), "/transients/counts has shape"),
        (replace("geometry/laser_m", np.full((40, 3), np.nan)), "not a number"),
        (replace("geometry/detector_m", np.zeros((7, 1, 3))), r"/geometry/detector_m has shape \(7, 1, 3\)"),
        (replace("geometry/detector_m", np.zeros((1, 1, 2))), "/geometry/detector_m has shape"),
        (replace("transients/counts", np.zeros((40, 1, BINS))), "unsigned integers"),
        (replace("transients/counts", np.zeros((40, 2, BINS), "u4")), "/transients/counts has shape"),
        (replace("channels/delay_s", np.zeros(2)), "/channels/delay_s has shape"),
        (replace("transients/counts", np.zeros(40, "u4")), "/transients/counts has shape"),
        (replace("transients/counts", h5py.Empty("f")), "/transients/counts is not a dataset"),
        (replace("transients/done", np.ones(3, bool)), "/transients/done has shape"),
        (replace("transients/done", np.zeros(40, bool)), "no measured position"),
        (lambda file: file.__setitem__("transients/photons", np.zeros(5, "u2")), "either"),
        (set_attribute("start", "plan", 5), "start@plan is 5"),
        (set_attribute("start", "plan", '{"columns": 3}'), "its plan cannot be read"),
        (set_attribute("start", "plan", "5"), "its plan cannot be read"),
    ],
)
def test_what_is_wrong_is_named(healthy, tmp_path, edit, said):
    path = change(healthy, tmp_path / "changed.h5", edit)
    with pytest.raises(DataFileError, match=said) as caught:
        read_all(path)
    assert "changed.h5" in str(caught.value)


@pytest.mark.parametrize(
    ("photons", "offset", "said"),
    [
        ([1, 2, 3], [0, 1, 1, 1, 2], "must rise from 0 to the 3 photons"),
        ([1, 2, 3], [0, 2, 1, 3, 3], "must rise"),
        ([1, 2, 3], [0, 1, 3], "photon_offset has shape"),
        ([1, 2, 30], [0, 1, 1, 1, 3], "bin 30 of 20 bins"),
    ],
)
def test_wrong_photon_lists_are_named(tmp_path, photons, offset, said):
    path = tmp_path / "tagged.h5"
    with h5py.File(path, "w") as file:
        file.attrs.update({"format": "rig-scan", "version": 1})
        file["geometry/laser_m"] = np.zeros((4, 3))
        file["geometry/detector_m"] = np.zeros((1, 3))
        file["transients/photons"] = np.array(photons, "u2")
        file["transients/photon_offset"] = np.array(offset, "u8")
        file["transients"].attrs.update(
            {"bin_width_s": 4e-12, "first_bin_s": 0.0, "time_origin": "wall", "bins": 20}
        )
    with pytest.raises(DataFileError, match=said):
        read_all(path)
