"""Margins guaranteed for every plant of a set, and controllers synthesised for one."""

import warnings

import control
import numpy as np
import pytest

import robustid as rid
from robustid.guarantees import MarginStatus, robust_stability_margin, uncertainty_weight
from robustid.guarantees.cells import shape_of
from support.destabilising import destabilising
from support.weights import largest_on, mode, pair, random_model, values_of


def small_controller(rng, nominal):
    """Stabilises every stable nominal model: the largest gain of the open loop is a half."""
    controller = random_model(rng, nominal.ninputs, nominal.noutputs, states=2)
    omega = np.linspace(0, np.pi / 0.1, 2000)
    gains = [np.linalg.norm(values_of(model, omega), 2, axis=(1, 2)).max() for model in (nominal, controller)]
    return 0.5 / np.prod(gains) * controller


def on_cells(edges, bound, omega):
    """The bound of the cell of every frequency."""
    return bound[np.clip(np.searchsorted(edges, omega, side="right") - 1, 0, len(bound) - 1)]


def loops(nominal, controller, omega):
    """K S, F K S and S at frequencies, of several channels."""
    F, K = values_of(nominal, omega), values_of(controller, omega)
    S = np.linalg.inv(np.eye(F.shape[1]) + F @ K)
    return {"additive": K @ S, "multiplicative": F @ K @ S, "inverse": S}


def rescaled(model, left, right):
    return control.ss(model.A, model.B @ right, left @ model.C, left @ model.D @ right, model.dt)


# ------------------------------------------------------------------------------------------------------ control and margin


def closed_loop_radius(plant, controller):
    """Largest pole of the loop with u = -K y, by python-control."""
    return np.abs(control.feedback(plant, controller).poles()).max()


def drawn_plant(nominal, limit, edges, bound, rng):
    """F_id + a stable E of two states, scaled so that its largest |E|/bound on the circle is `limit`."""
    poles = np.array(pair(rng.uniform(0.05, 3.0), 10 ** rng.uniform(-2.5, 0)))
    E = control.ss(control.tf(rng.normal(size=3), np.real(np.poly(poles)), 0.1))
    peak, width = np.abs(np.angle(poles[0])), 1 - np.abs(poles[0])
    near = np.clip(peak + width * np.linspace(-5, 5, 201), 0, np.pi)
    omega = np.concatenate([np.linspace(0, np.pi, 1500), near]) / 0.1
    return nominal + E * (limit / (np.abs(values_of(E, omega)[:, 0, 0]) / on_cells(edges, bound, omega)).max())


def edges_and_bound(nominal):
    """Of 60 cells: a tenth of the nominal, and as much everywhere."""
    edges = np.linspace(0, np.pi, 61) / 0.1
    return edges, 0.04 + 0.1 * largest_on(lambda w: np.abs(values_of(nominal, w)[:, 0, 0]), edges, 50)


LEAD = control.ss(control.tf([0.2, -0.15], [1, -0.5], 0.1))


def test_guaranteed_means_that_every_drawn_plant_is_stabilised(rng):
    nominal, controller = mode(), LEAD
    edges, bound = edges_and_bound(nominal)
    result = uncertainty_weight(nominal, edges, bound).robust_stability_margin(controller)
    assert result.guaranteed
    assert result.margin > 1
    for scale in (1.0, result.margin * 0.999):
        for _ in range(50):
            assert closed_loop_radius(drawn_plant(nominal, scale, edges, bound, rng), controller) < 1
    # Against the condition on a dense grid.
    omega = np.linspace(0, np.pi / 0.1, 20_001)
    condition = on_cells(edges, bound, omega) * np.abs(loops(nominal, controller, omega)["additive"][:, 0, 0])
    assert result.margin <= 1 / condition.max()
    assert result.margin >= 0.99 / condition.max()
    assert result.frequency == pytest.approx(omega[np.argmax(condition)], abs=0.2)


def all_pass_error(size, angle, direction):
    """A stable E with |E| = size everywhere whose phase at one angle is that of `direction`: (1 - a z)/(z - a) and a sign."""
    z, roots = np.exp(1j * angle), np.tanh(np.linspace(-12, 12, 200_001))
    phase = (1 - roots * z) / (z - roots)
    sign = np.where(np.real(phase * np.conj(direction)) > 0, 1, -1)
    best = np.argmin(np.abs(sign * phase - direction / abs(direction)))
    a, size = roots[best], size * sign[best]
    return control.ss(control.tf([-a * size, size], [1, -a], 0.1))


