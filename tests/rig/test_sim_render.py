"""``rig sim render``: the file holds what the transport computes, and the other verbs take it."""

import json

import h5py
import numpy as np
import pytest

from rig.bench.simulated import true_geometry
from rig.files.scan import ScanFile
from rig.model.config import built_in_with
from simulators.detector import Detector
from simulators.optics.light import Optics
from simulators.scenes import scene
from simulators.transport.renderer import Transport

TINY = ("--grid", "9x8", "--spacing", "20cm", "--bin-width", "32ps", "--bins", "1800")


@pytest.mark.parametrize("bounces", [3, 4])
def test_the_file_holds_the_expected_transients(rig, bounces):
    """72 positions are more than one block; float32 keeps 24 bits, and a bin that is rounded once 6e-8."""
    done = rig("sim", "render", "letter-plane", "out.h5", *TINY, "--bounces", bounces, "--json")
    assert done.code == 0, done.err
    result = json.loads(done.out)
    with h5py.File("out.h5") as file:
        assert file["transients/counts"].attrs["kind"] == "expectation"
        assert file["transients"].attrs["time_origin"] == "wall"
        written, laser_m = file["transients/counts"][:, 0], file["geometry/laser_m"][()]
        assert file["transients/done"][()].all()
    built, optics = scene("letter-plane"), Optics()
    expected = Transport.of_scene(built, bounces=bounces, wall_albedo=optics.wall_albedo)
    expected = expected.transients(laser_m, np.zeros((1, 3)), 32e-12 * np.arange(1801))
    head_m = true_geometry(built_in_with({})).detector_head_m
    per_m2 = optics.photons_per_s * optics.collection_m2(head_m, (0.0, 0.0, 0.0)) * Detector().efficiency
    power, exposure_s = 1.0, 10e-3
    np.testing.assert_allclose(written, per_m2 * power * exposure_s * expected, rtol=1e-6, atol=1e-30)
    assert result["positions"] == len(written) == 72
    assert result["expected"] == pytest.approx(written.sum(dtype=float), rel=1e-6)


def test_gloss_is_chosen_for_all_surfaces(rig):
    """Without the option each surface has its own model, which in the built-in scenes is Ward's."""
    written = {}
    for model in (None, "ward", "ggx"):
        chosen = ("--gloss", model) if model else ()
        out = f"{model}.h5"
        assert rig("sim", "render", "point", out, *TINY, "--roughness", "0.3", *chosen).code == 0
        with h5py.File(out) as file:
            written[model] = file["transients/counts"][:, 0]
            laser_m = file["geometry/laser_m"][()]
    assert np.array_equal(written[None], written["ward"])
    assert not np.allclose(written["ggx"], written["ward"], rtol=0.05)
    glossy = scene("point").with_roughness(0.3).with_gloss("ggx")
    expected = Transport.of_scene(glossy).transients(laser_m, np.zeros((1, 3)), 32e-12 * np.arange(1801))
    unit = written["ggx"].sum() / expected.sum()
    np.testing.assert_allclose(written["ggx"], unit * expected, rtol=1e-6, atol=1e-30)
    refused = rig("sim", "render", "point", "out.h5", *TINY, "--gloss", "phong")
    assert refused.code == 2
    assert "'phong' is not one of 'ward', 'ggx'" in refused.err


def test_other_verbs_take_a_rendered_scene(rig):
    assert rig("sim", "render", "point", "out.h5", *TINY).code == 0
    with ScanFile("out.h5") as scan:
        assert scan.status == "complete"
        assert scan.expectation
    assert rig("stats", "out.h5").code == 0
    done = rig(
        "recon", "out.h5", "--wavelength", "60cm", "--depth", "0.8m:1.2m:5cm", "--out", "v.h5", "--json"
    )
    assert done.code == 0, done.err
    with h5py.File("v.h5") as volume:
        brightest = np.unravel_index(
            volume["volume/intensity"][()].argmax(), volume["volume/intensity"].shape
        )
        z_m, y_m, x_m = (volume[f"volume/{axis}_m"][()][i] for axis, i in zip("zyx", brightest, strict=True))
    # half the wavelength along the depth; across, lambda z / (wall) = 60 cm / 1.6 m of 1 m
    assert abs(z_m - 1.0) <= 0.3
    assert np.hypot(x_m, y_m) < 0.4


def test_what_cannot_be_rendered_is_refused(rig, tmp_path):
    assert rig("sim", "render", "nowhere", "out.h5", *TINY).code == 2
    assert not list(tmp_path.iterdir())
    assert rig("sim", "render", "point", "missing/out.h5", *TINY).code == 2
    (tmp_path / "out.h5").write_bytes(b"mine")
    done = rig("sim", "render", "point", "out.h5", *TINY)
    assert done.code == 2
    assert "exists" in done.err
    assert (tmp_path / "out.h5").read_bytes() == b"mine"
    (tmp_path / "real.toml").write_text('[galvo]\naddress = "/dev/null"\n')
    assert rig("sim", "render", "point", "o.h5", "--config", "real.toml").code == 2
