"""The choice of a form: what is said where none is small enough."""

import numpy as np
import pytest

import robustid as rid


def test_too_large_for_every_form_says_what_each_would_need():
    omega = np.geomspace(0.5, 150, 200)
    values = np.broadcast_to(0.5 / (1 + 1j * omega)[:, None, None] * np.ones((4, 4)), (200, 4, 4))
    frf = rid.FrequencyResponse(omega, values, bound=0.02)
    problem = rid.MixedProblem(frequency=frf, prior=rid.BoundedReal(decay=0.3))
    with pytest.raises(
        rid.errors.SizeError, match=r"400 coefficients where up to \d+ .*sections form.* single entries"
    ) as said:
        rid.identify(problem, accuracy=1e-3)
    assert 'form="auto"' not in str(said.value)
    assert "0.3 1/s" in str(said.value)
