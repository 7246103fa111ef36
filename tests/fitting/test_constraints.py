"""Linear constraints on a fraction: they hold in the model that is returned, and the condition number stays one."""

import functools

import numpy as np
import pytest

import robustid as rid
from robustid.errors import InputTypeError
from robustid.fitting import RollOff, StaticGain, Zero, ZeroEntries, fit_mfd, suggest_order
from support.cases import slow
from support.mfd_systems import noisy, random_modal_system, relative_error
from support.pairwise import every_one
from support.refusals import refusals

OMEGA = 2 * np.pi * np.geomspace(4, 1200, 100)
POINTS = [-30000.0, 2 * np.pi * 2000j, -500.0 + 2 * np.pi * 2500j]  # beyond the band: within it the data say otherwise

# A real and a complex point, and both forms; the other combinations are slow.
FORMS_AND_POINTS = [
    pytest.param(
        form,
        point,
        marks=() if point is not POINTS[1] and (form == "left") == (point is POINTS[2]) else pytest.mark.slow,
    )
    for form in ("right", "left")
    for point in POINTS
]


def data(seed, ny, nu, modes, dt=None):
    system = random_modal_system(seed, ny, nu, modes, dt=dt)
    points = 1j * OMEGA if dt is None else np.exp(1j * OMEGA * dt)
    truth = system.response(points)
    return system, truth, rid.FrequencyResponse(OMEGA, noisy(np.random.default_rng([seed, 1]), truth), dt=dt)


def fitted(frf, truth, order, constraints, **settings):
    """The fit, checked for what holds whatever the constraints are."""
    fit = fit_mfd(frf, order=order, weight=100 / np.abs(truth), constraints=constraints, **settings)
    assert np.all(fit.condition_numbers - 1 <= 1e-11)
    assert fit.cost <= fit.start_cost
    assert fit.model.nstates == order
    return fit


def response(model, point):
    A, B, C, D = (np.asarray(M) for M in (model.A, model.B, model.C, model.D))
    return C @ np.linalg.solve(point * np.eye(len(A)) - A, B.astype(complex)) + D


def size(fit):
    """Largest response on the lines: what 1e-9 is relative to."""
    return np.abs(fit.fraction.response(OMEGA)).max()


