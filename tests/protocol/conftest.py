"""A simulated galvo, laser and detector, each at its wire; and transcripts in their place."""

from functools import partial

import pytest

from support.protocol_script import playing
from support.simulated_rig import simulated_rig


@pytest.fixture
def rig():
    with simulated_rig() as rig:
        yield rig


@pytest.fixture
def play(monkeypatch):
    """Play steps at an address, as a context, and hold the driver to all of them."""
    return partial(playing, monkeypatch)
