"""``rig recon`` with every camera: files, pictures and videos of a scan with one point that is known."""

import importlib.util
import json
import os
import stat
import sys

import h5py
import numpy as np
import pytest
from matplotlib.image import imread
from PIL import Image

from recon.capture import C_M_PER_S
from recon.registry import CAMERAS, SOLVERS
from rig.commands.recon import Camera, Solver
from rig.errors import UsageError
from rig.files import Volume, read_volume
from rig.files.volume import volume_by_planes
from rig.model.colours import LIGHT_COLOURS
from rig.show.sheet import frames_figure, lit, refocus_figure
from rig.show.video import save_video
from support.thorough import some

POINT = np.array([0.21, 0.13, 0.7])
DETECTOR = np.array([-0.05, 0.05, 0.0])
AROUND = ("--wavelength", "8cm", "--depth", "0.6m:0.8m:5cm", "--json")


@pytest.fixture
def scan(tmp_path):
    """A scan file in rectified time of one point, 24 x 20 positions 3 cm apart."""
    x, y = np.meshgrid(0.03 * (np.arange(24) - 11.5), 0.03 * (np.arange(20) - 9.5))
    laser_m = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    path_m = np.linalg.norm(laser_m - POINT, axis=1) + np.linalg.norm(DETECTOR - POINT)
    counts = np.zeros((x.size, 1000), np.uint32)
    counts[np.arange(x.size), (path_m / C_M_PER_S / 16e-12).astype(int)] = 100
    path = tmp_path / "point.h5"
    with h5py.File(path, "w") as file:
        file.attrs["format"], file.attrs["version"] = "rig-scan", 1
        transients = file.create_group("transients")
        transients.attrs["bin_width_s"], transients.attrs["first_bin_s"] = 16e-12, 0.0
        transients.attrs["time_origin"] = "wall"
        transients["counts"] = counts
        file["geometry/laser_m"], file["geometry/detector_m"] = laser_m, DETECTOR[None]
    return path


def brightest(image, volume):
    j, i = np.unravel_index(image.argmax(), image.shape)
    return volume.x_m[i], volume.y_m[j]


@pytest.mark.parametrize("solver", ["rsd", "fresnel", "direct"])
def test_a_photo_is_a_volume_of_planes(rig, scan, tmp_path, solver):
    done = rig("recon", scan, "--camera", "photo", "--solver", solver, "--voxel", "6cm", *AROUND)
    assert done.code == 0, done.err
    told = json.loads(done.out)
    assert (told["camera"], told["solver"]) == ("photo", solver)
    volume = read_volume(told["volume"])
    assert volume.intensity.shape == (5, len(volume.y_m), len(volume.x_m))
    assert volume.depth_m is None
    if solver != "fresnel":  # which is warned about below
        assert brightest(volume.intensity[2], volume) == pytest.approx(POINT[:2], abs=0.03 + 1e-9)
    assert imread(tmp_path / "point.png").shape[1] == 1500
    # half diagonal 0.45 m: d^4/(4 L^3 lambda) = 0.58 at 0.6 m
    assert any("0.58 at a depth of 0.60 m" in said for said in told["warnings"]) == (solver == "fresnel")


@pytest.mark.parametrize("over", some("surface", "sum", "max", short=2))
def test_a_transient_camera_makes_a_video(rig, scan, tmp_path, over):
    moments = ("--frames", "1.5ns:4ns:0.1ns", "--over", over, "--video", "flash.gif")
    done = rig("recon", scan, "--camera", "transient", *moments, *AROUND)
    assert done.code == 0, done.err
    told = json.loads(done.out)
    volume = read_volume(told["volume"])
    assert volume.intensity.shape == (26, len(volume.y_m), len(volume.x_m))
    np.testing.assert_allclose(volume.t_s, 1.5e-9 + 0.1e-9 * np.arange(26))
    t = volume.intensity.max(axis=(1, 2)).argmax()
    if over == "surface":  # the others show planes out of focus, too
        assert brightest(volume.intensity[t], volume) == pytest.approx(POINT[:2], abs=0.015 + 1e-9)
        # Half a frame, and half a plane of depth.
        reached_s = np.linalg.norm(POINT - DETECTOR) / C_M_PER_S
        assert volume.t_s[t] == pytest.approx(reached_s, abs=0.05e-9 + 0.025 / C_M_PER_S)
    with Image.open(tmp_path / "flash.gif") as film:
        assert (film.n_frames, film.info["duration"], film.info["loop"]) == (26, 100, 0)


