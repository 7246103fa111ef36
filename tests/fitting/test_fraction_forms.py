"""Fits whose poles all entries share, with free residues: known answers, and the way to the fitted column and back."""

import control
import numpy as np
import pytest
import scipy.linalg

import robustid as rid
from robustid.errors import InputError
from robustid.fitting import StaticGain, Weight, mode_table
from support.cases import slow
from support.mfd_systems import by_control, gaussian, noisy, random_modal_system, relative_error
from support.pairwise import every_one

OMEGA = 2 * np.pi * np.geomspace(4, 1200, 150)
POLES = np.array([-2 + 90j, -5 + 400j, -30 + 2500j])
POINTS = np.geomspace(10, 9000, 23)


def plant(ny, nu, dt=None, feedthrough=True):
    """Response as a function of omega: residues of full rank, from their partial fractions."""
    rng = np.random.default_rng([ny, nu])
    R, D = gaussian(rng, POLES.size, ny, nu) * -POLES.real[:, None, None], rng.standard_normal((ny, nu)) * feedthrough
    poles = POLES if dt is None else np.exp(POLES * dt)
    R = R if dt is None else R * dt

    def response(omega):
        xi = 1j * omega if dt is None else np.exp(1j * omega * dt)
        terms = [np.multiply.outer(1 / (xi - p), r) for p, r in zip(poles, R, strict=True)]
        terms += [np.multiply.outer(1 / (xi - p.conj()), r.conj()) for p, r in zip(poles, R, strict=True)]
        return np.sum(terms, axis=0) + D

    return response, np.concatenate([poles, poles.conj()])


def fitted(ny, nu, level=0.0, dt=None, **options):
    response, poles = plant(ny, nu, dt)
    values = noisy(np.random.default_rng(0), response(OMEGA), level) if level else response(OMEGA)
    options = {"order": 6, "form": "shared", "feedthrough": True, **options}
    return rid.fit_mfd(rid.FrequencyResponse(OMEGA, values, dt=dt), **options), response, poles


def sorted_poles(poles):
    return poles[np.lexsort((poles.imag, np.abs(poles).round(6), poles.real.round(6)))]


@pytest.mark.parametrize(("ny", "nu", "dt"), every_one([(3, 2), (2, 3), (2, 2), (1, 3), (4, 1)], [None, 2e-4]))
def test_a_plant_of_shared_poles_is_recovered(ny, nu, dt):
    fit, response, poles = fitted(ny, nu, dt=dt)
    assert len(fit.poles) == 6
    np.testing.assert_allclose(sorted_poles(fit.poles), sorted_poles(poles), rtol=1e-8)
    assert fit.model.nstates == 6 * min(ny, nu) == fit.fraction.states_in_all
    for found in (by_control(fit.model, POINTS), fit.fraction.response(POINTS)):
        np.testing.assert_allclose(found, response(POINTS), rtol=1e-8)
    xi = 1j * POINTS if dt is None else np.exp(1j * POINTS * dt)
    N, D = fit.numerator(xi), fit.denominator(xi)
    assert N.shape == (POINTS.size, ny, nu)
    assert D.shape == (POINTS.size, 1, 1)
    np.testing.assert_allclose(N / D, response(POINTS), rtol=1e-7)


@pytest.mark.parametrize(("ports", "lines"), [(7, 40), slow(12, 80)])
def test_more_entries_than_frequency_points_are_no_obstacle(ports, lines):
    """144 entries at 80 frequency points: the start takes combinations of them, the fit all."""
    response, poles = plant(ports, ports)
    omega = np.geomspace(4, 8000, lines)
    values = noisy(np.random.default_rng(0), response(omega), 0.01)
    fit = rid.fit_mfd(rid.FrequencyResponse(omega, values), order=6, form="shared", feedthrough=True)
    assert fit.status.converged
    np.testing.assert_allclose(sorted_poles(fit.poles), sorted_poles(poles), rtol=5e-3)
    assert relative_error(fit.fraction.response(omega), response(omega)) < 0.005


def test_the_model_has_no_state_too_many():
    """Residues of full rank: the Hankel singular values of all order*min(ny, nu) states count."""
    model = fitted(2, 3)[0].model
    A, B, C = model.A, model.B, model.C
    reached = scipy.linalg.solve_continuous_lyapunov(A, -B @ B.T)
    seen = scipy.linalg.solve_continuous_lyapunov(A.T, -C.T @ C)
    values = np.sqrt(np.abs(np.linalg.eigvals(reached @ seen)))
    assert values.size == 12
    assert values.min() > 1e-3 * values.max()