@pytest.mark.parametrize("gain", [0.05, 0.3])
def test_beyond_the_margin_a_plant_of_the_set_is_not_stabilised(gain):
    """Without a smaller set than all |E| <= bound, the margin is exact: the worst E turns E K S to -1 where |KS| is largest."""
    nominal, controller = mode(damping=0.1), control.ss([], [], [], gain, 0.1)
    assert closed_loop_radius(nominal, controller) < 1
    result = robust_stability_margin(nominal, controller, [0.0, np.pi / 0.1], [1.0])
    angle = 0.1 * result.frequency
    loop = gain / (1 + gain * values_of(nominal, np.array([result.frequency]))[0, 0, 0])
    for part, stable in ((0.99, True), (1.01, False)):
        plant = nominal + all_pass_error(part * result.margin, angle, -1 / loop)
        assert (closed_loop_radius(plant, controller) < 1) == stable
    small = robust_stability_margin(nominal, controller, [0.0, np.pi / 0.1], [1.01 * result.margin])
    assert small.status is MarginStatus.OPEN
    assert not small.guaranteed
    assert small.margin == pytest.approx(1 / 1.01, rel=1e-6)


def test_an_unstable_nominal_loop_has_no_margin():
    result = robust_stability_margin(mode(), control.ss([], [], [], 50.0, 0.1), [0.0, np.pi / 0.1], [1e-9])
    assert result.status is MarginStatus.UNSTABLE
    assert result.margin == 0
    assert not result.guaranteed


def test_an_integrator_with_a_relative_bound(rng):
    """F = (1 + E) F_id, both with an integrator, E = all-pass of size e: at the limit |T| e = 1."""
    nominal = control.ss(control.tf([0.1], [1, -1], 0.1))
    controller = control.ss(control.tf([3.0, -2.4], [1, -0.6], 0.1))
    edges = np.geomspace(0.02, np.pi, 31) / 0.1
    error = 0.2 * np.abs(values_of(nominal, edges[1:]))[:, 0, 0]
    with pytest.raises(rid.InputError, match=r"must start at 0; got 0\.2 rad/s.*below="):
        uncertainty_weight(nominal, edges, error).robust_stability_margin(controller)
    weight = uncertainty_weight(nominal, edges, error, kind="multiplicative", below=0.2)
    assert weight.edges[0] == 0
    assert np.all(weight.bound <= 0.21)
    result = weight.robust_stability_margin(controller)
    omega = np.linspace(1e-4, np.pi / 0.1, 50_001)
    L = (values_of(nominal, omega) * values_of(controller, omega))[:, 0, 0]
    assert 0.95 / np.abs(0.2 * L / (1 + L)).max() <= result.margin <= 1 / np.abs(0.2 * L / (1 + L)).max()
    for direction in np.exp(2j * np.pi * rng.random(30)):
        E = all_pass_error(0.2 * 0.99 * result.margin, rng.uniform(0, np.pi), direction)
        plant = nominal + nominal * E
        # The product has the integrator once more, uncontrolled or not: look at the loop's own equation.
        num, den = control.ss2tf(nominal), control.ss2tf(E)
        characteristic = np.polyadd(
            np.polymul(np.polymul(num.den[0][0], den.den[0][0]), [1, -0.6]),
            np.polymul(np.polymul(num.num[0][0], np.polyadd(den.den[0][0], den.num[0][0])), [3.0, -2.4]),
        )
        assert np.abs(np.roots(characteristic)).max() < 1
        assert plant.ninputs == 1


@pytest.mark.parametrize("kind", ["additive", "multiplicative", "inverse"])
def test_the_margin_of_each_kind_against_a_dense_grid_with_two_channels(rng, kind):
    nominal = random_model(rng, 2, 2)
    controller = small_controller(rng, nominal)
    edges = np.linspace(0, np.pi, 21) / 0.1
    bound = rng.uniform(0.2, 1.0, 20)
    omega = np.linspace(0, np.pi / 0.1, 40_001)
    sizes = np.linalg.norm(loops(nominal, controller, omega)[kind], 2, axis=(1, 2))
    expected = 1 / (on_cells(edges, bound, omega) * sizes).max()
    result = robust_stability_margin(nominal, controller, edges, bound, kind=kind)
    assert 0.997 * expected <= result.margin <= expected * (1 + 1e-9)


