"""The page about resolution shows what is measured, and what is measured keeps to diffraction."""

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "resolution.md").read_text(encoding="utf-8")
ROWS = np.array(
    [
        [float(cell.strip(" m")) for cell in line.strip("|").split("|")]
        for line in re.findall(r"^\| [\d.]+ m.*$", PAGE, re.M)
    ]
)


@pytest.fixture(scope="module")
def script():
    return runpy.run_path(str(DOCS / "resolution.py"))


@pytest.mark.parametrize(("confocal", "depth_m"), [(False, 0.6), (False, 2.5), (True, 1.0)])
def test_the_page_shows_what_is_measured(script, confocal, depth_m):
    shown = ROWS[8:] if confocal else ROWS[:8]
    measured = np.array(script["rows"](confocal, (depth_m,)))
    # the page has hundredths; single precision may tip the last digit
    np.testing.assert_allclose(measured, shown[shown[:, 0] == depth_m], atol=0.011)


def test_the_page_holds_eight_rows_for_each_way():
    assert ROWS.shape == (16, 9)


def test_measured_widths_keep_to_diffraction():
    """FWHM, its bound, first minimum, its bound, paraxial, and the disc's bound, as on the page."""
    one, both = ROWS[:8], ROWS[8:]
    fwhm, slit_fwhm, zero, slit_zero, paraxial, disc = one[:, 2:8].T
    # never finer than an evenly lit slit of all its angle, and within a tenth of it
    assert ((fwhm > slit_fwhm) & (fwhm < 1.1 * slit_fwhm)).all()
    assert ((zero > slit_zero) & (zero < disc)).all()
    # near the wall the paraxial formula promises what is not there
    assert (paraxial < zero)[one[:, 0] == 0.6].all()
    # both sides scanned: half, less so near the wall
    gain = fwhm / both[:, 2]
    assert ((gain > 1.7) & (gain < 2)).all()
    assert (gain[one[:, 0] == 2.5] > 1.95).all()