def test_a_page_comes_with_the_image(rig, scan, tmp_path):
    done = rig("recon", scan, "--page", "point.html", *AROUND)
    assert done.code == 0, done.err
    told = json.loads(done.out)
    assert told["page"] == "point.html"
    assert told["origin"]["positions"] == 480
    text = (tmp_path / "point.html").read_text("utf-8")
    assert "480 positions" in text
    assert '"wall_known": true' in text


def test_all_depths_go_to_the_file(rig, scan):
    moments = ("--frames", "1.5ns:4ns:0.5ns", "--all-depths", "--over", "max")
    told = json.loads(rig("recon", scan, "--camera", "transient", *moments, *AROUND, "--out", "all.h5").out)
    flat = json.loads(rig("recon", scan, "--camera", "transient", *moments[:2], *moments[3:], *AROUND).out)
    whole, front = read_volume(told["volume"]), read_volume(flat["volume"])
    assert whole.intensity.shape == (6, 5, len(whole.y_m), len(whole.x_m))
    np.testing.assert_array_equal(whole.intensity.max(axis=1), front.intensity)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--camera", "photo", "--solver", "backprojection"), "infinitely long pulse"),
        (("--camera", "photo", "--video", "a.gif"), "the photo camera makes no video"),
        (("--camera", "photo", "--cycles", "3"), "--cycles would have no effect"),
        (("--frames", "1ns:2ns:0.1ns", "--over", "max"), "--frames and --over would have no effect"),
        (("--all-depths",), "--all-depths would have no effect; add --camera transient"),
        (("--solver", "bp", "--cycles", "3"), "--cycles would have no effect; use rsd"),
        (("--cycles", "1.1"), "a pulse has 1.2 to 10000"),
        (("--camera", "transient", "--video", "a.avi"), "must be .gif or .mp4"),
        (("--camera", "transient", "--frames", "2ns:1ns:1ns"), "moments must ascend"),
        (("--camera", "transient", "--page", "a.html"), "a film has no page"),
        (("--page", "a.txt"), "must be .html or .htm"),
        (("--image", "a.avi"), "'.avi' is not one of"),
        (("--camera", "transient", "--frames", "2ns"), "--frames 2ns:20ns:0.2ns"),
    ],
)
def test_what_makes_no_sense_is_refused(rig, scan, arguments, said, tmp_path):
    done = rig("recon", scan, *arguments)
    assert done.code == 2
    assert said in done.err
    assert sorted(os.listdir(tmp_path)) == ["point.h5"]


def film(**changes):
    """A video of 9 x 8 pixels in which one pixel, left and up for the camera, is lit in frame 2."""
    intensity = np.zeros((4, 8, 9), "f4")
    intensity[2, 6, 7] = 4.0
    intensity[3, 1, 1] = 1.0
    changes = {"intensity": intensity} | changes
    axes = {"x_m": np.linspace(-0.8, 0.8, 9), "y_m": np.linspace(-0.7, 0.7, 8), "z_m": np.array([1.0, 1.1])}
    return Volume(**({"t_s": 1e-9 * np.arange(4.0), "scan": "a.h5"} | axes | changes))


def test_a_gif_shows_each_frame_to_one_scale_as_the_camera_sees_it(tmp_path):
    save_video(film(), tmp_path / "a.gif", compensation="t⁴")
    with Image.open(tmp_path / "a.gif") as shown:
        frames = []
        for number in range(shown.n_frames):
            shown.seek(number)
            frames.append(np.array(shown.convert("RGB"), float) / 255)
    nothing, full = (np.array(LIGHT_COLOURS(end)[:3]) for end in (0.0, 1.0))  # ends of the scale
    assert nothing.min() == 1.0  # white: no frame is black
    whole = [np.abs(frame - full).max(axis=2) < 0.03 for frame in frames]
    bar = whole[0].sum()  # the bar's own end
    height, width = whole[0].shape
    rows, columns = np.nonzero(whole[2] & ~whole[0])
    assert len(rows) > 500
    assert whole[2].sum() > bar + 500
    assert rows.mean() < height / 2
    assert columns.mean() < width / 2
    assert whole[3].sum() == bar  # half of the amplitude is not full scale
    dark = [(np.abs(frame - nothing).max(axis=2) < 0.03).sum() for frame in frames]
    assert dark[0] == pytest.approx(dark[1], abs=100)  # digits of the stamp
    assert dark[3] < dark[0] - 500
    assert os.listdir(tmp_path) == ["a.gif"]


