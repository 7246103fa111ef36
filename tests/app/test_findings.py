"""What is found, in sentences."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.app.run import findings
from robustid.identification import model_residuals
from support.bounds import rebound
from support.matrix_lines import measured

pytestmark = pytest.mark.quick


def test_samples_outside_are_named_with_their_entry():
    truth, basis, frf = measured()
    values = np.array(frf.values)
    values[3, 1, 0] += 7 * 0.05
    problem = rid.MixedProblem(
        frequency=dataclasses.replace(frf, values=values, outputs=["left", "right"], inputs=["a", "b"]),
        prior=rid.Prior(gain_bound=0.1, decay_rate=1.2),
        parametric=basis,
    )
    result = rid.identify(problem)
    words = findings.sample_words(result, truth, 4)
    assert f"leaves 1 of 120 samples outside their bounds: {frf.freq_hz[3]:.5g} Hz (right / a)" in words
    lines_ = problem.frequency[0]
    assert "(right / a)" in findings.unused_words(truth, lines_)
    column = rebound(lines_, joint="column")
    assert f"{frf.freq_hz[3]:.5g} Hz (a)" in findings.unused_words(truth, column)
    ratio = max(r.ratio.max() for r in model_residuals(problem, truth))
    assert f"({ratio:.4g} bounds)" in words
