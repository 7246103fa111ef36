"""Passive models: truncations keep the property and its bound, the nearest passive gains are the nearest."""

from pathlib import Path

import control
import numpy as np
import pytest

import robustid as rid
from robustid.core import response_at
from robustid.errors import InputError
from robustid.passivity import PassiveStatus
from robustid.reduction import hinf_error
from support.cases import slow
from support.networks import foster, scattering

OMEGA = np.geomspace(0.3, 300, 60)


def values(model, omega=OMEGA):
    return response_at((model.A, model.B, model.C, model.D), 1j * omega)


@pytest.mark.parametrize("seeds", [1, slow(20)])
@pytest.mark.parametrize("kind", ["bounded real", "positive real"])
def test_truncations_stay_passive_within_their_bound(kind, seeds):
    for seed in range(seeds):
        model = foster(np.random.default_rng(seed), 4, 2, damping=0.05, resistance=0.2)
        model = scattering(model) if kind == "bounded real" else model
        for order in (2, 5):
            small = rid.passive.reduce_passive(model, kind=kind, order=order)
            assert small.passivity.holds
            assert small.passivity.certificate.verify(small.model)
            assert (small.model.nstates, small.status) == (order, PassiveStatus.PASSIVE)
            assert np.all((small.values >= 0) & (small.values <= 1 + 1e-9))
            assert small.error == pytest.approx(hinf_error(model, small.model).value)
            if kind == "bounded real":
                assert small.error <= 2 * small.values[order:].sum() + 1e-7


def test_a_state_out_of_reach_goes_first():
    model = control.StateSpace(np.diag([-1.0, -5.0]), [[1.0], [0.0]], [[0.5, 1.0]], 0.25, 0)
    small = rid.passive.reduce_passive(model, order=1)
    assert small.values[1] < 1e-6
    np.testing.assert_allclose(values(small.model), values(model), atol=1e-6)


def test_the_smallest_order_inside_all_bounds():
    model = scattering(foster(np.random.default_rng(5), 2, 1, damping=0.1, resistance=0.3))
    data = rid.FrequencyResponse(OMEGA, values(model), bound=0.02)
    small = rid.passive.reduce_passive(model, response=data)
    assert small.passivity.holds
    assert small.margin <= 1
    np.testing.assert_allclose(np.max(np.abs(values(small.model) - values(model))) / 0.02, small.margin, rtol=1e-6)
    assert small.order < model.nstates
    assert dict(small.tried)[small.order] <= 1
    assert all(ratio > 1 for order, ratio in small.tried if order < small.order)
    wider = rid.passive.reduce_passive(model, response=rid.FrequencyResponse(OMEGA, values(model), bound=0.3))
    assert wider.order <= small.order


@pytest.mark.slow
def test_the_nearest_passive_model_in_closed_form():
    # Of 1.5/(1 + s) sampled evenly on both sides of the corner, in the logarithm: found with all of C, D and the pole free by
    # brute force over the pole p and D, C what is left to |S(0)| = 1.
    omega = np.geomspace(1e-3, 1e3, 25)
    wanted, active = 1.5 / (1 + 1j * omega), control.StateSpace(-1.0, 1.0, 1.5, 0.0, 0)
    found = rid.passive.make_passive(active, response=rid.FrequencyResponse(omega, wanted))
    assert found.passivity.holds
    pole, gain = np.meshgrid(np.linspace(1.0, 2.5, 301), np.linspace(-0.1, 0.1, 41))
    trial = ((1 - gain)[..., None] / (1 + 1j * omega / pole[..., None])) + gain[..., None]
    least = np.min(np.sum(np.abs(trial - wanted) ** 2, axis=-1))
    cost = np.sum(np.abs(values(found.model, omega).ravel() - wanted) ** 2)
    assert least * (1 - 1e-4) <= cost <= least * (1 + 1e-4)


@pytest.mark.slow
def test_poles_that_stand_in_the_way_are_moved():
    # Exact data of a passive network; a pole of the model where nothing was measured, with a gain far beyond 1.
    truth = scattering(foster(np.random.default_rng(0), 1, 1, damping=0.1, resistance=0.1))
    far = control.StateSpace([[0, 1], [-1e4, -2.0]], [[0], [1]], [[0, 10.0]], 0.0, 0)
    omega = np.linspace(0.2, 5, 40)
    passive = rid.passive.make_passive(truth + far, response=rid.FrequencyResponse(omega, values(truth, omega)))
    assert passive.passivity.holds
    assert np.max(np.abs(values(passive.model, omega) - values(truth, omega))) < 1e-4


@pytest.mark.parametrize("kind", ["bounded real", slow("positive real")])
def test_noisy_networks_become_passive_and_come_nearer_to_the_truth(kind):
    rng = np.random.default_rng(0)
    truth = foster(rng, 2, 2, damping=0.05, resistance=0.02)
    truth = scattering(truth) if kind == "bounded real" else truth
    C = truth.C * (1 + 0.1 * rng.standard_normal(truth.C.shape))
    active = control.StateSpace(truth.A, truth.B, C, truth.D - 0.03, 0)
    assert not rid.prove_passive(active, kind=kind).holds
    passive = rid.passive.make_passive(active, kind=kind)
    assert passive.passivity.holds
    assert passive.error <= 1.5 * hinf_error(active, truth).value
    again = rid.passive.make_passive(passive.model, kind=kind)
    assert again.model is passive.model


