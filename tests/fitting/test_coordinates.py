"""Deviations of fits whose entries share poles: entry by entry against all coefficients together."""

import numpy as np
import pytest

import robustid as rid
from robustid.fitting import StaticGain, Weight
from robustid.fitting.fraction.coordinates import EntryCoordinates, JointCoordinates
from support.mfd_systems import noisy, random_modal_system

OMEGA = 2 * np.pi * np.geomspace(4, 400, 90)
BETWEEN = np.geomspace(20, 3000, 31)


def fitted(ny, nu, dt=None, order=6, level=0.01, **options):
    system = random_modal_system(3, ny, nu, 3, band_hz=(5, 300), damping=(0.005, 0.05))
    values = system.response(1j * OMEGA)
    values = noisy(np.random.default_rng(1), values, level) if level else values
    frf = rid.FrequencyResponse(OMEGA, values, dt=dt)
    return rid.fit_mfd(frf, order=order, **{"form": "shared", "restart": False} | options)


def both(fit):
    """The coordinates entry by entry, and those of all coefficients together."""
    basis = fit.problem.basis(fit.nodes.denominators, fit.nodes.response)
    found = rid.fits.fit_covariance(fit).coordinates
    assert isinstance(found, EntryCoordinates)
    return found, JointCoordinates(basis, fit.problem.forbidden(basis, fit.nodes))


@pytest.mark.parametrize(
    ("size", "options"),
    [
        ((2, 2), {"feedthrough": True}),
        ((1, 3), {}),
        ((3, 2), {"dt": 5e-4, "feedthrough": True}),
        ((3, 1), {"form": "right"}),
    ],
)
def test_entry_by_entry_is_all_together(size, options):
    fit = fitted(*size, **options)
    one, other = both(fit)
    assert one.parameters == other.parameters
    for mine, theirs in zip(one.pole_changes(fit), other.pole_changes(fit), strict=True):
        reduced = (np.linalg.norm(part, axis=1) if part.ndim == 2 else part for part in (mine, theirs))
        np.testing.assert_allclose(*reduced, rtol=1e-10)
    points = (1j * BETWEEN if fit.problem.dt is None else np.exp(1j * BETWEEN * fit.problem.dt)) / fit.fraction.scale
    D, P = fit.fraction.denominator(points * fit.fraction.scale), fit.fraction.fitted(fit.fraction.response(BETWEEN))
    np.testing.assert_allclose(one.response_std(points, D, P), other.response_std(points, D, P), rtol=1e-10)


def test_points_without_weight_say_nothing_of_their_entry():
    entries = np.ones((OMEGA.size, 2, 2))
    entries[20:60, 0, 1] = 0.0
    fit = fitted(2, 2, weight=Weight(entries))
    one, other = both(fit)
    parts = fit.problem.xi, fit.nodes.denominators, fit.nodes.response
    std = one.response_std(*parts)
    np.testing.assert_allclose(std, other.response_std(*parts), rtol=1e-10)
    whole = rid.fits.fit_covariance(fitted(2, 2, weight=Weight(np.ones(entries.shape))), noise=1.0).coordinates
    assert np.median(std[20:60, 1, 0]) > 1.2 * np.median(whole.response_std(*parts)[20:60, 1, 0])


def test_poles_that_cancel_in_every_entry_are_not_determined():
    """Six states for a response of four: the surplus pair is at no place, the others are where they are."""
    s = 1j * OMEGA[:, None, None]
    first, second = np.array([[1.0, 0.3], [0.5, 2.0]]), np.array([[0.4, -1.0], [1.0, 0.2]])
    values = first / (s**2 + 2 * s + 200**2) + second / (s**2 + 9 * s + 900**2)
    fit = rid.fit_mfd(rid.FrequencyResponse(OMEGA, values), order=6, form="shared", restart=False)
    found = rid.fits.fit_covariance(fit, noise=1.0)
    one, other = both(fit)
    assert np.sum(np.isinf(found.pole_std)) == 2
    np.testing.assert_array_equal(one.pole_changes(fit)[2], other.pole_changes(fit)[2])
    kept = np.isfinite(found.pole_std)
    deviations = [np.linalg.norm(c.pole_changes(fit)[1][kept], axis=1) for c in (one, other)]
    np.testing.assert_allclose(*deviations, rtol=1e-6)


def test_what_ties_entries_is_taken_together():
    fit = fitted(2, 2, constraints=[StaticGain(np.ones((2, 2)))])
    assert not fit.problem.entries_apart
    assert isinstance(rid.fits.fit_covariance(fit).coordinates, JointCoordinates)
    assert not fitted(2, 2, form="right").problem.entries_apart