def test_bounds_per_entry_do_not_depend_on_units(rng):
    nominal = random_model(rng, 2, 3)
    controller = small_controller(rng, nominal)
    edges, bound = np.linspace(0, np.pi, 4) / 0.1, rng.uniform(0.2, 1.0, (3, 2, 3))
    result = robust_stability_margin(nominal, controller, edges, bound)
    omega = np.linspace(0, np.pi / 0.1, 5_001)
    sizes = np.abs(loops(nominal, controller, omega)["additive"])
    condition = np.abs(np.linalg.eigvals(on_cells(edges, bound, omega) @ sizes)).max()
    assert 0.999 / condition <= result.margin <= 1.2 / condition  # the phases of KS are not those of the worst case
    left, right = np.diag([1e3, 1e-2]), np.diag([1.0, 1e4, 1e-4])
    other = rescaled(controller, np.linalg.inv(right), np.linalg.inv(left))
    scaled = robust_stability_margin(rescaled(nominal, left, right), other, edges, left @ bound @ right)
    assert scaled.margin == pytest.approx(result.margin, rel=3e-3)


def turned(matrix, angle):
    """A stable plant of constant moduli, those of a matrix, whose response at one angle is the matrix."""
    entries = control.append(*[all_pass_error(abs(entry), angle, entry) for entry in matrix.ravel()])
    ny, nu = matrix.shape
    rows, columns = np.kron(np.eye(ny), np.ones((1, nu))), np.tile(np.eye(nu), (ny, 1))
    return control.ss(entries.A, entries.B @ columns, rows @ entries.C, rows @ entries.D @ columns, 0.1)


@pytest.mark.parametrize("structure", ["entry", "full", "input", "output"])
def test_a_perturbation_of_the_structure_moves_a_pole_across_the_circle(rng, structure):
    """The margin is at most what a perturbation needs that was found by search: one with constant moduli, built and closed."""
    nominal = random_model(rng, 2, 2)
    controller = small_controller(rng, nominal)
    bound = rng.uniform(0.2, 1.0, shape_of(structure, (2, 2)))
    edges = np.linspace(0, np.pi, 5) / 0.1
    result = robust_stability_margin(nominal, controller, edges, np.tile(bound, (4, 1, 1)))
    assert result.structure == structure
    loop = loops(nominal, controller, np.array([result.frequency]))["additive"][0]
    delta, size = destabilising(loop, bound, rng, tries=5, steps=40)
    assert 0.998 * result.margin <= size <= (1.1 if structure == "entry" else 1.01) * result.margin
    if structure == "entry":  # errors whose entries have constant moduli
        angle = 0.1 * result.frequency
        for part, stable in ((0.99 * result.margin, True), (1.01 * size, False)):
            plant = nominal + turned(part * delta, angle)
            assert (closed_loop_radius(plant, controller) < 1) == stable


def test_of_several_bounds_the_best_one_answers_on_every_cell(rng):
    nominal = random_model(rng, 2, 2)
    controller = small_controller(rng, nominal)
    edges = np.linspace(0, np.pi, 5) / 0.1
    full, entries = rng.uniform(0.1, 1.0, 4), rng.uniform(0.1, 1.0, (4, 2, 2))
    columns = rng.uniform(0.1, 1.0, (4, 1, 2))
    together = robust_stability_margin(nominal, controller, edges, (full, entries, columns))
    alone = [robust_stability_margin(nominal, controller, edges, one) for one in (full, entries, columns)]
    best = np.max([one.margins for one in alone], axis=0)
    assert np.all(together.margins >= 0.94 * np.minimum(best, 10 * together.margin))
    assert together.margin >= best.min() * 0.95
    assert together.margin >= max(one.margin for one in alone) * 0.998
    # Each cell by itself: its margin is that of the condition on a dense grid.
    omega = (edges[:-1, None] + np.diff(edges)[:, None] * np.linspace(0, 1, 400)).ravel()
    sizes = np.linalg.norm(loops(nominal, controller, omega)["additive"], 2, axis=(1, 2))
    gains = sizes.reshape(4, -1).max(axis=1) * full
    assert np.all(alone[0].margins <= 1 / gains)
    assert np.all(alone[0].margins >= 0.94 * np.minimum(1 / gains, 10 * alone[0].margin))
    assert alone[0].margin <= alone[0].margins.min()
    for one in (together, *alone):
        assert one.shares.shape == (2, 2)
        assert one.shares.sum() == pytest.approx(1)


