"""Where tests find what others measured: ``RIG_TEST_DATA``, or ``shared/data`` beside the project."""

import os
from pathlib import Path

import pytest

DATA = Path(os.environ.get("RIG_TEST_DATA") or Path(__file__).parents[3] / "shared" / "data")
measured = pytest.mark.skipif(not DATA.is_dir(), reason=f"the published measurements are not at {DATA}")
