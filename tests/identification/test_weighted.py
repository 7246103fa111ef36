"""Weighted classes, |G| <= K |W|: against the same problem divided by W, independent Pick matrices, and truths at the edge."""

import control
import numpy as np
import pytest

import robustid as rid
from robustid.core import response_at
from robustid.identification import PriorWeight, as_weight
from support.cases import seeds, slow
from support.half_plane import edge_truth
from support.passive import smallest_factor
from support.problems import identified

K, DECAY, CORNER = 2.0, 1.0, 6.0


def rolled(s, order=2, decay=DECAY, corner=CORNER):
    return (1 + (s + decay) / corner) ** -order


def prior(**more):
    return rid.Prior(**({"gain_bound": K, "decay": DECAY, "roll_off": 2, "corner": CORNER} | more))


def problem_of(omega, values, bound, a_prior, dt=None, **more):
    frf = rid.FrequencyResponse(omega, values, bound=bound, dt=dt)
    return rid.MixedProblem(frequency=frf, prior=a_prior, **more)


def truth_of(seed, count=8):
    """A mode beside W times an all-pass function of size K; its lines, inside their bounds; the basis of the mode."""
    rng = np.random.default_rng(seed)
    omega = np.sort(rng.uniform(0.5, 25, count))
    basis, p = rid.kautz([5.0], [0.02], dt=0), rng.standard_normal(2)
    ball = edge_truth(rng, K, DECAY, 5, CORNER)

    def plant(w):
        return rolled(1j * w) * ball(1j * w) + response_at(basis.matrices, 1j * w)[..., 0] @ p

    noise = 0.02 * np.sqrt(rng.uniform(0, 1, count)) * np.exp(2j * np.pi * rng.uniform(0, 1, count))
    return omega, plant(omega) + noise, 0.02, basis, plant


def lines(seed, count=5):
    rng = np.random.default_rng(seed)
    omega = np.sort(rng.uniform(0.2, 20, count))
    values = rng.standard_normal(count) + 1j * rng.standard_normal(count)
    return omega, values, rng.uniform(0.1, 0.6, count)


UNWEIGHTED = {"roll_off": None, "corner": None}
RATE = 1.2
STATED = control.zpk([0.1, -0.3 + 0.2j, -0.3 - 0.2j], [0.7, 0.2 + 0.6j, 0.2 - 0.6j], 0.4, dt=0.1)  # on the border
BIPROPER = control.zpk(*(np.array(part) / RATE for part in (STATED.zeros(), STATED.poles())), 0.4, dt=0.1)


@pytest.mark.parametrize(
    ("form", "dt"),
    [("orthonormal", None), ("orthonormal", 0.1), ("sections", None), slow("classical", 0.1), slow("taylor", 0.1)],
)
def test_a_constant_weight_is_another_gain_bound(form, dt):
    omega, values, bound = lines(0)
    time = {"dt": dt or 0}
    plain, weighted = (
        identified(problem_of(omega, values, bound, prior(**UNWEIGHTED, gain_bound=gain, weight=weight), dt), form=form)
        for gain, weight in ((3.0, None), (1.5, control.ss([], [], [], [[2.0]], **time)))
    )
    assert weighted.margin == pytest.approx(plain.margin, rel=1e-9, abs=1e-9)
    assert weighted.margin_lower == pytest.approx(plain.margin_lower, rel=1e-9, abs=1e-9)
    assert np.allclose(weighted.model(0.3), plain.model(0.3), rtol=1e-9)


@pytest.mark.parametrize("form", ["orthonormal", slow("classical"), slow("taylor"), slow("sections")])
def test_it_is_the_problem_divided_by_the_weight_in_discrete_time(form):
    omega, values, bound = lines(1)
    values = 0.4 * values
    weight = BIPROPER(np.exp(0.1j * omega))
    classes = [rid.Prior(gain_bound=K, decay_rate=RATE, weight=one) for one in (STATED, None)]
    whole = identified(problem_of(omega, values, bound, classes[0], 0.1), form=form)
    parts = rid.identify(problem_of(omega, values / weight, bound / np.abs(weight), classes[1], 0.1), form=form)
    assert whole.margin == pytest.approx(parts.margin, abs=2e-4)
    if form in ("orthonormal", "taylor"):
        at = np.array([9.0])
        errors = [rid.worst_case_error(one, omega=at, directions=6, rtol=0.02).magnitude for one in (whole, parts)]
        size = np.abs(BIPROPER(np.exp(0.1j * at)))[:, None]
        assert np.allclose(errors[0], size * errors[1], rtol=0.03)


