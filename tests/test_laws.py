"""Laws that every result keeps, on problems that hypothesis makes: units, coordinates, order of channels, orders, more data."""

import control
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import robustid as rid

DT, DECAY = 0.01, 1.02
SEED, POWER = st.integers(0, 10**6), st.integers(-60, 60)
few = settings(max_examples=5, deadline=None)


def plant(rng, outputs=1, inputs=1, modes=2):
    """Discrete model of lightly damped modes: stable, strictly proper."""
    A, B, C = [], [], []
    for _ in range(modes):
        radius, turn = rng.uniform(0.6, 0.97), rng.uniform(0.3, 2.6)
        A.append(radius * np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]))
        B.append(rng.normal(size=(2, inputs)))
        C.append(rng.normal(size=(outputs, 2)))
    size = 2 * modes
    whole = np.zeros((size, size))
    for k, block in enumerate(A):
        whole[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = block
    return control.ss(whole, np.vstack(B), np.hstack(C), np.zeros((outputs, inputs)), DT)


def response(model, omega, radius=1.0):
    z = radius * np.exp(1j * omega * model.dt)
    resolvent = np.linalg.solve(z[:, None, None] * np.eye(model.nstates) - model.A, model.B)
    return model.C @ resolvent + model.D


def experiment(seed, shape=(1, 1), lines=8):
    """Statement of a class that the truth is in, with random noise at most as large as its bound; and the truth."""
    rng = np.random.default_rng(seed)
    omega = np.sort(rng.choice(np.arange(1, 40), lines, replace=False)) * (np.pi / DT / 40)
    truth = plant(rng, *shape)
    values = response(truth, omega)
    bound = 0.05 * np.abs(values).max()
    noise = bound * rng.random(values.shape) * np.exp(2j * np.pi * rng.random(values.shape))
    frf = rid.FrequencyResponse(omega, values + noise, bound=bound, dt=DT)
    on_border = response(truth, np.linspace(0, np.pi / DT, 2000), 1 / DECAY)
    return statement(frf, 1.05 * np.linalg.norm(on_border, 2, axis=(1, 2)).max()), truth


def statement(frf, gain):
    return rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=gain, decay_rate=DECAY))


@few
@given(seed=SEED, time=POWER, gain=POWER)
def test_units_scale_a_band_and_a_model_exactly(seed, time, gain):
    problem, _ = experiment(seed)
    frf, s, t = problem.frequency[0], 2.0**gain, 2.0**time
    scaled = rid.FrequencyResponse(frf.omega / t, frf.values * s, bound=frf.bound.radius * s, dt=frf.dt * t)
    other = statement(scaled, problem.prior.gain_bound * s)
    omega = np.linspace(0, np.pi / DT, 7)
    here, there = rid.band(problem, knots=30).at(omega), rid.band(other, knots=30).at(omega / t)
    for a, b in zip(here, there, strict=True):
        np.testing.assert_array_equal(a * s, b)
    first, second = rid.identify(problem), rid.identify(other)
    assert first.margin == second.margin
    np.testing.assert_array_equal(first.model.A, second.model.A)


@few
@given(seed=SEED, order=st.integers(1, 3))
def test_coordinates_of_the_states_change_no_reduction(seed, order):
    rng = np.random.default_rng(seed)
    model = plant(rng, 2, 2)
    T = np.linalg.qr(rng.normal(size=(4, 4)))[0] * 10 ** rng.uniform(-2, 2, 4)
    turned = control.ss(np.linalg.solve(T, model.A @ T), np.linalg.solve(T, model.B), model.C @ T, model.D, DT)
    one, two = (rid.balanced_truncation(m, order=order) for m in (model, turned))
    np.testing.assert_allclose(one.hankel, two.hankel, rtol=0, atol=1e-9 * one.hankel[0])
    omega = np.linspace(0, np.pi / DT, 50)
    np.testing.assert_allclose(response(one.model, omega), response(two.model, omega), atol=1e-6 * one.hankel[0])


@few
@given(seed=SEED, order=st.permutations(range(3)))
def test_permuted_outputs_give_permuted_answers(seed, order):
    problem, model = experiment(seed, (3, 1))
    frf, omega = problem.frequency[0], np.linspace(0, np.pi / DT, 7)
    turned = rid.FrequencyResponse(frf.omega, frf.values[:, order], bound=frf.bound.radius[:, order], dt=DT)
    other = statement(turned, problem.prior.gain_bound)
    here, there = rid.band(problem, knots=30).at(omega), rid.band(other, knots=30).at(omega)
    for a, b in zip(here, there, strict=True):
        np.testing.assert_allclose(a[:, order], b, rtol=1e-9)
    permuted = control.ss(model.A, model.B, model.C[list(order)], model.D[list(order)], DT)
    one, two = (rid.balanced_truncation(m, order=2) for m in (model, permuted))
    np.testing.assert_allclose(one.hankel, two.hankel, atol=1e-9 * one.hankel[0])


@few
@given(seed=SEED, dropped=st.integers(1, 6), share=st.floats(0.05, 0.5))
def test_more_data_never_lower_the_margin(seed, dropped, share):
    """In a class with a part of the gain of the truth, so that the bounds count."""
    problem, _ = experiment(seed)
    frf, gain = problem.frequency[0], share * problem.prior.gain_bound
    less, more = (rid.identify(statement(part, gain)) for part in (frf.select(np.arange(dropped, frf.omega.size)), frf))
    assert more.margin > 0
    assert more.margin >= less.margin_lower
    assert more.margin_lower >= less.margin_lower - 1e-4  # the accuracy of both
