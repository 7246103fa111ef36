import numpy as np
import pytest

from support.proofs import built


@pytest.fixture
def rng():
    return np.random.default_rng(5)


@pytest.fixture
def program():
    """The checker in C of proof files."""
    return built()