@pytest.mark.parametrize("seed", seeds(1, 30))
def test_the_margin_is_that_of_the_pick_matrix_of_the_quotient(seed):
    rng = np.random.default_rng(seed)
    omega, values, bound = lines(seed, int(rng.integers(2, 6)))
    order, decay, corner = int(rng.integers(1, 4)), rng.uniform(0.2, 2), rng.uniform(2, 20)
    size = rolled(1j * omega, order, decay, corner)
    found = rid.identify(
        problem_of(omega, values, bound, prior(gain_bound=3.0, decay=decay, roll_off=order, corner=corner)),
        accuracy=1e-7,
    )
    judged = smallest_factor(
        omega, *(one[:, None, None] / 3.0 for one in (values / size, bound / np.abs(size))), decay, bounded=True
    )
    assert found.margin == pytest.approx(judged, rel=1e-5, abs=1e-5)


@pytest.mark.parametrize("seed", seeds(1, 10))
def test_truths_at_the_edge_are_inside_every_band(seed):
    omega, values, bound, basis, plant = truth_of(seed)
    widths = []
    for one in (prior(), prior(**UNWEIGHTED)):
        found = rid.identify(problem_of(omega, values, bound, one, parametric=basis)).require()
        grid = np.array([1.7, 9.0, 400.0])
        error = rid.worst_case_error(found, omega=grid, directions=8 if seed else 4)
        assert error.certified
        off = np.abs(plant(grid) - found.model(1j * grid))
        assert np.all(off <= error.upper[:, 0, 0])
        widths.append(error.upper[:, 0, 0])
    # The weight only takes systems away, and above the corner almost all of them.
    assert np.all(widths[0] <= widths[1] * 1.05)
    assert widths[0][-1] < 1e-2 * widths[1][-1]


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(2, 6))
def test_the_whole_axis_to_infinity(seed):
    omega, values, bound, basis, plant = truth_of(seed, 12)
    found = rid.identify(problem_of(omega, values, bound, prior(), parametric=basis)).require()
    circle = rid.worst_case_error(found, omega=omega[::3], directions=8).on_circle(rtol=0.5, time_limit=8)
    grid = np.geomspace(1e-3, 1e5, 2000)
    off = np.abs(plant(grid) - found.model(1j * grid))
    cell = np.clip(np.searchsorted(circle.edges, grid) - 1, 0, circle.bound.size - 1)
    assert np.all(off <= circle.bound[cell])
    assert circle.edges[-1] == np.inf
    assert circle.bound[-1] < 0.3 * K  # without the weight it is above K


def test_the_model_falls_as_the_class_does():
    omega, values, bound, basis, _ = truth_of(3)
    model = rid.identify(problem_of(omega, values, bound, prior(), parametric=None), form="orthonormal").model
    assert model.D.item() == 0.0
    far = np.abs(model(1j * np.array([1e4, 1e5])))
    assert far[1] / far[0] == pytest.approx(1e-2, rel=1e-2)
    assert far[0] <= K * np.abs(rolled(1e4j))
    both = rid.identify(problem_of(omega, values, bound, prior(), parametric=basis)).model
    assert both.D.item() == 0.0
    assert np.linalg.eigvals(both.A).real.max() < 0


def test_two_taylor_coefficients_of_a_filtered_pulse():
    # phi_0 = g_0/w_0, phi_1 = (g_1 - w_1 phi_0)/w_0 in delay series scaled by rho: |phi_1 rho| <= 1 - |phi_0|^2 for K = 1.
    rho = 1.25
    weight = control.zpk([0.3 * rho], [-0.4 * rho], 0.5, dt=1.0)
    w0, w1 = 0.5, 0.5 * (-0.3 - 0.4)
    phi0 = 0.6
    edge = (1 - phi0**2) / rho
    for factor, consistent in ((0.999, True), (1.001, False)):
        g = [w0 * phi0, w0 * edge * factor + w1 * phi0]
        record = rid.TimeRecord([1.0, 0.0], g, dt=1.0, bound=1e-6)
        classes = rid.Prior(gain_bound=1.0, decay_rate=rho, weight=weight)
        assert identified(rid.MixedProblem(time=record, prior=classes)).consistent is consistent