@pytest.mark.parametrize("seeds", [1, pytest.param(2, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("form", "ny", "nu", "dt"),
    every_one(["right", "left"], [(1, 1, None), (2, 3, None), (3, 2, None), (2, 2, 1 / 4000)]),
)
def test_static_gain(form, ny, nu, dt, seeds):
    """Prescribed 0.2 % off the truth: held to 1e-9, and all else fits as well as the noise allows."""
    for seed in range(seeds):
        system, truth, frf = data(seed, ny, nu, 4 if dt else 6, dt=dt)
        gain = 1.002 * system.response(np.full(1, 1.0 if dt else 0.0))[0].real
        fit = fitted(frf, truth, system.order, [StaticGain(gain)], form=form, feedthrough=dt is not None)
        assert np.abs(response(fit.model, 1.0 if dt else 0.0) - gain).max() <= 1e-9 * np.abs(gain).max()
        assert relative_error(fit.fraction.response(OMEGA), truth) <= 1e-2


@pytest.mark.parametrize(("form", "point"), FORMS_AND_POINTS)
def test_blocking_zero(form, point):
    """The whole response vanishes at real, imaginary and complex points, and at the conjugate."""
    _, truth, frf = data(2, 2, 2, 3)
    fit = fitted(frf, truth, 6, [Zero(point)], form=form, stable=False, restart=False)
    assert size(fit) >= 0.1 * np.abs(truth).max()  # zero everywhere would do, too
    for each in (point, np.conj(point)):
        assert np.abs(response(fit.model, each)).max() <= 1e-9 * size(fit)


@pytest.mark.parametrize(("form", "point"), FORMS_AND_POINTS)
def test_zero_with_direction(form, point):
    """direction P = 0 for a right fraction, P direction = 0 for a left one, and not the whole P."""
    _, truth, frf = data(3, 2, 2, 2)
    direction = np.array([1.0, -2.0])
    fit = fitted(frf, truth, 4, [Zero(point, direction)], form=form, stable=False, restart=False)
    P = response(fit.model, point)
    left = direction @ P if form == "right" else P @ direction
    assert np.abs(left).max() <= 1e-9 * size(fit)
    assert np.abs(P).max() >= 1e3 * np.abs(left).max()


@pytest.mark.parametrize("seeds", [1, slow(2)])
@pytest.mark.parametrize(("form", "degree"), [("right", 2), ("left", 3), slow("left", 2), slow("right", 3)])
def test_roll_off(form, degree, seeds):
    """|P| falls like 1/|s|^degree: the first Markov parameters vanish."""
    for seed in range(seeds):
        _, truth, frf = data(seed, 2, 2, 4)
        fit = fitted(frf, truth, 8, [RollOff(degree)], form=form, restart=False)
        A, B, C, D = (np.asarray(M) for M in (fit.model.A, fit.model.B, fit.model.C, fit.model.D))
        assert not np.any(D)
        unit = OMEGA.max()
        markov = [np.abs(C @ np.linalg.matrix_power(A / unit, k) @ B / unit).max() for k in range(degree)]
        assert max(markov[: degree - 1]) <= 1e-9 * size(fit)
        assert markov[degree - 1] >= 1e-6 * size(fit)


def test_undamped_modes_roll_off_by_themselves():
    """Position over force: with roll-off 2 the model's error is at the floor, beyond the band too (3 seeds of 3)."""
    far = 10 * OMEGA[-1:]
    for seed in range(3):
        system, truth, frf = data(seed, 2, 2, 4)
        fit = fitted(frf, truth, 8, [RollOff(2)])
        assert relative_error(fit.fraction.response(OMEGA), truth) <= 3e-3
        assert relative_error(fit.fraction.response(far), system.response(1j * far)) <= 2e-2


@pytest.mark.parametrize("form", ["right", "left"])
def test_zero_entries(form):
    """A block-triangular machine: the entry is zero at any point, in the state space too; the others are fitted."""
    upper, lower = (random_modal_system(seed, 2, 1, 3) for seed in (1, 2))
    truth = np.zeros((OMEGA.size, 2, 2), dtype=complex)
    truth[:, :, :1] = upper.response(1j * OMEGA)
    truth[:, 1:, 1:] = lower.response(1j * OMEGA)[:, :1]
    mask = np.array([[False, True], [False, False]])
    values = noisy(np.random.default_rng(0), truth)
    weight = 100 / np.where(mask, 1.0, np.abs(truth) + mask)
    frf = rid.FrequencyResponse(OMEGA, values)
    fit = fit_mfd(frf, order=12, weight=weight, constraints=[ZeroEntries(mask)], form=form)
    assert np.all(fit.condition_numbers - 1 <= 1e-11)
    for point in (0.0, 1j * OMEGA[70], -200.0 + 500j):
        P = response(fit.model, point)
        assert np.abs(P[mask]).max() <= 1e-9 * np.abs(P).max()
    assert relative_error(fit.fraction.response(OMEGA), truth) <= 5e-3


@pytest.mark.parametrize("seeds", [1, pytest.param(2, marks=pytest.mark.slow)])
@pytest.mark.parametrize("form", ["right", pytest.param("left", marks=pytest.mark.slow)])
def test_combined(form, seeds):
    for seed in range(seeds):
        system, truth, frf = data(seed, 2, 2, 4)
        gain = 1.002 * system.response(np.zeros(1))[0].real
        direction = np.array([1.0, 1.0])
        point = -500.0 + 15000j
        fit = fitted(frf, truth, 8, [RollOff(2), StaticGain(gain), Zero(point, direction)], form=form, restart=False)
        assert np.abs(response(fit.model, 0.0) - gain).max() <= 1e-9 * size(fit)
        P = response(fit.model, point)
        assert np.abs(direction @ P if form == "right" else P @ direction).max() <= 1e-9 * size(fit)
        assert np.abs(np.asarray(fit.model.C) @ np.asarray(fit.model.B)).max() <= 1e-9 * size(fit) * OMEGA.max()


@pytest.mark.parametrize(("seeds", "modes"), [(3, 2), slow(10, 4)])
def test_true_constraints_cost_no_more_than_their_degrees_of_freedom(seeds, modes):
    """Static gain of the truth, 2x2: the cost rises by 4 in the mean, chi squared of 4; so many realisations, below 12."""
    system, truth, _ = data(5, 2, 2, modes)
    gain, rises = system.response(np.zeros(1))[0].real, []
    for seed in range(seeds):
        frf = rid.FrequencyResponse(OMEGA, noisy(np.random.default_rng(seed), truth))
        free = fitted(frf, truth, 2 * modes, [])
        rises.append(fitted(frf, truth, 2 * modes, [StaticGain(gain)]).cost - free.cost)
    assert min(rises) >= -1e-3
    assert 0.3 <= np.mean(rises) <= 12  # |e|^2 = 1 per complex number: half a unit per real constraint


def asked(*constraints, **options):
    return fit_mfd(data(0, 1, 1, 2)[2], order=4, constraints=constraints, **options)


test_contradictory_or_wrong = refusals(
    (lambda: asked(StaticGain([[1.0]]), StaticGain([[2.0]])), "contradict"),
    (lambda: asked(StaticGain([[1.0]]), Zero(0.0)), "contradict"),
    (lambda: asked(StaticGain([[1.0, 2.0]])), "gain"),
    (lambda: asked(Zero(1j, direction=[1.0, 2.0])), "direction"),
    (lambda: asked(RollOff(5)), "degree"),
    (
        lambda: asked(Zero(2e4j), Zero(3e4j)),
        "order is too small",
    ),  # four real conditions on four states: zero everywhere
    (lambda: asked(ZeroEntries(np.zeros((2, 2), dtype=bool))), "mask"),
    (lambda: asked(RollOff(2), feedthrough=True), "feedthrough"),
    (lambda: asked(StaticGain([[1.0]]), method="iv"), "iv"),  # instruments take none
    (lambda: Zero(np.inf), "point"),
    (lambda: RollOff(0), "degree"),
    (lambda: StaticGain([1.0, 2.0]), "gain"),
    (lambda: StaticGain([[np.nan]]), "gain"),
    (lambda: ZeroEntries(np.zeros((2, 2))), "mask", (rid.InputError, InputTypeError)),
    (lambda: Zero("a"), "`point` must be a number", (rid.InputError, InputTypeError)),
)

test_what_is_no_sequence_of_constraints_is_refused = refusals(
    *(
        ((ask, constraints), f"`constraints` must be a sequence .* got {got}", InputTypeError)
        for constraints, got in ((None, "NoneType"), (RollOff(2), "RollOff"), ([3], "int"))
        for ask in (functools.partial(fit_mfd, order=4), suggest_order)
    ),
    of=lambda ask, constraints: ask(data(0, 1, 1, 2)[2], constraints=constraints),
)