def test_a_film_shows_the_outlines_of_what_was_found():
    found = np.full((8, 9), np.nan, "f4")
    found[5:8, 6:9] = 1.0
    for depth_m, lines in ((None, 0), (found, 1), (np.full_like(found, np.nan), 0), (np.ones_like(found), 0)):
        axes = frames_figure(film(depth_m=depth_m)).axes[0]
        assert len(axes.collections) == lines
    axes = frames_figure(film(depth_m=found)).axes[0]
    (path,) = axes.collections[0].get_paths()
    # half a pixel, of 0.2 m, beyond what was found at x of 0.4 m and more, y of 0.3 m and more
    assert path.vertices.min(axis=0) == pytest.approx([0.3, 0.2])


def test_noise_everywhere_does_not_make_a_film_longer():
    light = 1e-5 * np.random.default_rng(4).random((100, 8, 9), "f4")
    light[40:44, 3, 3] = 1.0
    light[90, 7, 7] = 0.004  # one bright pixel, 6 % of the greatest amplitude
    shown = lit(film(intensity=light, t_s=1e-9 * np.arange(100.0)))
    np.testing.assert_allclose(shown.t_s, 1e-9 * np.arange(40.0, 44.0))


def test_a_video_of_light_begins_and_ends_where_the_light_does():
    dark = np.zeros((20, 8, 9), "f4")
    dark[[9, 12], 3, 3] = 1.0, 0.5
    shown = lit(film(intensity=dark, t_s=1e-9 * np.arange(20.0)), margin=3)
    np.testing.assert_allclose(shown.t_s, 1e-9 * np.arange(6.0, 16.0))
    np.testing.assert_array_equal(shown.intensity, dark[6:16])
    nothing = film(intensity=np.zeros_like(dark), t_s=1e-9 * np.arange(20.0))
    assert lit(nothing) is nothing


def test_a_video_that_was_not_told_its_moments_has_no_dark_ends(rig, scan, tmp_path):
    done = rig("recon", scan, "--camera", "transient", "--video", "flash.gif", *AROUND)
    assert done.code == 0, done.err
    volume = read_volume(json.loads(done.out)["volume"])
    light = np.cumsum(volume.intensity.sum(axis=(1, 2)) * np.maximum(volume.t_s, 0) ** 4)
    seen = np.flatnonzero((light >= 0.01 * light[-1]) & (np.append(0, light[:-1]) < 0.99 * light[-1]))
    with Image.open(tmp_path / "flash.gif") as film:
        # a pulse, four frames, before the first light and after the last, as far as there are frames
        first, last = max(0, seen[0] - 4), min(len(light), seen[-1] + 5)
        assert film.n_frames == last - first < len(light)


