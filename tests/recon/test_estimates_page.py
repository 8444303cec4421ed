"""The page about estimates shows what its script finds."""

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

from support.thorough import THOROUGH

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.skipif(not THOROUGH, reason="estimates of a whole scene: with RIG_TEST_THOROUGH=1")
def test_a_row_of_the_page_is_what_the_script_finds():
    """Counts are drawn alike everywhere; sums in another order may move what is printed by its last digit."""
    script = runpy.run_path(str(DOCS / "estimates.py"))
    row = script["row"]("letters 1, one spot", script["answers"](*script["simulated"](1, False)))
    (shown,) = re.findall(r"^\| letters 1, one spot \|.*$", (DOCS / "estimates.md").read_text(), re.MULTILINE)
    numbers = [np.array(re.findall(r"[-+]?\d+\.\d+", line), float) for line in (row, shown)]
    np.testing.assert_allclose(*numbers, atol=0.02)
