"""Shared by the tests: of a product of cases those in which every value stands, or any two meet; the whole product is slow."""

import itertools

import pytest


def every_two(*axes):
    """All combinations of the axes' values for `parametrize`.

    A set in which any two values of two axes meet is run always (taken greedily, in the order of the product); the other
    combinations are marked slow. Values that are tuples are spread over as many arguments.
    """
    return _covering(axes, 2)


def every_one(*axes):
    """The same with a set in which every value stands."""
    return _covering(axes, 1)


def _covering(axes, together):
    lists = [list(axis) for axis in axes]
    numbers = list(itertools.product(*(range(len(values)) for values in lists)))
    parts = {place: set(itertools.combinations(enumerate(place), together)) for place in numbers}
    open_ones, kept = set().union(*parts.values()), set()
    while open_ones:
        best = max(numbers, key=lambda place: len(parts[place] & open_ones))
        kept.add(best)
        open_ones -= parts[best]
    return [
        pytest.param(*_spread(lists, place), marks=() if place in kept else pytest.mark.slow, id=_name(lists, place))
        for place in numbers
    ]


def _spread(lists, place):
    for values, number in zip(lists, place, strict=True):
        value = values[number]
        yield from value if isinstance(value, tuple) else (value,)


def _name(lists, place):
    return "-".join(str(value) for value in _spread(lists, place))