def discrete_truth(seed, samples=24):
    """W times a function of the ball in discrete time, driven by noise."""
    rng = np.random.default_rng(seed)
    ball = rid.identify(
        rid.MixedProblem(
            time=rid.TimeRecord(np.eye(4)[0], [0.5, -0.6, 0.3, 0.1], dt=0.1, bound=1e-2),
            prior=rid.Prior(gain_bound=1.0, decay_rate=RATE),
        )
    ).solution(rng.uniform(-1, 1))
    plant = BIPROPER * ball
    u = rng.standard_normal(samples)
    return plant, u, control.forced_response(plant, inputs=u).outputs


def of_record(u, y, bound, *, form="auto", **start):
    """The answer to a record of a weighted plant."""
    record = rid.TimeRecord(u, y, dt=0.1, bound=bound, **start)
    classes = rid.Prior(gain_bound=1.01, decay_rate=RATE, weight=STATED)
    return rid.identify(rid.MixedProblem(time=record, prior=classes), form=form).require()


@pytest.mark.parametrize("form", ["orthonormal", slow("taylor")])
@pytest.mark.parametrize("initial", ["rest", "free", slow("periodic")])
def test_records_of_a_weighted_plant_are_consistent(initial, form):
    plant, u, y = discrete_truth(2)
    if initial != "rest":
        y = control.forced_response(plant, inputs=np.tile(u, 40)).outputs[-u.size :]
    found = of_record(u, y, 1e-3, initial=initial, form=form)
    assert found.margin < 1
    at = np.array([8.0])
    error = rid.worst_case_error(found, omega=at, directions=6)
    assert np.all(np.abs(plant(np.exp(0.1j * at)) - found.model(np.exp(0.1j * at))) <= error.upper[:, 0, 0])


def test_tubes_hold_a_weighted_plant():
    plant, u, y = discrete_truth(5)
    found = of_record(u, y, 1e-2)
    tube = rid.guarantee.response_tube(found, input="step", horizon=40, times=[0.0, 1.0, 3.0])
    assert tube.verify()
    step = control.forced_response(plant, inputs=np.ones(40)).outputs
    nominal = control.forced_response(found.model, inputs=np.ones(40)).outputs
    assert np.abs(step - nominal).max() <= tube.error_peak
    assert np.all(np.abs(step - nominal)[tube.samples] <= tube.error_upper)


@pytest.mark.slow
def test_the_circle_holds_a_weighted_plant():
    plant, u, y = discrete_truth(5)
    found = of_record(u, y, 1e-2)
    circle = rid.worst_case_error(found, omega=[1.0, 10.0], directions=6).on_circle(rtol=0.5, time_limit=5)
    z = np.exp(1j * np.linspace(0, np.pi, 500))
    assert np.abs(plant(z) - found.model(z)).max() <= circle.largest


def test_matrices_share_the_weight():
    rng = np.random.default_rng(4)
    omega = np.array([1.0, 4.0, 9.0])
    values = 0.15 * (rng.standard_normal((3, 2, 3)) + 1j * rng.standard_normal((3, 2, 3)))
    size, scaling = rolled(1j * omega)[:, None, None], [[1, 2, 1], [1, 2, 1]]
    found = rid.identify(problem_of(omega, values * size, 0.02, prior(scaling=scaling))).require()
    bound = 0.02 / np.abs(size) * np.ones((3, 2, 3))
    parts = rid.identify(problem_of(omega, values, bound, prior(**UNWEIGHTED, scaling=scaling)))
    assert found.margin == pytest.approx(parts.margin, abs=1e-4)
    assert np.all(found.model.D == 0)
    error = rid.worst_case_error(found, omega=[300.0], directions=4)
    assert error.upper.max() < 2 * 2 * K * np.abs(rolled(300j)) * 1.5


@pytest.mark.slow
def test_a_small_model_inside_the_bounds():
    omega, values, bound, basis, _ = truth_of(2, 12)
    found = rid.identify(problem_of(omega, values, bound, prior(), parametric=basis))
    small = rid.reduce_within_bounds(found)
    assert small.margin <= 1
    assert small.order < found.model.nstates
    assert np.abs(small.model(1j * omega) - values).max() <= bound * (1 + 1e-6)