def test_one_entry_is_form_right():
    """SISO: the same fit."""
    system, omega = random_modal_system(3, 1, 1, 2), OMEGA[::3]
    values = noisy(np.random.default_rng(1), system.response(1j * omega), 0.01)
    frf = rid.FrequencyResponse(omega, values, covariance=1e-4 * np.abs(values) ** 2, dof=20.0)
    shared, right = (rid.fit_mfd(frf, order=4, form=form) for form in ("shared", "right"))
    np.testing.assert_array_equal(shared.poles, right.poles)
    np.testing.assert_array_equal(by_control(shared.model, POINTS), by_control(right.model, POINTS))
    assert shared.cost == right.cost
    assert shared.weight_choice == right.weight_choice


def test_it_is_the_fit_of_the_entries_as_one_column():
    """Entry (i, j) is row i*nu + j of a fit of one input."""
    fit, response, _ = fitted(2, 3, level=0.01, restart=False)
    values = fit.fraction.oriented(fit.problem.values)
    column = rid.FrequencyResponse(OMEGA, values.reshape(-1, 6, 1))
    other = rid.fit_mfd(column, order=6, feedthrough=True, restart=False)
    assert fit.cost == pytest.approx(other.cost, rel=1e-9)
    np.testing.assert_allclose(
        by_control(fit.model, POINTS).reshape(-1, 6, 1), by_control(other.model, POINTS), rtol=1e-6
    )
    assert relative_error(by_control(fit.model, OMEGA), response(OMEGA)) < 0.005


@pytest.mark.parametrize("parts", [(), ("matrix",), ("output",), ("input", "output"), ("input", "output", "matrix")])
def test_stacked_weights_give_the_same_criterion(parts):
    rng = np.random.default_rng(len(parts))
    lines, ny, nu = 5, 3, 2
    sizes = {"matrix": ny * nu, "output": ny, "input": nu}
    entries = rng.uniform(0.1, 2, (lines, ny, nu))
    entries[0] = 0
    weight = Weight(entries, **{name: gaussian(rng, lines, sizes[name], sizes[name]) for name in parts})
    residual = gaussian(rng, lines, ny, nu)
    column = np.array([[residual[k, i, j] for i in range(ny) for j in range(nu)] for k in range(lines)])[:, :, None]
    stacked = weight.stacked()
    found, wanted = (np.linalg.norm(each, axis=1) for each in (stacked.apply(column), weight.apply(residual)))
    np.testing.assert_allclose(found, wanted, rtol=1e-12)
    np.testing.assert_allclose(stacked.entrywise.reshape(weight.shape), weight.entrywise, rtol=1e-12)
    assert np.all(stacked.entries[0] == 0)


def test_a_correlated_weight_leads_the_fit_as_brute_force_says():
    """The criterion of the fit is that of the weight, evaluated entry by entry; and the default takes the variances."""
    response, _ = plant(2, 2)
    rng = np.random.default_rng(4)
    root = 0.01 * gaussian(rng, OMEGA.size, 4, 4)
    covariance = root @ root.conj().transpose(0, 2, 1)
    noise = (root @ gaussian(rng, OMEGA.size, 4, 1))[..., 0].reshape(-1, 2, 2).transpose(0, 2, 1)
    frf = rid.FrequencyResponse(OMEGA, response(OMEGA) + noise, covariance=covariance)
    weight = Weight.from_covariance(covariance, 2, 2)
    options = {"order": 6, "form": "shared", "feedthrough": True}
    fit, default = rid.fit_mfd(frf, weight=weight, **options), rid.fit_mfd(frf, **options)
    stacks = [(frf.values - by_control(one.model, OMEGA)).transpose(0, 2, 1).reshape(-1, 4) for one in (fit, default)]
    costs = [np.sum([np.linalg.norm(np.linalg.solve(root[k], e[k])) ** 2 for k in range(len(e))]) for e in stacks]
    assert fit.cost == pytest.approx(costs[0], rel=1e-6)
    assert costs[0] < costs[1]
    variances = np.einsum("kaa->ka", covariance).real
    assert default.cost == pytest.approx(np.sum(np.abs(stacks[1]) ** 2 / variances), rel=1e-6)
    assert "the variances alone" in default.weight_choice


def test_modes_are_told_once_and_where_they_are_largest():
    fit, _, _ = fitted(2, 3, level=0.001)
    rows = mode_table(fit, rid.fits.fit_covariance(fit))
    assert [(row.count, row.multiplicity) for row in rows] == [(2, 2)] * 3
    np.testing.assert_allclose([row.hz for row in rows], np.abs(POLES) / (2 * np.pi), rtol=1e-3)
    assert all(0 < row.hz_std < 0.01 * row.hz for row in rows)
    values = np.abs(fit.fraction.response(np.abs(POLES)))
    peaks = values / values.max(axis=0)
    assert {(row.output, row.input) for row in rows} <= set(np.ndindex(2, 3))
    for k, row in enumerate(rows):
        assert peaks[k, row.output, row.input] > 0.5


