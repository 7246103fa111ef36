"""Bands of directions whose arcs between knots are halved less often than in use, which takes half of the time: for other steps."""

import contextlib

import pytest

from robustid.guarantees.linear import directed_search


@contextlib.contextmanager
def arcs_halved(times):
    """So many times, not four times."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(directed_search, "_HALVINGS", times)
        yield