def test_an_mp4_is_left_to_ffmpeg(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(UsageError, match=r"needs the program ffmpeg.*a\.gif"):
        save_video(film(), tmp_path / "a.mp4")
    # A stand-in that stores what it is told and given: the program itself is not needed to see that.
    tool = tmp_path / "ffmpeg"
    tool.write_text(
        f"#!{sys.executable}\nimport sys\ngiven = sys.stdin.buffer.read()\n"
        "open(sys.argv[-1], 'w').write(' '.join(sys.argv[1:-1]) + f' {len(given)}')\n"
    )
    tool.chmod(tool.stat().st_mode | stat.S_IXUSR)
    save_video(film(), tmp_path / "a.mp4")
    told = (tmp_path / "a.mp4").read_text().split()
    width, height = map(int, told[told.index("-s") + 1].split("x"))
    assert width % 2 == height % 2 == 0  # which yuv420p needs
    assert int(told[-1]) == 4 * 3 * width * height
    tool.write_text(f"#!{sys.executable}\nimport sys\nsys.exit('no such codec')\n")
    with pytest.raises(Exception, match="no such codec"):
        save_video(film(), tmp_path / "b.mp4")
    assert not (tmp_path / "b.mp4").exists()


def test_sheets_show_planes_and_lit_frames():
    figure = frames_figure(film(), compensation="t⁴")
    frames = {axes.get_title(): axes for axes in figure.axes if axes.get_title()}
    assert [*frames] == ["2.00 ns = 0.60 m", "3.00 ns = 0.90 m"]
    for axes, amplitude in zip(frames.values(), np.sqrt(film().intensity[2:] / 4), strict=True):
        (image,) = axes.get_images()
        np.testing.assert_allclose(image.get_array(), amplitude, atol=1e-6)
        assert axes.get_xlim()[0] > axes.get_xlim()[1]
    planes = Volume(np.ones((30, 8, 9), "f4"), film().x_m, film().y_m, np.linspace(0.5, 1.95, 30))
    titles = [axes.get_title() for axes in refocus_figure(planes).axes if axes.get_title()]
    assert (len(titles), titles[0], titles[-1]) == (12, "focused at 50 cm", "focused at 1.95 m")


def fill(path, video, planes):
    with volume_by_planes(path, video) as put:
        for plane in planes:
            put(np.s_[:, plane], plane + video.intensity)


def test_a_video_by_planes_appears_whole_or_not_at_all(tmp_path):
    path = tmp_path / "v.h5"
    with pytest.raises(IndexError):
        fill(path, film(), range(3))
    assert os.listdir(tmp_path) == []
    fill(path, film(), range(2))
    np.testing.assert_array_equal(read_volume(path).intensity[:, 1], 1 + film().intensity)
    with pytest.raises(ValueError, match="only a transient"):
        fill(path, film(t_s=None), range(2))
    with pytest.raises(ValueError, match="intensity has shape"):
        fill(path, film(x_m=np.arange(2.0)), range(2))


def test_every_solver_and_camera_has_its_name_on_the_command_line():
    assert [solver.value for solver in Solver] == [*SOLVERS]
    assert [camera.value for camera in Camera] == [*CAMERAS]


def test_memory_bounds_the_image(rig, scan):
    whole = json.loads(rig("recon", scan, *AROUND).out)
    wanted = read_volume(whole["volume"]).intensity
    done = rig("recon", scan, "--memory", "200MB", *AROUND)
    assert done.code == 0, done.err
    found = read_volume(json.loads(done.out)["volume"]).intensity
    # Runs of lower frequencies may be interpolated with other weights, right to 3e-4 along each axis.
    assert np.abs(found - wanted).max() < 2e-3 * wanted.max()
    refused = rig("recon", scan, "--memory", "1MB", *AROUND)
    assert refused.code == 2
    assert "image fewer voxels" in refused.err + refused.out


@pytest.mark.parametrize("over", ["surface", "max"])
def test_memory_bounds_the_video(rig, scan, over):
    asked = ("--camera", "transient", "--over", over, *AROUND)
    whole = json.loads(rig("recon", scan, *asked).out)
    wanted = read_volume(whole["volume"]).intensity
    done = rig("recon", scan, "--memory", "300MB", *asked)
    assert done.code == 0, done.err
    found = read_volume(json.loads(done.out)["volume"]).intensity
    # As of the image, which says where the surface is.
    assert np.abs(found - wanted).max() < 2e-3 * wanted.max()
    refused = rig("recon", scan, "--memory", "1MB", *asked)
    assert refused.code == 2
    assert "image fewer voxels" in refused.err + refused.out


def test_a_video_on_a_device_that_is_not_there(rig, scan):
    if importlib.util.find_spec("torch") or importlib.util.find_spec("cupy"):
        pytest.skip("a library for graphics processors is installed")
    refused = rig("recon", scan, "--camera", "transient", "--device", "cuda")
    assert refused.code == 2
    assert "torch is not installed, cupy is not installed" in refused.err