def test_deviations_are_those_of_the_column():
    fit, _, _ = fitted(2, 2, level=0.01, restart=False)
    std = rid.fits.fit_covariance(fit).response_std(POINTS)
    column = rid.FrequencyResponse(OMEGA, fit.problem.values)
    other = rid.fits.fit_covariance(rid.fit_mfd(column, order=6, feedthrough=True, restart=False))
    np.testing.assert_allclose(std.reshape(-1, 4, 1), other.response_std(POINTS), rtol=1e-5)


def test_the_page_says_what_is_shared(tmp_path):
    fit, _, _ = fitted(2, 3, level=0.01, restart=False)
    assert "order 6 shared by all entries, 12 states, 2x3" in repr(fit)
    rid.write_report(fit, tmp_path / "fit.html")
    page = (tmp_path / "fit.html").read_text(encoding="utf-8")
    assert "6 poles that all entries share, residues of any rank: 12 states" in page
    assert "take long" not in page


@pytest.mark.parametrize(("tied", "words"), [(False, "one standard deviation"), (True, "take long")])
def test_a_page_leaves_deviations_of_many_residues_out_where_constraints_tie_them_and_says_so(
    tmp_path, monkeypatch, tied, words
):
    monkeypatch.setattr("robustid.report.fit_view._WORK", 1e3)
    gain = plant(2, 2)[0](np.zeros(1))[0].real
    fit, _, _ = fitted(2, 2, level=0.01, restart=False, constraints=[StaticGain(gain)] * tied)
    assert fit.status.converged
    rid.write_report(fit, tmp_path / "fit.html")
    assert words in (tmp_path / "fit.html").read_text(encoding="utf-8")


def test_poles_and_models_are_starts():
    fit, _, poles = fitted(2, 2, level=0.01)
    frf = rid.FrequencyResponse(OMEGA, fit.problem.values.reshape(-1, 2, 2))
    options = {"order": 6, "form": "shared", "feedthrough": True, "restart": False}
    for start in (poles * 1.01, poles[:3] * 1.01, fit.model):  # with conjugates, without, and twice each
        other = rid.fit_mfd(frf, start=start, **options)
        assert other.cost == pytest.approx(fit.cost, rel=1e-6)
        assert other.cost <= (1 + 1e-12) * other.start_cost
    with pytest.raises(InputError, match="must have the inputs and outputs"):
        rid.fit_mfd(frf, start=control.rss(6, 3, 2), **options)


def test_constraints_hold_in_every_entry():
    response, _ = plant(2, 3, feedthrough=False)
    omega = OMEGA[::2]
    frf = rid.FrequencyResponse(omega, noisy(np.random.default_rng(0), response(omega), 0.01))
    gain = np.arange(6.0).reshape(2, 3) / 10
    options = {"order": 6, "form": "shared", "restart": False}
    held = rid.fit_mfd(frf, constraints=[rid.fits.StaticGain(gain)], **options)
    np.testing.assert_allclose(held.fraction.response(np.zeros(1))[0].real, gain, atol=1e-9)
    mask = gain == 0.4
    empty = rid.fit_mfd(frf, constraints=[rid.fits.ZeroEntries(mask)], **options)
    np.testing.assert_array_equal(np.all(np.abs(empty.fraction.response(POINTS)) < 1e-12, axis=0), mask)
    steep = rid.fit_mfd(frf, constraints=[rid.fits.RollOff(2)], **options)
    far = np.abs(steep.fraction.response(np.array([1e6, 2e6])))
    np.testing.assert_allclose(far[0] / far[1], 4, rtol=1e-2)


def test_misuse_is_named():
    response, _ = plant(2, 3)
    frf = rid.FrequencyResponse(OMEGA, response(OMEGA))
    weight = np.ones((OMEGA.size, 2, 3))
    weight[:, 1, 2] = 0
    for options, message in [
        ({"form": "common"}, '`form` must be "right", "left" or "shared"'),
        ({"rigid_body": rid.RigidBody(1)}, '`form` must be "right" for rigid-body modes'),
        ({"constraints": [rid.fits.Zero(1.0, [1.0, 0.0])]}, "`direction` of a zero ties"),
        ({"constraints": [rid.fits.StaticGain(np.eye(2))]}, r"`gain` must have shape \(ny, nu\) = \(2, 3\)"),
        ({"weight": weight}, "`weight` is zero for all of the entry from u3 to y2"),
        ({"order": 300}, "free coefficients"),
    ]:
        with pytest.raises(InputError, match=message):
            rid.fit_mfd(frf, **{"order": 6, "form": "shared", **options})
