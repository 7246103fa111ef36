import contextlib

import numpy as np
import pytest

from support.halvings import arcs_halved
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


@pytest.fixture
def unhalved(request):
    """Bands of directions without further knots between theirs, which take as long again; slow tests have them."""
    with contextlib.nullcontext() if request.node.get_closest_marker("slow") else arcs_halved(0):
        yield
