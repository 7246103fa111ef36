"""Shared by the tests: which cases always run, and which ones are slow (`pytest -m slow`)."""

from typing import Any

import pytest


def slow(*values: Any, **named: Any) -> Any:
    """A case of `parametrize` that is slow."""
    return pytest.param(*values, marks=pytest.mark.slow, **named)


def seeds(quick: int, full: int) -> list[Any]:
    """0, 1, ..., of which those from `quick` on are slow."""
    return [*range(quick), *map(slow, range(quick, full))]
