"""Each laser with each pixel is rendered as each pair by itself, and read and imaged laser by laser."""

import json

import h5py
import numpy as np
import pytest

from rig.files import ScanDescription, ScanWriter
from rig.files.scan import ScanFile
from rig.image.request import Request
from rig.image.work import chosen
from simulators.scenes import scene
from simulators.transport.each_with_each import EachWithEach
from simulators.transport.renderer import Transport
from support.hidden_points import wall

LASERS, PIXELS = wall(2, 2, 0.4), wall(5, 4, 0.2, (0.03, 0.0))
WIDTH_S, BINS = 64e-12, 250


@pytest.mark.parametrize(("bounces", "roughness"), [(3, 1.0), (3, 0.4), (4, 1.0)])
def test_all_pairs_are_each_pair_by_itself(bounces, roughness):
    """Form factors are kept in single precision, and light over all bins of a record adds up: 2e-7.

    Light of more bounces is summed up from the laser, which is where another renderer has its detector.
    """
    built = scene("point" if roughness < 1 else "letter-plane").with_roughness(roughness)
    light = Transport.of_scene(built, bounces=bounces)
    each, edges_s = EachWithEach(light, PIXELS), WIDTH_S * np.arange(BINS + 1)
    for spot_m in LASERS[:2]:
        found = each.transients(tuple(spot_m), BINS, WIDTH_S)
        wanted = light.transients(PIXELS, spot_m[None], edges_s)
        np.testing.assert_allclose(found, wanted, rtol=1e-5, atol=1e-6 * wanted.max())
        assert wanted.any(axis=1).all()


ALL = ("--lasers", "6x6", "--pixels", "16x16", "--spacing", "6cm", "--bin-width", "32ps", "--bins", "400")
SEEN = ("--wavelength", "16cm", "--depth", "0.7m:1.3m:5cm", "--json")


@pytest.fixture
def rendered(rig):
    """A hidden point 1 m from the wall, by 36 lasers and 256 pixels."""
    done = rig("sim", "render", "point", "all.h5", *ALL, "--json")
    assert done.code == 0, done.err
    return json.loads(done.out)


def test_a_hidden_point_is_imaged_where_it_is(rig, rendered):
    assert rendered["positions"] == 36 * 256
    with h5py.File("all.h5") as file:
        assert file["transients/counts"].shape == (36, 256, 400)
        # each place once: 36 + 256 spots
        assert (file["geometry/laser_m"].shape, file["geometry/detector_m"].shape) == ((36, 3), (1, 256, 3))
    done = rig("recon", "all.h5", *SEEN, "--memory", "200MB", "--out", "v.h5")
    assert done.code == 0, done.err
    assert json.loads(done.out)["positions"] == 36 * 256
    assert brightest("v.h5") == pytest.approx([1.0, 0.0, 0.0], abs=0.051)
    with ScanFile("all.h5") as scan:
        # other verbs see pairs with their histograms, `rig recon` an outline and runs of lasers
        assert chosen(scan, Request())[0].capture.positions == 36 * 256
        assert chosen(scan, Request(), by_runs=True)[0].capture.positions == 256


def brightest(path):
    """Where the volume is brightest, along each of its axes."""
    with h5py.File(path) as file:
        intensity = file["volume/intensity"][()]
        axes = ("t_s", "y_m", "x_m") if "volume/t_s" in file else ("z_m", "y_m", "x_m")
        place = np.unravel_index(intensity.argmax(), intensity.shape)
        return [float(file[f"volume/{axis}"][index]) for axis, index in zip(axes, place, strict=True)]


def test_a_lit_point_flashes_at_once(rig, rendered):
    """Lit itself, the point is bright at t = 0 and at its place; a pulse has its peak to a frame.

    Only its own plane is filmed: nearer ones show the same light out of focus, later and brighter.
    """
    given = ("--wavelength", "16cm", "--depth", "1m:1m:5cm", "--json")
    given += ("--relight", "0m,0m,1m", "--camera", "transient", "--over", "max", "--frames", "-1ns:3ns:0.1ns")
    done = rig("recon", "all.h5", *given, "--out", "film.h5", "--image", "film.png")
    assert done.code == 0, done.err
    assert json.loads(done.out)["relight_m"] == [0.0, 0.0, 1.0]
    flash_s, *place_m = brightest("film.h5")
    assert abs(flash_s) < 0.11e-9
    assert place_m == pytest.approx([0.0, 0.0], abs=0.051)
    refused = rig("recon", "all.h5", *SEEN, "--relight", "0m,0m,-1m")
    assert (refused.code, "in front" in refused.err) == (2, True)
    assert "not a place" in rig("recon", "all.h5", "--relight", "0m,1m").err


def test_what_is_no_exhaustive_capture_is_not_relit(rig):
    grid = ("--grid", "5x4", "--spacing", "20cm", "--bin-width", "64ps", "--bins", "200")
    assert rig("sim", "render", "point", "one.h5", *grid).code == 0
    refused = rig("recon", "one.h5", "--relight", "0m,0m,1m")
    assert (refused.code, "exhaustive" in refused.err) == (2, True)
    assert rig("sim", "render", "point", "x.h5", "--lasers", "4x4").code == 2


def test_many_bins_and_pixels_are_stored_in_bands(tmp_path):
    """A laser's chunks, or a band of bins of all lasers, are read without the rest; and checked."""
    rng = np.random.default_rng(4)
    counts = rng.poisson(0.05, (3, 1100, 1000)).astype("u4")
    laser_m, pixel_m = wall(3, 1, 0.4), wall(110, 10, 0.01)
    description = ScanDescription(laser_m, pixel_m[None], 1000, 32e-12, 0.0)
    with ScanWriter.create(tmp_path / "a.h5", description) as writer:
        for step in counts:
            writer.append(step)
            writer.checkpoint()
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["transients/counts"].chunks == (1, 1024, 256)
        assert len(file["transients/checksum"]) == 3 * 2 * 4
        np.testing.assert_array_equal(file["transients/counts"][()], counts)
    with ScanFile(tmp_path / "a.h5") as scan:
        assert scan.done.all()
        whole = scan.exhaustive()
        (_, band), *more = whole.histograms.of(slice(1, 2)).blocks(slice(300, 500))
        assert not more
        np.testing.assert_array_equal(band, counts[1, :, 300:500])
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        file["transients/counts"][2, 1050, 700] += 1
    with ScanFile(tmp_path / "a.h5") as scan:
        assert scan.done.tolist() == [True, True, False]
    finish = ScanWriter.resume(tmp_path / "a.h5")
    assert finish.appended == 2
    finish.append(counts[2])
    finish.close("complete")
    with h5py.File(tmp_path / "a.h5") as file:
        np.testing.assert_array_equal(file["transients/counts"][()], counts)
