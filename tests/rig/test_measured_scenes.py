"""What others measured with real photons, from their file to the picture, by a user's commands."""

from pathlib import Path

import numpy as np
import pytest

from recon.depth import compensate_falloff
from rig.files.volume import read_volume
from support.published import importable, published


@pytest.fixture
def imaged(rig):
    """Import a scene, image it, and return the volume."""

    def run(name, *imaging):
        source, importing = importable(name)
        done = rig("import", source, "a.h5", *importing)
        assert done.code == 0, done.err
        done = rig("recon", "a.h5", *imaging)
        assert done.code == 0, done.err
        assert Path("a.png").read_bytes().startswith(b"\x89PNG")
        return read_volume("a-volume.h5")

    return run


def region(volume, x_m, y_m):
    """Depth map of a part of the front view, its pixels without depth left out."""
    columns = (volume.x_m >= x_m[0]) & (volume.x_m <= x_m[1])
    rows = (volume.y_m >= y_m[0]) & (volume.y_m <= y_m[1])
    depths = volume.depth_m[np.ix_(rows, columns)]
    return depths[np.isfinite(depths)]


def test_s_and_u_as_published(imaged):
    volume = imaged("lct_su", "--wavelength", "4cm")
    # S: its lower strokes lie left of the middle for the camera, at +x, where nothing of the U is
    assert np.median(region(volume, (0.0, 0.2), (-0.25, 0.15))) == pytest.approx(0.65, abs=0.03)
    # U: its right stroke lies at -x beside the S; upright, because its foot is below and not above
    assert np.median(region(volume, (-0.3, -0.18), (-0.15, 0.25))) == pytest.approx(1.04, abs=0.03)
    assert len(region(volume, (-0.2, -0.12), (-0.15, -0.08))) > len(
        region(volume, (-0.2, -0.12), (0.15, 0.22))
    )


def test_s_and_u_from_time_tagged_records(rig):
    source = published("original/picoquant/hydraharp/nlos_su_scan_derived_t3.ptu")
    plan = "--grid 64x64 --spacing 11.111111mm --order=-y,x --detector confocal --point-marker 1"
    done = rig("import", source, "a.h5", *plan.split(), "--time-zero", "20ns")
    assert done.code == 0, done.err
    done = rig("recon", "a.h5", "--wavelength", "4cm", "--depth", "0.5m:1.2m:1cm")
    assert done.code == 0, done.err
    volume = read_volume("a-volume.h5")
    # as above, with 800,000 of the 53 million photons
    assert np.median(region(volume, (0.0, 0.2), (-0.25, 0.15))) == pytest.approx(0.65, abs=0.03)
    assert np.median(region(volume, (-0.3, -0.18), (-0.15, 0.25))) == pytest.approx(1.04, abs=0.03)


def test_the_file_without_its_bin_width_is_asked_for_by_name(rig):
    done = rig("import", published("original/lct/data_s_u.mat"), "a.h5")
    assert done.code == 2
    assert "--bin-width" in done.err
    assert not Path("a.h5").exists()


def test_the_four_as_published(imaged):
    volume = imaged("phasor_figure4_nonconfocal", "--wavelength", "6cm")
    assert np.median(region(volume, (-0.7, 0.7), (-0.7, 0.7))) == pytest.approx(0.95, abs=0.03)
    # a 4 has its long stroke on the reader's right, at smaller x, and its short one on the left, only above
    assert len(region(volume, (0.0, 0.15), (-0.4, -0.15))) > 3 * len(
        region(volume, (0.35, 0.5), (-0.4, -0.15))
    )
    assert len(region(volume, (0.35, 0.5), (0.1, 0.3))) > 10


def test_nine_dots_at_their_pitch(imaged):
    volume = imaged("lct_dot_chart_40cm", "--wavelength", "3cm")
    front = compensate_falloff(volume.intensity, volume.z_m, 4.0).max(axis=0)
    found = []
    for _ in range(9):  # the nine brightest spots, each blanked over half a pitch
        row, column = np.unravel_index(front.argmax(), front.shape)
        found.append((volume.x_m[column], volume.y_m[row]))
        near_x, near_y = abs(volume.x_m - found[-1][0]) < 0.04, abs(volume.y_m - found[-1][1]) < 0.04
        front[np.ix_(near_y, near_x)] = 0
    x_m, y_m = np.array(found).T
    columns = np.sort(x_m).reshape(3, 3).mean(axis=1)
    rows = np.sort(y_m).reshape(3, 3).mean(axis=1)
    assert np.diff(columns) == pytest.approx(0.10, abs=0.012)
    assert np.diff(rows) == pytest.approx(0.10, abs=0.012)
    # three in each row and column: every dot is within 2 cm of its column's and its row's mean
    assert np.abs(np.sort(x_m).reshape(3, 3) - columns[:, None]).max() < 0.02
    assert np.abs(np.sort(y_m).reshape(3, 3) - rows[:, None]).max() < 0.02


def brightness(volume, x_m, y_m):
    """Mean of the front view over a part of it, in parts of its maximum."""
    front = volume.intensity.max(axis=0)
    columns = (volume.x_m >= x_m[0]) & (volume.x_m <= x_m[1])
    rows = (volume.y_m >= y_m[0]) & (volume.y_m <= y_m[1])
    return front[np.ix_(rows, columns)].mean() / front.max()


def test_twenty_over_nineteen(imaged):
    volume = imaged("ahn_2019", "--wavelength", "5cm")
    assert np.nanmedian(volume.depth_m) == pytest.approx(1.08, abs=0.03)
    # the 1 of the lower 19 stands on the reader's left, at +x; its gap to the 9 is dark, the 2 above has none
    one = brightness(volume, (0.07, 0.09), (-0.18, -0.06))
    gap = brightness(volume, (0.01, 0.05), (-0.18, -0.06))
    assert one > 4 * gap
    assert brightness(volume, (0.01, 0.05), (0.05, 0.15)) > 2 * gap


def test_an_l_from_eighteen_metres_away(imaged):
    volume = imaged("xiao18m_L", "--wavelength", "20cm", "--depth", "0.5m:1m:2cm")
    # published at 0.77 m; with a wavelength of 20 cm the letter's parts spread from 0.71 to 0.83 m
    assert np.nanmedian(volume.depth_m) == pytest.approx(0.77, abs=0.06)
    # its stem is on the reader's left, at +x, its foot points to the right, below
    stem = brightness(volume, (0.0, 0.12), (0.05, 0.25))
    foot = brightness(volume, (-0.27, -0.12), (-0.27, -0.1))
    beside = brightness(volume, (-0.27, -0.12), (0.05, 0.25))
    assert min(stem, foot) > 5 * beside
