"""Leave-one-out by leverage against fits without each point, and what it guards against."""

import numpy as np
import pytest

import robustid as rid
from robustid.fitting import fit_mfd
from robustid.fitting.state_space.projected_outputs import Outputs
from robustid.fitting.state_space.state_descent import blocks_of
from robustid.fitting.state_space.state_refinement import refine
from robustid.fitting.state_space.withheld_points import left_out_cost
from support.measured import realdata
from support.mfd_systems import noisy, random_modal_system


def problem_without(frf, order, point, weight):
    keep = np.arange(frf.omega.size) != point
    kept = rid.fits.Weight(np.where(keep[:, None, None], weight, 0.0))
    return fit_mfd(frf, order=order, weight=kept).problem


@pytest.mark.parametrize(("ny", "nu"), [(1, 1), (2, 2)])
def test_equals_fits_without_each_point(ny, nu):
    """Small noise: first order is all there is."""
    omega = 2 * np.pi * np.geomspace(5, 900, 24)
    truth = random_modal_system(3, ny, nu, 2).response(1j * omega)
    frf = rid.FrequencyResponse(omega, noisy(np.random.default_rng(0), truth, 1e-4))
    weight = 1 / np.abs(truth)
    fit = fit_mfd(frf, order=4, weight=rid.fits.Weight(weight))
    outputs = Outputs(fit.problem)
    fitted = outputs.fitted(blocks_of(fit.problem, fit.fraction.matrices))
    total = 0.0
    for point in range(omega.size):
        without = problem_without(frf, 4, point, weight)
        other = refine(without, fitted.model, stable=True, limit=20).fitted
        residual = weight[point] * (other.response[point] - frf.values[point])
        total += float(np.linalg.norm(residual) ** 2)
    # Fits end within a hundredth of a deviation.
    assert left_out_cost(outputs, fitted) == pytest.approx(total, rel=0.05)
    assert total > 1.1 * fitted.cost


def test_a_narrow_mode_of_the_plant_stays():
    """Damping of a thirtieth of the spacing, almost no noise: the criterion would rise by more than the factor."""
    experiment = rid.datasets.flexible_structure(bound=1e-4)
    fit = fit_mfd(experiment.frequency, order=4)
    hz = np.sort(np.abs(np.log(fit.fraction.poles)) / (2 * np.pi * 0.01))[::2]
    np.testing.assert_allclose(hz, experiment.modes[:, 0] / (2 * np.pi), rtol=2e-3)


class TestMeasured:
    pytestmark = realdata

    @pytest.mark.slow
    @pytest.mark.parametrize("order", [36, 60])
    def test_modes_that_single_points_decide_do_not_stand_between_them(self, order):
        """Orders far too large for a short record: narrow modes at single points left 2 to 70 times the data between them."""
        frf = rid.estimate_frf(rid.datasets.load("cdplayer"), method="local")
        train, test = frf.select(slice(0, None, 2)), frf.select(slice(1, None, 2))
        fit = fit_mfd(train, order=order, weight=rid.fits.Weight.relative(train.values))
        error = np.abs(fit.fraction.response(test.omega) - test.values) / np.abs(test.values)
        assert np.sqrt(np.mean(error**2)) < 0.8