def test_shares_are_how_the_margin_depends_on_the_bound_of_an_entry(rng):
    nominal = random_model(rng, 2, 2)
    controller = small_controller(rng, nominal)
    bound = rng.uniform(0.2, 1.0, (1, 2, 2))
    result = robust_stability_margin(nominal, controller, [0.0, np.pi / 0.1], bound)
    assert result.shares[result.entry] == result.shares.max()
    for place in (result.entry, np.unravel_index(np.argmin(result.shares), (2, 2))):
        change = np.ones((1, 2, 2))
        change[0][place] = 0.9
        found = robust_stability_margin(nominal, controller, [0.0, np.pi / 0.1], bound * change)
        assert np.log(found.margin / result.margin) == pytest.approx(-result.shares[place] * np.log(0.9), abs=0.01)


def test_a_single_entry_has_the_margin_of_the_whole():
    nominal, controller = mode(), LEAD
    edges, bound = np.linspace(0, np.pi, 11) / 0.1, np.linspace(0.3, 0.1, 10)
    found = [robust_stability_margin(nominal, controller, edges, one) for one in (bound, bound[:, None, None])]
    assert found[0].margin == found[1].margin
    assert found[0].structure == found[1].structure == "full"
    assert found[0].entry == (0, 0)


@pytest.mark.parametrize(
    ("bound", "words"),
    [
        (np.ones((4, 3, 2)), r"shape \(4,\) or \(4, 2, 2\) or \(4, 1, 2\) or \(4, 2, 1\).*got \(4, 3, 2\)"),
        ((np.ones(4), np.ones((4, 1, 1))), "one bound of each structure; got full, full"),
        ((np.ones(4), np.ones((3, 2, 2))), r"one value for each of the 4 cells between `edges`; got \(3, 2, 2\)"),
        ((np.ones(4), np.full((4, 2, 2), np.nan)), "`bound` must be finite"),
        ((np.ones(4), np.zeros((4, 1, 2))), "`bound` must be positive"),
    ],
)
def test_bounds_that_do_not_fit_get_a_sentence(rng, bound, words):
    nominal = random_model(rng, 2, 2)
    with pytest.raises(rid.InputError, match=words):
        robust_stability_margin(nominal, small_controller(rng, nominal), np.linspace(0, np.pi, 5) / 0.1, bound)


def test_channels_that_do_not_meet_have_the_smaller_of_their_margins():
    """Two decoupled loops, whose entries are exactly zero where they would meet."""
    parts = control.ss(0.5, 1.0, 1.0, 0.0, 0.1), mode(damping=0.2)
    edges, bound = np.linspace(0, np.pi, 11) / 0.1, np.linspace(0.3, 0.1, 10)
    one, two = (control.ss([], [], [], 0.1 * np.eye(count), 0.1) for count in (1, 2))
    alone = [robust_stability_margin(model, one, edges, bound).margin for model in parts]
    entries = bound[:, None, None] * (np.eye(2) + 1e-12)
    both = robust_stability_margin(control.append(*parts), two, edges, entries)
    assert both.margin == pytest.approx(min(alone), rel=2e-3)


def test_the_pair_for_synthesis_has_the_same_values_and_the_controller_comes_back():
    nominal = mode()
    edges, bound = edges_and_bound(nominal)
    weight = uncertainty_weight(nominal, edges, bound)
    pair_ = weight.to_control()
    omega = np.linspace(0.1, 30, 50)
    s = 20j * np.tan(0.05 * omega)
    for continuous, discrete in ((pair_.nominal, nominal), (pair_.weight, weight.model)):
        assert continuous.dt == 0
        assert np.asarray(continuous(s)).ravel() == pytest.approx(values_of(discrete, omega)[:, 0, 0], rel=1e-9)
    assert pair_.weight.poles().real.max() < 0
    assert pair_.weight.zeros().real.max() < 0
    controller = control.ss(control.tf([1.0, 2.0], [1.0, 30.0]))
    back = pair_.controller(controller)
    assert values_of(back, omega)[:, 0, 0] == pytest.approx(np.asarray(controller(s)).ravel(), rel=1e-9)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # of control's own use of connect
        generalised = control.augw(
            pair_.nominal, w1=control.ss([], [], [], 0.1), w2=pair_.weight
        )  # what mixsyn synthesises for
    assert (generalised.ninputs, generalised.noutputs) == (2, 3)


