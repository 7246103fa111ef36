"""Passivity proved and refuted: closed forms, networks at random, and certificates that were tampered with."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.core import response_at
from robustid.errors import InputError, InputTypeError
from robustid.passivity import PassivityStatus
from support.networks import foster, rc_ladder, scattering


def first_order(gain, feedthrough=0.0):
    return control.StateSpace(-1.0, 1.0, gain, feedthrough, 0)


def resonance(numerator, damping=0.1):
    """numerator (of falling powers, up to s) over s^2 + 2 d s + 1."""
    return control.StateSpace([[0, 1], [-1, -2 * damping]], [[0], [1]], [numerator[::-1]], 0, 0)


@pytest.mark.parametrize(
    ("kind", "model", "margin"),
    [
        ("bounded real", first_order(0.75), 0.25),
        ("positive real", first_order(1.0, 0.5), 0.5),  # Re 1/(1 + jw) falls to 0 at infinity
        ("positive real", first_order(-1.0, 1.5), 0.5),  # least at omega = 0
        ("positive real", rc_ladder(5, 2.0), 2.0),
        ("positive real", control.StateSpace([], [], [], [[2.0, 1.0], [-3.0, 2.0]]), 1.0),
        ("bounded real", control.StateSpace([], [], [], [[0.5, 0.0], [0.0, 0.25]]), 0.5),
    ],
)
def test_margins_in_closed_form(kind, model, margin):
    proof = rid.prove_passive(model, kind=kind)
    assert proof.holds
    assert margin * (1 - 1e-8) - 2e-9 <= proof.margin <= margin
    assert proof.certificate.verify(model)


@pytest.mark.parametrize(
    ("kind", "model"),
    [
        ("positive real", first_order(1.0)),  # zero at infinity
        ("positive real", resonance([1.0, 0.0])),  # zero at omega = 0 and at infinity
        ("negative imaginary", first_order(1.0, -3.0)),
        ("negative imaginary", resonance([0.0, 1.0])),
    ],
)
def test_where_the_response_vanishes_the_limit_itself_is_proved(kind, model):
    proof = rid.prove_passive(model, kind=kind)
    assert (proof.holds, proof.margin, proof.certificate.exact_limit) == (True, 0.0, True)
    other = control.StateSpace(model.A, model.B, -model.C, model.D, 0)
    assert not proof.certificate.verify(other)
    assert rid.prove_passive(other, kind=kind).status is PassivityStatus.VIOLATED


def test_all_pass_and_exact_one_are_on_the_edge():
    lossless = control.series(
        first_order(2.0, -1.0), control.StateSpace([[0, 1], [-1, -0.2]], [[0], [1]], [[0, -0.4]], 1, 0)
    )
    for model in (lossless, first_order(1.0)):
        proof = rid.prove_passive(model)
        assert (proof.holds, proof.status) == (False, PassivityStatus.EDGE)
        assert -1e-5 < proof.margin < 0
        assert "1 +" in proof.summary()
        assert rid.prove_passive((1 - 2e-5) * model).holds


def test_violations_are_found_with_their_frequencies():
    # |1.25/(1 + jw)| = 1 at w = 3/4; two narrow peaks of a sum of resonances; Re (-2 + 3/(1 + jw)) < 0 above w = sqrt(1/2).
    low = rid.prove_passive(first_order(1.25))
    assert [band[:3] for band in low.bands] == [pytest.approx((0.0, 0.75, 0.0), rel=1e-6)]
    assert low.bands[0].amount == pytest.approx(0.25)
    assert low.certificate.verify(first_order(1.25))  # the bound 1.25 is proved
    assert low.margin == pytest.approx(-0.25)
    high = rid.prove_passive(first_order(3.0, -2.0), kind="positive real")
    assert high.bands[0].low == pytest.approx(np.sqrt(0.5))
    assert (high.bands[0].high, high.bands[0].omega) == (np.inf, np.inf)
    assert high.bands[0].amount == pytest.approx(2.0)


def test_narrow_violations_between_all_others_are_found():
    # b = 2 d w g: a peak of height g at w; with d = 1e-6 no grid of thousands of points would see it.
    blocks, gains = [], ((1.0, 0.5), (7.3, 1.02), (20.0, 0.9), (90.0, 1.5))
    d = 1e-6
    for w, g in gains:
        blocks.append(control.StateSpace([[0, 1], [-(w**2), -2 * d * w]], [[0], [1]], [[0, 2 * d * w * g]], 0, 0))
    proof = rid.prove_passive(sum(blocks[1:], blocks[0]))
    assert len(proof.bands) == 2
    assert [band.omega for band in proof.bands] == pytest.approx([7.3, 90.0], rel=1e-6)
    assert [band.amount for band in proof.bands] == pytest.approx([0.02, 0.5], rel=1e-3)
    # half the width of |g/(1 + j x)| > 1 in x = (w - w0)/(d w0)
    assert [band.high - band.low for band in proof.bands] == pytest.approx(
        [2 * d * 7.3 * np.sqrt(1.02**2 - 1), 2 * d * 90 * np.sqrt(1.5**2 - 1)], rel=1e-2
    )


@pytest.mark.parametrize("seeds", [1, pytest.param(40, marks=pytest.mark.slow)])
def test_random_networks_are_all_proved(seeds):
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        ports = int(rng.integers(1, 4))
        modes = ports + int(rng.integers(0, 3))  # with fewer a port depends on the others: on the edge everywhere
        damping = 10 ** rng.uniform(-3, -1)
        lossy = foster(rng, modes, ports, damping=damping, resistance=0.05)
        impedance = rid.prove_passive(lossy, kind="positive real")
        assert impedance.holds
        assert 0.05 - 1e-3 <= impedance.margin <= 0.05
        waves = rid.prove_passive(scattering(lossy))
        assert waves.holds
        assert waves.peak <= 1 - waves.margin
        for kind, velocity in (("positive real", True), ("negative imaginary", False)):
            lossless_at_the_ends = foster(rng, modes, ports, damping=damping, velocity=velocity)
            assert rid.prove_passive(lossless_at_the_ends, kind=kind).holds


@pytest.mark.parametrize("seeds", [1, pytest.param(60, marks=pytest.mark.slow)])
def test_random_models_against_a_grid(seeds):
    """What is claimed to be a bound is above every value, and the peak above those of a fine grid."""
    omega = np.geomspace(1e-3, 1e3, 1000)
    for seed in range(seeds):
        rng = np.random.default_rng(100 + seed)
        n, m = int(rng.integers(1, 8)), int(rng.integers(1, 4))
        A = rng.standard_normal((n, n))
        A -= (np.max(np.linalg.eigvals(A).real) + rng.uniform(0.05, 1)) * np.eye(n)
        model = control.StateSpace(A, *(rng.standard_normal(shape) for shape in ((n, m), (m, n), (m, m))), 0)
        values = response_at((model.A, model.B, model.C, model.D), 1j * omega)
        sizes = np.linalg.norm(values, 2, axis=(1, 2))
        hermitian = -np.linalg.eigvalsh(values + values.conj().transpose(0, 2, 1))[:, 0] / 2
        for kind, limit, found in (("bounded real", 1.0, sizes), ("positive real", 0.0, hermitian)):
            proof = rid.prove_passive(model, kind=kind)
            assert np.max(found) <= proof.peak + 1e-9
            assert proof.peak <= limit - proof.margin <= proof.peak + 1e-4 * np.max(sizes)
            inside = np.zeros(omega.size, bool)
            for band in proof.bands:
                inside |= (omega > band.low) & (omega < band.high)
            away = np.abs(found - limit) > 1e-6
            assert np.array_equal(inside[away], (found > limit)[away])


@pytest.mark.parametrize("kind", ["bounded real", "positive real", "negative imaginary"])
def test_a_tampered_certificate_proves_nothing(kind):
    rng = np.random.default_rng(0)
    of_velocity = kind != "negative imaginary"
    model = foster(rng, 2, 2, resistance=0.1) if of_velocity else foster(rng, 2, 1, velocity=False)
    model = scattering(model) if kind == "bounded real" else model
    certificate = rid.prove_passive(model, kind=kind).certificate
    assert certificate.verify(model)
    n = model.nstates
    turned = np.eye(n)[::-1]
    for change in ({"P": -certificate.P}, {"P": turned}, {"P": 0 * certificate.P}, {"coordinates": turned}):
        assert not dataclasses.replace(certificate, **change).verify(model)
    unstable = control.StateSpace(-model.A, model.B, model.C, model.D, 0)
    assert not certificate.verify(unstable)
    if not certificate.exact_limit:
        assert not dataclasses.replace(certificate, bound=certificate.bound - 1e-2).verify(model)


def test_coordinates_and_units_do_not_matter():
    model, unit = scattering(foster(np.random.default_rng(3), 3, 2, resistance=0.1)), 1e9
    plain = rid.prove_passive(model)
    scale = np.diag(10.0 ** np.linspace(-4, 4, model.nstates))
    inverse = np.linalg.inv(scale)
    moved = control.StateSpace(unit * scale @ model.A @ inverse, scale @ model.B, unit * model.C @ inverse, model.D, 0)
    proof = rid.prove_passive(moved)
    assert proof.holds
    assert proof.margin == pytest.approx(plain.margin, abs=1e-4)
    assert proof.omega == pytest.approx(unit * plain.omega, rel=1e-3)


def test_decay_asks_for_more():
    model = first_order(0.5)  # 0.5/(1 - a) on the line Re s = -a
    assert rid.prove_passive(model, decay=0.4).margin == pytest.approx(1 - 0.5 / 0.6)
    assert not rid.prove_passive(model, decay=0.6).holds
    with pytest.raises(InputError, match=r"`model` must be stable.*beyond Re s = -1.5"):
        rid.prove_passive(model, decay=1.5)


UNSTABLE, WIDE = control.StateSpace(0.5, 1.0, 0.5, 0.0, 0), control.StateSpace(-1, [[1, 1]], 0.5, [[0, 0]], 0)


@pytest.mark.parametrize(
    ("model", "options", "message"),
    [
        (control.StateSpace(0.5, 1.0, 0.5, 0.0, 0.1), {}, "`model` must be continuous.*dt = 0.1"),
        (UNSTABLE, {}, "`model` must be stable; it has pole at 0 Hz.*No passive model"),
        (WIDE, {}, "as many outputs as inputs.*1 output and 2 inputs"),
        (first_order(1.0), {"kind": "passive"}, "`kind` must be one of 'bounded real'.*got 'passive'"),
        (first_order(1.0), {"decay": -1.0}, "`decay` must be >= 0"),
        ([[1.0]], {}, r"control\.StateSpace or TransferFunction, .*; got list"),
    ],
)
def test_misuse_is_refused_in_a_sentence(model, options, message):
    with pytest.raises(InputTypeError if model == [[1.0]] else InputError, match=message):
        rid.prove_passive(model, **options)


def test_what_else_a_violation_may_mean():
    impedance = first_order(100.0, 50.0)
    assert 'ask for kind="positive real"' in rid.prove_passive(impedance).summary()
    assert "other way round" in rid.prove_passive(-impedance, kind="positive real").summary()
    skew = control.StateSpace([], [], [], [[1.0, 0.5], [0.0, 1.0]])
    assert not rid.prove_passive(skew, kind="negative imaginary").holds


def test_a_port_that_reaches_nothing():
    idle = control.StateSpace(np.diag([-1.0, -2.0]), np.zeros((2, 1)), np.ones((1, 2)), 0.5, 0)
    assert rid.prove_passive(idle).margin == pytest.approx(0.5)
    none = control.StateSpace(np.diag([-1.0, -2.0]), np.zeros((2, 1)), np.zeros((1, 2)), 0.0, 0)
    assert rid.prove_passive(none, kind="positive real").status is PassivityStatus.EDGE


def times(factor, model):
    return control.StateSpace(model.A, model.B, factor * model.C, factor * model.D, 0)


@pytest.mark.parametrize("networks", [2, pytest.param(16, marks=pytest.mark.slow)])
@pytest.mark.parametrize("ports", [1, 2])
def test_next_to_the_limit_at_all_frequencies(ports, networks):
    """Lossless networks with a mode that hardly acts, less 2e-9: as much room as the rounding of P takes, so P is two matrices."""
    alone = 0
    for seed in range(networks):
        network = foster(np.random.default_rng(seed), 3, ports, damping=0.0)
        B = np.array(network.B)
        B[2:4] *= 0.01
        lossless = scattering(control.StateSpace(network.A, B, B.T, network.D, 0))
        model = times(1 - 2e-9, lossless)
        proof = rid.prove_passive(model)
        assert proof.holds, seed
        assert 0 <= proof.margin <= 2e-9
        assert proof.certificate.verify(model)
        rest = proof.certificate.P_rest
        assert rest is not None
        # A rounding of A moves P by so much where a mode decays slowly, and the rest is no more than such roundings.
        sensitivity = np.linalg.norm(model.A, 2) * np.linalg.norm(proof.certificate.P, 2) / -model.poles().real.max()
        assert np.abs(rest).max() <= np.finfo(float).eps * sensitivity
        # One matrix does where its rounding happens to be small, which depends on the processor.
        alone += dataclasses.replace(proof.certificate, P_rest=None).verify(model)
        assert not dataclasses.replace(proof.certificate, P_rest=1e3 * rest).verify(model)
        assert not proof.certificate.verify(lossless)
        assert not rid.prove_passive(times(1 + 1e-8, lossless)).holds
    assert alone < networks