@pytest.mark.parametrize("dt", [0.0, 0.1])
def test_a_weight_is_its_zeros_and_poles(dt):
    zeros, poles = [-0.2, 0.1 + 0.3j, 0.1 - 0.3j, 0.0], [0.5 + 0.1j, 0.5 - 0.1j, -0.6, 0.2]
    if not dt:
        zeros, poles = ([root - 1 for root in side] for side in (zeros[:3], poles))
    system = control.zpk(zeros, poles, -1.7, dt=dt)
    points = np.exp(1j * np.array([0.1, 1.0, 3.0]))
    for given in (system, control.ss(system), as_weight(system).fields):
        weight = as_weight(given)
        assert isinstance(weight, PriorWeight)
        assert np.allclose(weight.at(points), system(points), rtol=1e-7)
        assert np.allclose(response_at(weight.states, points)[:, 0, 0], system(points), rtol=1e-7)
        assert weight.states.D.item() == (pytest.approx(-1.7) if dt else 0.0)
    if dt:
        circle = np.abs(system(0.9 * np.exp(1j * np.linspace(0, np.pi, 4001)))).max()
        assert circle * (1 - 1e-6) <= as_weight(system).peak(0.9) <= circle * 1.002


def test_roll_off_is_a_weight():
    omega, values, bound = lines(7)
    rolled_off = control.tf(1, [1 / CORNER, 1]) ** 2
    stated = prior(), prior(**UNWEIGHTED, weight=rolled_off), prior(**UNWEIGHTED)
    first, second, free = (rid.identify(problem_of(omega, values, bound, one)) for one in stated)
    assert second.margin == pytest.approx(first.margin, rel=1e-8)
    assert second.margin > free.margin


@pytest.mark.parametrize("power", [-40, 40])
def test_nothing_depends_on_the_unit_of_time(power):
    omega, values, bound = lines(5)
    unit, found = 2.0**power, []
    for one in (1.0, unit):
        stated = prior(decay=one * DECAY, corner=one * CORNER, roll_off=4)
        found.append(identified(problem_of(one * omega, values, bound, stated)))
    assert found[1].margin == pytest.approx(found[0].margin, rel=1e-9)
    assert np.allclose(found[1].model(2j * unit), found[0].model(2j), rtol=1e-7)


def test_roll_off_only_takes_systems_away():
    for dt in (0.02, 0.1):
        one = prior().sampled(dt)
        weight = problem_of([1.0], [0.1], 0.1, one, dt).weighting
        boundary = np.exp(1j * np.linspace(0, np.pi, 200)) / one.decay_rate
        assert np.abs(weight.own.at(boundary)).max() == pytest.approx(1.0)
        assert weight.peak(one.decay_rate) == pytest.approx(1.0, rel=2e-3)
    line = -DECAY + 1j * np.linspace(0, 100, 200)
    weight = problem_of([1.0], [0.1], 0.1, prior()).weighting
    assert np.allclose(weight.own.at(line), (1 + (line + DECAY) / CORNER) ** -2.0)


def weighted(weight):
    return UNWEIGHTED | {"weight": weight}


@pytest.mark.parametrize(
    ("change", "dt", "words"),
    [
        ({"corner": None}, None, "`roll_off` of the prior is given without `corner`"),
        ({"roll_off": None}, None, "`corner` of the prior is given without `roll_off`"),
        ({"roll_off": 0}, None, "`roll_off`"),
        ({"roll_off": 20}, None, "`roll_off` must be at most 8"),
        ({"corner": -1.0}, None, "`corner` must be"),
        ({"weight": control.tf(1, [1, 9])}, None, "`roll_off` and `weight` both"),
        (weighted(3.0), None, "control.StateSpace"),
        (weighted(control.ss([], [], [], np.eye(2))), None, "one input and one output"),
        (weighted(control.tf(0, [1, 2])), None, "`weight` must be a proper function"),
        (weighted(control.tf([1, 1], 1)), None, "`weight` must be a proper function"),
        (weighted(control.tf(1, [1, -0.5])), None, "a pole at s = 0.5.* must be stable"),
        (weighted(control.tf([1, -5], [1, 9])), None, "a zero at s = 5.* mirror what lies outside"),
        (weighted(control.tf([1, 0], [1, -0.5], 0.1)), None, "of dt = 0.1 s, the data of continuous"),
        (weighted(control.tf(1, [1, 0.2], 0.1)), 0.1, "0 zeros and 1 poles: in discrete time that is a delay"),
    ],
)
def test_wrong_weights_are_refused_with_a_sentence(change, dt, words):
    with pytest.raises((rid.InputError, TypeError), match=words):
        problem_of([1.0], [0.1], 0.1, prior(**change), dt)
