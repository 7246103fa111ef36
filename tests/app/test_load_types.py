"""Types of `load`: a kind that is stated says what comes back."""

import inspect

import robustid as rid
from robustid.app.load_save import Reading


def test_the_overloads_take_every_argument_of_load():
    assert {*Reading.__annotations__, "path", "kind", "axes"} == set(inspect.signature(rid.load).parameters)
