"""A simulated galvo, laser and detector, each at its wire."""

import pytest

from support.simulated_rig import simulated_rig


@pytest.fixture
def rig():
    with simulated_rig() as rig:
        yield rig
