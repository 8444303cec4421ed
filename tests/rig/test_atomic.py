"""A result appears whole or not at all, and never in the place of what another program made meanwhile."""

import os

import numpy as np
import pytest

from rig.atomic import appearing
from rig.errors import UsageError
from rig.files import ScanDescription, ScanFile, ScanWriter


def no_links(source, target):
    raise PermissionError(1, "Operation not permitted", str(source))


@pytest.fixture(params=["links", "no links"])
def disk(request, monkeypatch):
    if request.param == "no links":  # as on a stick with FAT
        monkeypatch.setattr(os, "link", no_links)


@pytest.mark.usefixtures("disk")
def test_what_another_program_made_meanwhile_is_kept(tmp_path):
    path = tmp_path / "a.txt"
    (tmp_path / "a-2.txt").write_text("older")

    def written():
        with appearing(path, replaces=False) as partial:
            partial.write_text("ours")
            path.write_text("theirs")

    with pytest.raises(UsageError, match=r"a\.txt is there already.* this result is .*a-3\.txt"):
        written()
    assert {one.name: one.read_text() for one in tmp_path.iterdir()} == {
        "a.txt": "theirs",
        "a-2.txt": "older",
        "a-3.txt": "ours",
    }


@pytest.mark.usefixtures("disk")
@pytest.mark.parametrize(("before", "replaces"), [("", False), ("", True), ("old", True)])
def test_a_result_is_whole_or_as_it_was(tmp_path, before, replaces):
    path = tmp_path / "a.txt"
    if before:
        path.write_text(before)

    def half():
        with appearing(path, replaces=replaces) as partial:
            partial.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        half()
    assert path.exists() == bool(before)
    with appearing(path, replaces=replaces) as partial:
        partial.write_text("new")
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


def test_an_import_does_not_replace_a_scan_that_began_meanwhile(tmp_path):
    path, counts = tmp_path / "a.h5", np.ones((2, 1, 9), "u4")
    description = ScanDescription(np.zeros((2, 3)), np.zeros((1, 3)), 9, 4e-12, 0.0)

    def imported_while_one_measures():
        with ScanWriter.whole(path, description) as imported:
            with ScanWriter.create(path, description) as measured:
                measured.extend(3 * counts)
            imported.extend(counts)

    with pytest.raises(UsageError, match=r"this result is .*a-2\.h5"):
        imported_while_one_measures()
    with ScanFile(path) as measured, ScanFile(tmp_path / "a-2.h5") as imported:
        assert (measured.photons, imported.photons) == (54, 18)
