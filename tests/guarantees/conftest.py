import numpy as np
import pytest

from support.proofs import asked, built


@pytest.fixture
def rng():
    return np.random.default_rng(5)


@pytest.fixture
def program():
    """The checker in C of proof files."""
    return built()


@pytest.fixture
def proved(program, tmp_path):
    """The checker proves a file: proved(text) is what it says of it."""

    def check(text, seconds=60):
        status, said = asked(program, text, tmp_path, seconds)
        assert status == 0, said
        return said

    return check