def test_a_synthesised_controller_keeps_the_gain_that_was_promised():
    """H-infinity synthesis of the mixed sensitivities: the same largest gain in discrete time, and a margin of its reciprocal."""
    pytest.importorskip("slycot", reason="slycot is not installed: control.mixsyn needs it")
    nominal = mode()
    edges, bound = edges_and_bound(nominal)
    weight = uncertainty_weight(nominal, edges, bound)
    continuous = weight.to_control()
    performance = control.ss(control.tf([0.5, 0.3], [1.0, 3e-4]))  # |S| below 1 up to about 0.3 rad/s
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # of control's own use of connect
        found, _, (gain, _) = control.mixsyn(continuous.nominal, w1=performance, w2=continuous.weight)
        generalised = control.augw(continuous.nominal, w1=performance, w2=continuous.weight)
    assert control.hinfsyn(generalised, 1, 1)[2] == pytest.approx(gain, rel=1e-6)
    controller = continuous.controller(found)
    assert closed_loop_radius(nominal, controller) < 1
    omega = np.geomspace(1e-5, np.pi / 0.1 * (1 - 1e-9), 100_001)
    K, F, W = (values_of(model, omega)[:, 0, 0] for model in (controller, nominal, weight.model))
    S = 1 / (1 + F * K)
    shape = np.asarray(performance(20j * np.tan(0.05 * omega))).ravel()
    reached = np.hypot(np.abs(shape * S), np.abs(W * K * S)).max()
    assert reached == pytest.approx(gain, rel=1e-3)
    assert reached <= gain * (1 + 1e-6)
    # |W K S| <= gain, and W is above the bound.
    assert weight.robust_stability_margin(controller).margin >= (1 - 1e-3) / gain


def test_the_model_of_an_identification():
    """From data to a margin: a nominal model of tens of states, one mode of 0.4 % damping."""
    data = rid.datasets.flexible_structure(seed=0)
    prior = rid.Prior(gain_bound=0.2, decay_rate=1.1)
    basis = rid.kautz(2 * np.pi * np.array([9.0, 17.67]), [0.1, 0.004], dt=0.01)
    problem = rid.MixedProblem(frequency=data.frequency, time=data.time, prior=prior, parametric=basis)
    nominal = rid.identify(problem).model
    edges = np.linspace(0, np.pi, 101) / nominal.dt
    weight = uncertainty_weight(nominal, edges, np.linspace(0.05, 0.2, 100))
    controller = control.ss([], [], [], -0.02, nominal.dt)
    result = weight.robust_stability_margin(controller)
    omega = np.sort(np.append(np.linspace(0, edges[-1], 5_001), 2 * np.pi * (17.67 + np.linspace(-1, 1, 2001))))
    loop = 0.02 / (1 - 0.02 * np.asarray(nominal(np.exp(1j * omega * nominal.dt))))
    condition = on_cells(edges, weight.bound, omega) * np.abs(loop)
    assert weight.certified
    assert 0.998 / condition.max() <= result.margin <= 1 / condition.max()
    assert result.guaranteed


@pytest.mark.parametrize("shape", [(), (2, 2), (1, 2), (2, 1)], ids=["norm", "entries", "inputs", "outputs"])
@pytest.mark.filterwarnings("error")
def test_a_controller_that_does_nothing_or_little_of_it_has_no_trouble(shape):
    plant = control.ss(np.diag([0.5, 0.3]), np.eye(2), np.eye(2), np.zeros((2, 2)), 1.0)
    edges, bound = [0.0, 1.0, np.pi], np.full((2, *shape), 0.1)
    nothing, one = (control.ss([], [], [], D, 1.0) for D in (np.zeros((2, 2)), np.array([[0.2, 0.0], [0.0, 0.0]])))
    assert robust_stability_margin(plant, nothing, edges, bound).margin == np.inf
    found = robust_stability_margin(plant, one, edges, bound)
    # The only loop that is closed: K S = 0.2 (z - 0.5)/(z - 0.3), largest at z = -1.
    assert found.margin == pytest.approx(1.3 / 0.3 / 0.1, rel=2e-3)
