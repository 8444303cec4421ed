"""Whether tests run at full length: more draws, more seeds, every line. It takes an hour or so more."""

import os

THOROUGH = bool(os.environ.get("RIG_TEST_THOROUGH"))


def some(*values, short):
    """Return what a test is run with: all values at full length, else the first so many."""
    return list(values if THOROUGH else values[:short])
