"""Bounds, coverage and modes as rows of a DataFrame: one for every frequency and entry, with the numbers of the result."""

import numpy as np
import pytest

import robustid as rid

pytestmark = pytest.mark.quick
pytest.importorskip("pandas")


def test_rows_of_a_worst_case_of_coverage_and_of_modes():
    data = rid.datasets.flexible_structure(lines=8)
    modes = rid.kautz(data.modes[:, 0], data.modes[:, 1], dt=0.01, delay=1)
    problem = rid.MixedProblem(
        frequency=data.frequency, parametric=modes, prior=rid.Prior(gain_bound=0.2, decay_rate=1.1)
    )
    error = rid.worst_case_error(rid.identify(problem), omega=data.frequency.omega[:3], directions=4)
    frame = error.to_dataframe()
    assert list(frame) == [*("frequency [Hz]", "output", "input", "real", "imag", "guaranteed error", "reached error")]
    np.testing.assert_array_equal(frame["guaranteed error"], error.upper.ravel())
    np.testing.assert_allclose(frame["frequency [Hz]"], error.omega / (2 * np.pi))
    fresh = rid.datasets.flexible_structure(lines=8, seed=7).frequency
    found = rid.coverage(error, [fresh])
    frame = found.to_dataframe()
    assert len(frame) == found.error.size
    np.testing.assert_array_equal(frame["error"], found.error.ravel())
    fit = rid.fit_mfd(rid.datasets.flexible_structure(lines=30).frequency, order=4)
    rows = fit.modes
    assert isinstance(rows, tuple)
    assert [row.hz for row in rows] == rows.to_dataframe()["frequency [Hz]"].tolist()
    assert len(str(rows).splitlines()) == 3
    assert rows == rid.fits.mode_table(fit)
