"""The stabilisation diagram in the terminal: every order once, every pole in its place."""

import numpy as np
import pytest

import robustid as rid
from robustid.app.cli.fit import Stabilisation

pytestmark = pytest.mark.quick


def test_lines_grow_with_the_sweep_and_poles_stand_at_their_frequency():
    omega = 2 * np.pi * np.geomspace(1, 100, 80)
    s = 1j * omega
    values = sum(
        (2 * np.pi * hz) ** 2 / (s**2 + 0.02 * 2 * np.pi * hz * s + (2 * np.pi * hz) ** 2) for hz in (2, 10, 50)
    )
    shown, diagram = [], Stabilisation(omega)
    rid.fits.suggest_order(
        rid.FrequencyResponse(omega, values),
        orders=[2, 4, 6, 7, 8],
        weight=np.ones((80, 1, 1)),
        grown=lambda sweep: shown.append(diagram.lines(sweep)),
    )
    first, second = shown
    assert "1 Hz" in first[1]
    assert first[1].endswith("100 Hz")
    assert [int(line[:5]) for line in first[2:-1]] == [2, 4, 6, 7]
    assert [int(line[:5]) for line in second[:-1]] == [8]
    assert first[-1].startswith("so far order 6")
    assert {line.index("|", 7) - line.index("|") for line in first[2:-1]} == {57}
    marks = first[4].split("|")[1]
    places = [k for k, mark in enumerate(marks) if mark != " "]
    np.testing.assert_allclose(100 ** (np.array(places) / 55), [2, 10, 50], rtol=0.05)
