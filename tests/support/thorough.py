"""Whether tests run at full length: more draws, more seeds, every line. It takes an hour or so more."""

import os

THOROUGH = bool(os.environ.get("RIG_TEST_THOROUGH"))
