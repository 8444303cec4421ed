"""Published measurements are fetched whole and as they were, or not at all; here from addresses on disk."""

import hashlib

import numpy as np
import pytest
import scipy.io

from support.fetch_published import SCENES, FetchError, Scene, fetch
from support.published import DATA, published
from support.scan_files import load


@pytest.fixture
def served(tmp_path):
    """A folder of published files, and the scene that it holds."""
    path = tmp_path / "served" / "lct" / "a.mat"
    path.parent.mkdir(parents=True)
    scipy.io.savemat(path, {"rect_data": np.arange(2400.0).reshape(2, 3, 400), "width": 0.5})
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    return path, Scene({"lct/a.mat": (path.as_uri(), digest)}, ("--bin-width", "4ps"))


def files_in(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def test_a_scene_is_fetched_and_imported_once(served, tmp_path):
    path, scene = served
    scan = fetch("a", scene, tmp_path / "data")
    assert files_in(tmp_path / "data") == ["original/lct/a.mat", "scans/a.h5"]
    _, counts = load(scan)
    assert sorted(counts.ravel()) == list(range(2400))
    path.unlink()  # what is there is not asked for again
    assert fetch("a", scene, tmp_path / "data") == scan


def test_another_place_may_hold_the_files(served, tmp_path):
    _, scene = served
    moved = {name: ("file:///nowhere", digest) for name, (_, digest) in scene.files.items()}
    fetch("a", Scene(moved, scene.importing), tmp_path / "data", (tmp_path / "served").as_uri())
    assert files_in(tmp_path / "data") == ["original/lct/a.mat", "scans/a.h5"]


def test_a_file_that_changed_is_refused_and_not_kept(served, tmp_path):
    path, scene = served
    path.write_bytes(path.read_bytes() + b" ")
    with pytest.raises(FetchError, match="another file than it was"):
        fetch("a", scene, tmp_path / "data")
    assert files_in(tmp_path) == ["served/lct/a.mat"]


def test_what_cannot_be_fetched_or_imported_is_named(served, tmp_path):
    path, scene = served
    with pytest.raises(FetchError, match=r"refused .*a\.mat: .*--bin-width"):
        fetch("a", Scene(scene.files), tmp_path / "data")
    path.unlink()
    with pytest.raises(FetchError, match=r"a\.mat cannot be fetched: .* give --from"):
        fetch("a", scene, tmp_path / "other")


@pytest.mark.parametrize("name", SCENES)
def test_the_digests_are_those_of_the_published_files(name):
    for path, (_, digest) in SCENES[name].files.items():
        assert hashlib.sha256(published(f"original/{path}").read_bytes()).hexdigest() == digest


def test_originals_come_from_the_disk_through_digest_and_import(tmp_path):
    published("original/xiao18m/4.mat")
    scan = fetch("xiao18m_L", SCENES["xiao18m_L"], tmp_path, (DATA / "original").as_uri())
    capture, counts = load(scan)
    assert counts.shape == (32 * 32, 512)
    assert np.ptp(capture.laser_m[:, 0]) == pytest.approx(0.82)