SAMPLED = rid.FrequencyResponse([1.0, 2.0], [0.1, 0.2], dt=0.1)
MATRIX = rid.FrequencyResponse([1.0, 2.0], np.ones((2, 2, 2)))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda m, d: rid.passive.reduce_passive(m), "give either `order`"),
        (lambda m, d: rid.passive.reduce_passive(m, order=7), "`order` must be at most the order .* 1; got 7"),
        (lambda m, d: rid.passive.reduce_passive(m, kind="negative imaginary", order=1), "Fit fewer poles"),
        (lambda m, d: rid.passive.reduce_passive(3 * m, order=0), r"beyond the limit by 0\.5.*make_passive"),
        (lambda m, d: rid.passive.reduce_passive(m, response=d), "must have bounds to stay inside"),
        (lambda m, d: rid.passive.make_passive(m, response=SAMPLED), "without `dt`; got dt = 0.1"),
        (lambda m, d: rid.passive.make_passive(m, response=MATRIX), "1 x 1 entries.*got 2 x 2"),
    ],
)
def test_misuse_is_refused_in_a_sentence(call, message):
    model = control.StateSpace(-1.0, 1.0, 0.5, 0.0, 0)
    with pytest.raises(InputError, match=message):
        call(model, rid.FrequencyResponse([1.0, 2.0], [0.1, 0.2]))


def test_bounds_mean_what_they_mean_and_what_was_not_measured_counts_for_nothing():
    model = scattering(foster(np.random.default_rng(1), 1, 2, damping=0.1, resistance=0.3))
    omega = OMEGA[::6]
    missing = np.full((omega.size, 2, 2), 0.01)
    missing[:, 0, 1] = np.inf
    wrong = values(model, omega)
    wrong[:, 0, 1] += 5
    some = rid.FrequencyResponse(omega, wrong, bound=rid.Bound(missing))
    assert rid.passive.reduce_passive(model, response=some).margin <= 1
    shifted = rid.FrequencyResponse(omega, values(model, omega) + 0.008).with_column_bound(0.01)
    found = rid.passive.make_passive(control.StateSpace([], [], [], np.eye(2) / 2), response=shifted)
    error = np.linalg.norm(values(found.model, omega) - shifted.values, axis=1)
    assert found.margin == pytest.approx(np.max(error) / 0.01)


def test_data_that_no_passive_model_keeps_are_said_to_be_outside():
    model = control.StateSpace(-1.0, 1.0, 0.5, 0.25, 0)
    active = rid.FrequencyResponse([0.5, 1.0, 2.0], [1.5, 1.5, 1.5], bound=0.1)
    found = rid.passive.reduce_passive(model, response=active)
    assert (found.passivity.holds, found.status) == (True, PassiveStatus.OUTSIDE)
    assert found.margin == pytest.approx(5, rel=1e-3)  # 1.5 - 1 over 0.1: the nearest there is


SLOW = [
    *(("ring slot.s2p", poles) for poles in (2, 4, 6, 8)),
    *(("ring slot measured.s1p", poles) for poles in (4, 8, 12, 16)),
    *(("ntwk1.s2p", poles) for poles in (2, 6)),
    *(("wr2p2,line.s2p", poles) for poles in (4, 8)),
]


@pytest.mark.parametrize(("name", "poles"), [("ntwk1.s2p", 4), *(slow(*each) for each in SLOW)])
def test_networks_are_passive_at_most_a_tenth_worse_than_the_vector_fit(name, poles):
    skrf = pytest.importorskip("skrf")
    network = skrf.Network(str(Path(skrf.__file__).parent / "data" / name))
    peer = skrf.vectorFitting.VectorFitting(network)
    peer.vector_fit(n_poles_real=0, n_poles_cmplx=poles // 2)
    data = rid.FrequencyResponse(2 * np.pi * network.f, network.s)
    fit = rid.fit_mfd(data, order=poles, form="shared", feedthrough=True, weight=np.ones(network.s.shape))
    passive = rid.passive.make_passive(fit.model, response=data)
    assert passive.passivity.holds
    error = np.linalg.norm(values(passive.model, data.omega) - network.s)
    fitted = [peer.get_model_response(i, j, network.f) - network.s[:, i, j] for i, j in np.ndindex(network.s.shape[1:])]
    assert error <= 1.1 * np.linalg.norm(fitted)


@pytest.mark.parametrize("ports", [1, slow(2)])
def test_a_fit_of_a_compliance_is_made_negative_imaginary(ports):
    """A fit whose second mode has the wrong sign by a little: among models with its poles none comes nearer to the data."""
    omega = np.geomspace(0.3, 300, 80)
    truth = foster(np.random.default_rng(4), 2, ports, damping=0.05, velocity=False)
    C = np.array(truth.C)
    C[:, 3] = -0.02  # a velocity in the displacement: the phase leaves the half-plane
    fit = control.StateSpace(truth.A, truth.B, C, truth.D, 0)
    assert not rid.prove_passive(fit, kind="negative imaginary").holds
    data = rid.FrequencyResponse(omega, values(truth, omega))
    found = rid.passive.make_passive(fit, kind="negative imaginary", response=data)
    away = np.abs(values(found.model, omega) - data.values).max()
    assert away < 1e-5 * np.abs(data.values).max()  # the truth has these poles, and is negative imaginary
    # Along the imaginary axis, seen: the Hermitian part of j F is positive semidefinite.
    seen = 1j * values(found.model, np.geomspace(0.01, 1e4, 400))
    lowest = np.linalg.eigvalsh((seen + seen.conj().transpose(0, 2, 1)) / 2)[:, 0]
    assert lowest.min() > -1e-9 * np.abs(data.values).max()
    if ports == 1:
        assert found.passivity.holds
        assert found.status is PassiveStatus.PASSIVE
    alone = rid.passive.make_passive(fit, kind="negative imaginary")
    assert alone.passivity.margin > -1e-6
