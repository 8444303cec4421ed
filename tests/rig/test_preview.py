"""Quick pictures while parameters are tried: coarse, replaced, and without reading the scan again."""

import json
import os

import numpy as np
import pytest

import rig as rig_program
from rig.files import kept


@pytest.fixture(scope="module")
def letters(tmp_path_factory):
    path = tmp_path_factory.mktemp("letters") / "letters.h5"
    rig_program.scan(path, grid="24x18", spacing="8cm", exposure="10ms").close()
    return path


@pytest.fixture
def preview(rig, letters, tmp_path, monkeypatch):
    """Run ``rig recon --preview`` in a folder with the scan, with a place of its own to keep things."""
    monkeypatch.setenv("RIG_CACHE", str(tmp_path / "kept"))
    os.link(letters, tmp_path / "letters.h5")

    def run(*options):
        done = rig("recon", "letters.h5", "--preview", "--depth", "0.8m:1.7m:5cm", *options, "--json")
        assert done.code == 0, done.err
        return json.loads(done.out)

    return run


def test_another_wavelength_needs_no_reading(preview, tmp_path):
    first = preview("--wavelength", "30cm")
    picture = tmp_path / "letters-preview.png"
    before = picture.read_bytes()
    second = preview("--wavelength", "20cm")
    assert (first["read_s"] > 0, second["read_s"]) == (True, 0)
    assert picture.read_bytes() != before  # replaced, which is what it is for
    assert sorted(path.name for path in tmp_path.iterdir()) == ["kept", "letters-preview.png", "letters.h5"]
    assert second["wavelength_m"] == 0.2
    assert second["voxels"] == [24, 18, 19]
    third = preview("--wavelength", "4cm")
    assert third["wavelength_m"] == pytest.approx(0.16)
    assert third["wavelength_reason"] == "not 4 cm, since a preview's cells of 8 cm need a longer wavelength"


def test_what_is_kept_is_data_of_this_scan_alone(preview, tmp_path):
    whole = preview()
    (copy,) = (tmp_path / "kept").iterdir()
    assert whole["scan_digest"] in copy.name
    arrays, facts = kept.kept(copy.stem)
    copy.write_bytes(copy.read_bytes()[:1000])
    assert preview()["read_s"] > 0
    for counts, said in (
        (arrays["counts"], {**facts, "digest": "of another"}),
        (arrays["counts"], {**facts, "wavelength_m": "long"}),
        (arrays["counts"][:5], facts),
    ):
        kept.keep(copy.stem, {**arrays, "counts": counts}, said)
        assert preview()["read_s"] > 0


def test_where_nothing_can_be_kept_it_is_read_again(preview, tmp_path):
    (tmp_path / "kept").write_text("no folder")
    assert preview()["read_s"] > 0


def test_what_is_kept_is_bounded(tmp_path, monkeypatch):
    monkeypatch.setenv("RIG_CACHE", str(tmp_path))
    monkeypatch.setattr(kept, "MOST_BYTES", 30_000)
    for number in range(5):
        kept.keep(f"preview-{number}", {"counts": np.zeros(1000)}, {"number": number})
        os.utime(tmp_path / f"preview-{number}.npz", (number, number))
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) <= 30_000
    assert kept.kept("preview-4")[1] == {"number": 4}
    assert kept.kept("preview-0") is None


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--camera", "photo"), "so that --camera would have no effect"),
        (("--solver", "lct", "--snr", "1"), "so that --solver and --snr would have no effect"),
        (("--memory", "1GB"), "so that --memory would have no effect"),
        (("--out", "v.h5"), "a preview is only a picture: leave --out out, or --preview"),
        (("--image", "p.doc"), "cannot write the picture p.doc"),
        (("--depth", "90m:91m:1m"), "the record holds"),
    ],
)
def test_what_a_preview_does_not_do_is_refused(rig, letters, options, told, tmp_path, monkeypatch):
    monkeypatch.setenv("RIG_CACHE", str(tmp_path / "kept"))
    done = rig("recon", letters, "--preview", *options)
    assert done.code == 2
    assert told in done.err


def test_a_named_picture_is_not_replaced(preview, rig, tmp_path):
    preview("--image", "mine.png")
    assert rig("recon", "letters.h5", "--preview", "--image", "mine.png").code == 2
