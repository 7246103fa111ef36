"""Passive classes: positive real and bounded real, against Pick's theorem, Harnack's inequality, and bad input."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.advice import diagnose
from robustid.errors import SizeError
from robustid.identification import verify_margin_exactly
from support.cases import seeds, slow
from support.passive import reactance, scattering, smallest_factor


def problem_of(omega, values, bound, prior, **more):
    return rid.MixedProblem(frequency=rid.FrequencyResponse(omega, values, bound=bound), prior=prior, **more)


def random_data(seed, ports):
    """Data far from any passive plant: margins of about 1 to 5."""
    rng = np.random.default_rng(seed)
    count = 5 if ports == 1 else 3
    values = rng.standard_normal((count, ports, ports)) + 1j * rng.standard_normal((count, ports, ports))
    omega, decay = np.sort(rng.uniform(5, 30, count)), float(rng.uniform(2, 8))
    return omega, values + 0.5 * np.eye(ports), rng.uniform(0.3, 1, values.shape), decay, float(rng.choice([0, 0.1]))


@pytest.mark.parametrize("ports", [1, 2])
@pytest.mark.parametrize("kind", [rid.PositiveReal, rid.NegativeImaginary, rid.BoundedReal])
@pytest.mark.parametrize("seed", seeds(1, 60))
def test_margins_against_pick(seed, kind, ports):
    omega, values, bound, decay, slack = random_data(seed, ports)
    by = (1j * omega)[:, None, None] if kind is rid.NegativeImaginary else 1.0
    bounded = kind is rid.BoundedReal
    prior = kind(decay=decay) if bounded else kind(decay=decay, slack=slack)
    found = rid.identify(problem_of(omega, values / by, bound / np.abs(by), prior), accuracy=1e-6)
    assert found.verification.passed
    expected = smallest_factor(omega, values, bound, decay, slack=0.0 if bounded else slack, bounded=bounded)
    assert found.margin == pytest.approx(expected, rel=1e-5)
    if kind is rid.PositiveReal:
        assert found.margin_lower <= expected * (1 + 1e-6)
    if kind is rid.NegativeImaginary:
        assert found.order == 2 * omega.size * ports + ports  # the integrators once


def test_the_structured_and_the_general_solver_agree_and_the_scale_has_no_influence():
    omega, values, bound, decay, slack = random_data(7, 1)
    margins = []
    for scale, solver in ((None, "structured"), (None, "cvxpy"), (0.3, "structured"), (30.0, "structured")):
        prior = rid.PositiveReal(decay=decay, slack=slack, gain_bound=scale)
        margins.append(rid.identify(problem_of(omega, values, bound, prior), solver=solver, accuracy=1e-7).margin)
    assert margins == pytest.approx([margins[0]] * 4, rel=1e-6)


def test_one_real_value_and_the_set_at_another_frequency():
    # With F(0) = 1, F = (1 + b E)/(1 - b E), b = s/(s + 2 decay), E any real function of the unit ball: its values fill a lens.
    decay, omega = 2.0, 3.0
    found = rid.identify(problem_of([0.0], [1.0], 1e-7, rid.PositiveReal(decay=decay)))
    error = rid.worst_case_error(found, omega=[omega], directions=24, rtol=1e-3)
    b, zeta = 1j * omega / (1j * omega + 2 * decay), (1 - 1j * omega - decay) / (1 + 1j * omega + decay)
    v = np.exp(2j * np.pi * np.arange(4000) / 4000)[:, None] * np.linspace(0, 1, 400)
    v = v[np.abs(v.imag) * abs(1 - zeta**2) <= np.abs(1 - v**2) * abs(zeta.imag) + 1e-12]
    values = (1 + b * v) / (1 - b * v)
    corners = error.values[0].vertices
    for angle in np.arange(24) * np.pi / 12:
        turn = np.exp(-1j * angle)
        assert (turn * corners).real.max() == pytest.approx((turn * values).real.max(), abs=0.03)
        assert (turn * corners).real.max() >= (turn * values).real.max() - 1e-9
    assert np.abs(corners).max() <= (1 + abs(b)) / (1 - abs(b)) * 1.02  # Harnack's disc


@pytest.mark.parametrize("ports", [1, 2])
def test_lossless_data_with_little_noise(ports):
    # At the edge of the class: the Pick matrix of exact data is rank deficient.
    rng = np.random.default_rng(ports)
    decay, omega = 1.0, np.linspace(0.5, 8, 9)
    truth = reactance(rng, ports, decay, 2)
    values = truth(1j * omega)
    bound = 1e-5 * np.abs(values).max()
    noise = bound * np.exp(2j * np.pi * rng.random(values.shape))
    found = rid.identify(problem_of(omega, values + noise, bound * 1.001, rid.PositiveReal(decay=decay)))
    assert found.margin <= 1
    assert found.margin_lower > 0.05
    assert found.verification.passed
    assert verify_margin_exactly(found.certificate, found.formulation.rows, found.formulation.sarason)
    away = np.abs(found.model(3.1j) - truth(np.array([3.1j]))[0]).max()
    assert away < 0.02 * np.abs(values).max()  # hardly any other function is left


def test_the_model_is_positive_real_left_of_the_axis():
    rng = np.random.default_rng(5)
    decay, omega = 1.5, np.linspace(0.5, 8, 7)
    truth = reactance(rng, 2, decay, 3, loss=0.4)
    found = rid.identify(problem_of(omega, truth(1j * omega), 0.05, rid.PositiveReal(decay=decay))).require()
    s = -decay + 1j * np.concatenate([np.linspace(0, 20, 400), np.geomspace(20, 1e5, 50)])
    values = np.moveaxis(found.model(s), 2, 0)
    least = np.linalg.eigvalsh((values + values.conj().transpose(0, 2, 1)) / 2)[:, 0]
    assert least.min() > -1e-9 * np.abs(values).max()
    assert np.linalg.eigvals(found.model.A).real.max() < -decay


def test_classes_of_discrete_time():
    rng = np.random.default_rng(2)
    dt, rho, angles = 0.01, 1.1, np.linspace(0.3, 2.8, 6)
    q = np.exp(-1j * angles)
    values = 1 + 2 * sum(c * (0.8 * q) ** k for k, c in enumerate(rng.uniform(-0.2, 0.3, 3), 1))
    frf = rid.FrequencyResponse(angles / dt, values, bound=0.01, dt=dt)
    for prior in (rid.PositiveReal(decay_rate=rho), rid.PositiveReal(decay=np.log(rho) / dt)):
        found = rid.identify(rid.MixedProblem(frequency=frf, prior=prior)).require()
        assert found.prior.decay_rate == pytest.approx(rho)
        model = found.model(np.exp(1j * np.linspace(0, np.pi, 200)) / rho)
        assert model.real.min() > -1e-9
    assert rid.identify(rid.MixedProblem(frequency=dataclasses.replace(frf, values=-values), prior=prior)).margin > 1


def mobility(seed):
    """Modes of 1 % damping, a positive-real rest that decays fast, and noise at the ends of the bounds."""
    rng = np.random.default_rng(seed)
    w, zeta, c = np.array([5.0, 12.0]), np.array([0.01, 0.008]), rng.uniform(0.5, 1, 2)
    rest = reactance(rng, 1, 4.0, 2, size=20.0, loss=1.0)
    omega = np.sort(np.concatenate([rng.uniform(2, 16, 5), w * (1 + rng.uniform(-0.01, 0.01, 2))]))

    def at(s):
        s = np.asarray(s)
        return (c * s[:, None] / (s[:, None] ** 2 + 2 * zeta * w * s[:, None] + w**2)).sum(1) + rest(s)[:, 0, 0]

    bound = 0.03 * np.abs(at(1j * omega))
    values = at(1j * omega) + bound * np.exp(2j * np.pi * rng.random(omega.size))
    return at, omega, values, 1.001 * bound, rid.passive.passive_modes(w, zeta)


@pytest.mark.parametrize("seed", seeds(1, 30))
def test_lightly_damped_modes_beside_a_positive_real_rest(seed):
    truth, omega, values, bound, modes = mobility(seed)
    problem = problem_of(omega, values, bound, rid.PositiveReal(decay=4.0), parametric=modes)
    found = rid.identify(problem, accuracy=1e-6).require()
    functions = functions_of(modes, omega)
    expected = smallest_factor(omega, values[:, None, None], bound[:, None, None], 4.0, modes=functions)
    assert found.margin == pytest.approx(expected, rel=1e-5, abs=1e-6)
    assert np.all(found.parameters[:-1] >= 0)
    error = rid.worst_case_error(found, omega=[5.02], directions=4, rtol=0.2)
    away = np.abs(found.model(1j * error.omega) - truth(1j * error.omega))
    assert np.all(away <= error.upper[:, 0, 0] * (1 + 1e-9))
    assert error.verify()
    if not seed:
        assert rid.identify(problem.with_prior(rate=4.0)).margin == pytest.approx(found.margin, abs=1e-4)
        assert rid.identify(problem_of(omega, values, bound, rid.PositiveReal(decay=4.0))).margin > 2


def transfer_mobility(seed, points=3):
    """Two ports: modes of 1 % damping with one shape each (residues of rank one), a positive-real rest, noise at its bounds."""
    rng = np.random.default_rng(seed)
    w, zeta = np.array([5.0, 12.0]), np.array([0.01, 0.008])
    shapes = rng.uniform(0.5, 1, (2, 2)) * np.array([[1, 1], [1, -1]])
    residues = shapes[:, :, None] * shapes[:, None, :]
    rest = reactance(rng, 2, 4.0, 2, size=20.0, loss=1.0)
    omega = np.sort(np.concatenate([rng.uniform(2, 16, points), w * (1 + rng.uniform(-0.01, 0.01, 2))]))

    def at(s):
        s = np.asarray(s)
        functions = s[:, None] / (s[:, None] ** 2 + 2 * zeta * w * s[:, None] + w**2)
        return np.einsum("fk,kij->fij", functions, residues) + rest(s)

    truth = at(1j * omega)
    bound = 0.03 * np.abs(truth)
    values = truth + bound * np.exp(2j * np.pi * rng.random(bound.shape))
    return at, omega, values, 1.001 * bound, rid.passive.passive_modes(w, zeta)


def functions_of(modes, omega):
    """The two functions of every pair, (F, m)."""
    d, w, s = -modes.poles.real[::2], np.abs(modes.poles[::2]), 1j * omega[:, None]
    functions = np.stack([2 * d * s, 2 * d * (s + 2 * d)], axis=2) / (s**2 + 2 * d * s + w**2)[..., None]
    return functions.reshape(omega.size, -1)


@pytest.mark.parametrize(("seed", "points"), [(0, 1), *(slow(seed, 3) for seed in range(20))])
def test_modes_of_several_ports_beside_a_positive_real_rest(seed, points):
    """The class holds that of positive semidefinite residues: its margin is at most as large, and the truth is in its band."""
    truth, omega, values, bound, modes = transfer_mobility(seed, points)
    problem = problem_of(omega, values, bound, rid.PositiveReal(decay=4.0), parametric=modes)
    found = rid.identify(problem).require()
    functions = functions_of(modes, omega)
    size = np.abs(functions).max(axis=0)  # coefficients of about one: the general solver loses digits else
    functions, ends = functions / size, found.problem.parameter_bounds[:-1] * size[:, None, None, None]
    inside = smallest_factor(omega, values, bound, 4.0, modes=functions)
    relaxed = smallest_factor(omega, values, bound, 4.0, modes=functions, ends=ends)
    assert found.margin == pytest.approx(relaxed, rel=1e-5, abs=1e-6)
    assert found.margin <= inside * (1 + 1e-5)
    error = rid.worst_case_error(found, omega=[5.02], directions=4, rtol=0.2 if points > 1 else 0.8)
    away = np.abs(np.moveaxis(found.model(1j * error.omega), 2, 0) - truth(1j * error.omega))
    assert np.all(away <= error.upper * (1 + 1e-9))
    assert error.verify()
    if not seed:
        assert rid.identify(problem_of(omega, values, bound, rid.PositiveReal(decay=4.0))).margin > 2


def test_what_contradicts_a_class_is_said():
    rng = np.random.default_rng(9)
    omega = np.linspace(0.5, 8, 7)
    values = reactance(rng, 1, 1.0, 3, loss=0.5)(1j * omega)[:, 0, 0]
    one = values.copy()
    one[4] -= 2 * one[4].real  # negative resistance at one frequency point
    found = rid.identify(problem_of(omega, one, 1e-3, rid.PositiveReal(decay=1.0)))
    assert found.status is rid.Status.INCONSISTENT
    words = diagnose(found).summary()
    assert f"not passive at 1 of 7 frequency points by themselves, most at {omega[4] / (2 * np.pi):.5g} Hz" in words
    for factor, change in ((-1, "opposite sign"), (1 / (1j * omega), "times j omega"), (1j * omega, "over j omega")):
        found = diagnose(rid.identify(problem_of(omega, values * factor, 1e-3, rid.PositiveReal(decay=1.0))))
        assert change in found.best().name
        assert found.best().margin < 1
    velocity = rid.identify(problem_of(omega, values, 1e-3, rid.NegativeImaginary(decay=1.0)))
    assert "of a velocity the displacement" in diagnose(velocity).best().name
    reflected = scattering(reactance(rng, 1, 1.0, 3, loss=0.5))(1j * omega)[:, 0, 0]
    found = diagnose(rid.identify(problem_of(omega, reflected.conj(), 1e-3, rid.BoundedReal(decay=1.0))))
    assert "exp(-j omega t)" in found.best().name
    assert found.best().margin < 1
    loud = diagnose(rid.identify(problem_of(omega, 40 * reflected, 1e-3, rid.BoundedReal(decay=1.0))))
    assert "magnitude is above 1" in loud.summary()
    assert "are they impedances?" in loud.summary()
    decibels = 20 * np.log10(np.abs(values))
    for prior in (rid.PositiveReal(decay=1.0), rid.BoundedReal(decay=1.0)):
        found = rid.identify(problem_of(omega, decibels, 0.1, prior))
        assert "in decibels perhaps" in diagnose(found).summary()


OMEGA, VALUES, BOUND, DECAY, _ = random_data(0, 1)
PASSIVE, RECORD = rid.PositiveReal(decay=DECAY), rid.TimeRecord(np.ones(4), np.ones(4), dt=0.1, bound=0.1)
SAMPLED = rid.FrequencyResponse(OMEGA, VALUES, bound=BOUND, dt=0.01)
MODES, PAIR, MANY = rid.passive.passive_modes(10.0, 0.1), rid.kautz(10.0, 0.1, dt=0), np.linspace(1, 100, 300)
ONES, ONE_MISSING = np.ones((OMEGA.size, 2, 2)), np.tile([[0.1, np.inf], [0.1, 0.1]], (OMEGA.size, 1, 1))


def posed_by(prior, values=VALUES, bound=3 * BOUND, omega=OMEGA, **more):
    return lambda: problem_of(omega, values, bound, prior, **more)


def answered(**more):
    return rid.identify(problem_of(OMEGA, VALUES, 3 * BOUND, PASSIVE), **more)


@pytest.mark.parametrize(
    ("words", "call"),
    [
        (r"`decay_rate` .* or `decay` .* must be given", rid.PositiveReal),
        ("one of continuous time", lambda: rid.NegativeImaginary(decay_rate=1.1)),
        ("BoundedReal class is 1", lambda: rid.BoundedReal(decay=1.0, gain_bound=2.0)),
        ("`scaling` has no meaning", lambda: rid.PositiveReal(decay=1.0, scaling=[[1.0]])),
        ("have a sample time", lambda: rid.MixedProblem(frequency=SAMPLED, prior=rid.NegativeImaginary(decay=1.0))),
        ("takes frequency responses", lambda: rid.MixedProblem(time=RECORD, prior=PASSIVE)),
        ("data are of continuous time", posed_by(rid.PositiveReal(decay_rate=1.1))),
        ("point at omega = 0, of which", posed_by(rid.NegativeImaginary(decay=1.0), omega=OMEGA - OMEGA[0])),
        ("`parametric` can't be joined", posed_by(PASSIVE, parametric=PAIR)),
        ("`parametric` can't be joined", posed_by(rid.BoundedReal(decay=1.0), parametric=PAIR)),
        ("as many inputs as outputs", posed_by(PASSIVE, ONES[:, :, :1], 1.0)),
        ("as many inputs as outputs", posed_by(rid.BoundedReal(decay=1.0), ONES[:, :, :1], 1.0)),
        ("`parameter_bounds` has no place", posed_by(PASSIVE, parametric=MODES, parameter_bounds=[[0, 1], [0, 1]])),
        ("PositiveReal", lambda: answered(form="sections")),
        ("PositiveReal", lambda: answered(objective="gain")),
        ("no point at which every entry", lambda: rid.identify(problem_of(OMEGA, ONES, ONE_MISSING, PASSIVE))),
        ("class of 1 port up to", lambda: rid.identify(problem_of(MANY, 1 / (1j * MANY + 3), 0.1, PASSIVE))),
        ("PositiveReal class, ", lambda: rid.suggest_prior(answered().problem)),
        ("PositiveReal class, ", lambda: rid.guarantee.diameter(answered().problem, omega=[1.0])),
        ("PositiveReal class, ", lambda: rid.worst_case_error(answered(), omega=[10.0], directions=3).weight()),
        ("closed form", lambda: answered().weyl_disc([1.0])),
    ],
)
def test_a_sentence_for_each(words, call):
    with pytest.raises(SizeError if "up to" in words else rid.InputError, match=words):
        call()
