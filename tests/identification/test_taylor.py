"""The form of L Taylor coefficients: its tails, its proofs and its models, against the exact form and drawn members."""

import mpmath as mp
import numpy as np
import pytest

import robustid as rid
from robustid.bases import shift_pair
from robustid.identification import model_residuals
from robustid.identification.formulation import TaylorFormulation
from robustid.identification.formulation.sarason import PairMap
from robustid.identification.formulation.tails import taylor_tail
from robustid.identification.formulation.taylor import ShiftMap, taylor_length
from robustid.identification.formulation.taylor_columns import ShiftColumns
from support.cases import slow
from support.forms import ACCURACY, both_forms, compared, nothing_below, posed_problem
from support.problems import MIXED_IS_SLOW, random_problem
from support.taylor_members import DT, EPS, at, random_experiments, random_member, shares_of_tails, taylor, wide_problem


def delayed(member, L):
    return np.concatenate([np.zeros(L), member[0]]), member[1]


def landau(L, rho):
    """zeta^L p(1/zeta)/p(zeta), p the first L + 1 coefficients of sqrt(1 - zeta/rho): extremal for the tail as L grows."""
    p = np.ones(L + 1)
    for k in range(1, L + 1):
        p[k] = p[k - 1] * (k - 1.5) / k / rho
    return p[::-1], p


# --- tails ------------------------------------------------------------------------------------------------------------


def test_random_members_are_in_the_unit_ball():
    circle = np.exp(1j * np.linspace(0, np.pi, 2000))
    for seed in range(20):
        member = random_member(np.random.default_rng(seed), 10)
        assert np.abs(at(member, circle)).max() <= 1 + 1e-7
        assert np.abs(np.roots(member[1][::-1])).min() > 1


@pytest.mark.parametrize("seeds", [100, slow(300)])
@pytest.mark.parametrize("rho", [1.01, slow(1.1), 1.5])
def test_what_lies_beyond_l_coefficients_stays_below_the_tail(rho, seeds):
    """300 random members on the whole circle; the extremal one reaches all but 1 %, so that no smaller constant is true."""
    K, circle = 2.5, np.exp(1j * np.linspace(0, np.pi, 400)) / rho
    prior, reached = rid.Prior(gain_bound=K, decay_rate=rho), 0.0

    def rest(member, L):
        inside = np.polyval(taylor(member, L)[::-1], circle) if L else 0.0
        return K * np.abs(at(member, circle) - inside).max()

    for seed in range(seeds):
        rng = np.random.default_rng([seed, int(100 * rho)])
        L = int(rng.integers(0, 30))
        member = random_member(rng, int(rng.integers(2, 24)))
        worst = max(rest(member, L), rest(delayed(member, L), L))
        assert worst <= taylor_tail(prior, L) * (1 + 1e-9)
        reached = max(reached, worst / taylor_tail(prior, L))
    assert reached > 0.3
    for L in (40, 200):
        worst = rest(landau(L, rho), L)
        assert worst <= taylor_tail(prior, L) * (1 + 1e-9)
        assert worst >= 0.99 * taylor_tail(prior, L) if rho >= 1.1 or L == 200 else worst > 0.9 * taylor_tail(prior, L)


@pytest.mark.parametrize("seeds", [30, slow(100)])
def test_the_tails_of_all_samples_hold_for_random_members(seeds):
    """Lines, records from rest, periodic and with free start: 100 members, L below and above the length of the records."""
    reached = np.zeros(4)
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        problem, widths = wide_problem(rng, 1.01)
        L = int(rng.integers(1, 60))
        rows = TaylorFormulation(problem, L).rows
        for member in (random_member(rng, 12), delayed(random_member(rng, 4), L), delayed((np.ones(1), np.ones(1)), L)):
            shares = shares_of_tails(problem, widths, rows, member, taylor(member, L), 1e-12)
            reached = np.maximum(reached, shares)
    assert np.all(reached > [0.3, 0.99, 0.2, 0.99])  # one sample beyond L is reached exactly: zeta^L


@pytest.mark.parametrize("seeds", [10, slow(30)])
def test_the_length_keeps_every_tail_below_a_tenth_of_the_accuracy(seeds):
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        frequency, time = random_experiments(rng)
        prior = rid.Prior(gain_bound=rng.uniform(0.1, 10), decay_rate=rng.uniform(1.05, 1.3))
        problem = rid.MixedProblem(frequency=frequency, time=time, prior=prior)
        for accuracy in (1e-2, 1e-5):
            L = taylor_length(problem, accuracy)
            tail = TaylorFormulation(problem, L).rows.tail
            assert 0 < tail.max() <= 0.1 * accuracy or L >= 40
            assert tail.max() <= 0.1 * accuracy * (1 + 1e-9)
            assert TaylorFormulation(problem, max(L // 3, 1)).rows.tail.max() > 0.1 * accuracy  # not absurdly long


# --- the map ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("L", [1, 2, 9, 40])
def test_the_shift_map_is_the_general_map_of_the_shift_pair(L):
    rng = np.random.default_rng(L)
    fast, general = ShiftMap(L), PairMap(shift_pair(L))
    x, Y = rng.standard_normal(L), rng.standard_normal((L, L))
    assert np.allclose(fast.matrix(x), general.matrix(x), rtol=0, atol=1e-14)
    assert np.allclose(fast.stein(Y), general.stein(Y), rtol=0, atol=1e-13 * L)
    assert fast.norm(x) == pytest.approx(general.norm(x), rel=1e-13)
    assert np.allclose(fast.turned(Y), general.turned(Y), rtol=0, atol=1e-13)
    assert np.allclose(fast.symmetric_basis, general.symmetric_basis, rtol=0, atol=1e-13)
    # <Y, X(x)> = <c S, x>: the identity that the certificate rests on.
    S = fast.stein(Y)
    assert np.vdot(Y, fast.matrix(x)) == pytest.approx(float((fast.pair.c @ S)[0] @ x), rel=1e-11, abs=1e-11)


def test_the_allowance_for_rounding_covers_generated_columns():
    """Few lines, many coefficients: the phases theta j carry the error; E'l in 40 digits at every 40th coefficient."""
    for seed in range(4):
        rng = np.random.default_rng(seed)
        count, decay = int(rng.integers(1, 4)), 1.003 ** -np.arange(2000.0)
        angles, gain = rng.uniform(2, np.pi, count), rng.uniform(1, 10, count)
        columns = ShiftColumns(angles, gain, decay, np.zeros((0, 2000)))
        weights = rng.standard_normal(count) + 1j * rng.standard_normal(count)
        found, allowed = columns.adjoint(weights), columns.spread(np.abs(weights)) * 2 * (count + 2) * EPS
        with mp.workdps(40):
            for j in range(0, 2000, 40):
                terms = (
                    mp.mpf(g) * mp.expj(mp.mpf(a) * j) * mp.mpc(w)
                    for g, a, w in zip(gain, angles, weights, strict=True)
                )
                assert abs(found[j] - mp.re(mp.fsum(terms)) * mp.mpf(decay[j])) <= allowed[j]


# --- identify ---------------------------------------------------------------------------------------------------------


def both(problem, accuracy=ACCURACY, **options):
    exact, taylor_form = both_forms(problem, "taylor", accuracy=accuracy, **options)
    assert not taylor_form.formulation.exact
    return exact, taylor_form


def compare(case, seed):
    exact, result = both(problem := posed_problem(case, seed, 1.15, 0.05))
    compared(problem, exact, result)
    proof = result.certificate
    assert not proof.value or np.abs(proof.samples).sum() == pytest.approx(1, rel=1e-12)
    # The best system known, mixed with random members, has no smaller worst residual: whatever the rest of its coefficients does.
    rng = np.random.default_rng(seed)
    nothing_below(result, (taylor(random_member(rng), result.formulation.count) for _ in range(10)))
    return result


@pytest.mark.parametrize("seeds", [1, slow(34)])
@pytest.mark.parametrize("case", MIXED_IS_SLOW)
def test_both_forms_prove_the_same_margin(case, seeds):
    statuses = {compare(case, seed).status for seed in range(seeds)}
    assert rid.Status.CONSISTENT in statuses


@pytest.mark.parametrize(
    ("case", "seed", "objective"),
    [
        ("mixed", 1, "margin"),
        *(slow(*each) for each in (("time", 0, "gain"), ("time", 0, "margin"), ("mixed", 1, "gain"))),
    ],
)
def test_objectives_agree_between_the_forms(case, seed, objective):
    problem = posed_problem(case, seed, 1.15, 0.05)
    exact, result = both(problem, objective=objective, accuracy=1e-5 if objective == "gain" else 1e-4)
    if objective == "gain":
        # Both gains are found to 1e-4; tails and margins differ by less.
        assert result.prior.gain_bound == pytest.approx(exact.prior.gain_bound, rel=2e-4)
    else:
        worst = [max(r.ratio.max() for r in each.residuals) for each in (exact, result)]
        assert worst[0] == pytest.approx(worst[1], abs=2e-4 * max(1, *worst))


@pytest.mark.parametrize("case", [slow("time"), "frequency", "parametric"])
def test_other_solutions_of_the_taylor_form(case):
    """Every E keeps the residuals that the model may have; its values lie in the disc of all solutions."""
    for spread in (1.0, 1e-3):
        problem = random_problem(5, case, 14, spread=spread).with_prior(decay_rate=1.25)
        result = rid.identify(problem, form="taylor", accuracy=ACCURACY)
        assert result.consistent
        omega = np.linspace(0.5, 314, 40)
        centre, radius = result.weyl_disc(omega)
        level = max(1.0, result.margin * (1 + 1e-6))
        # The disc knows nothing of the states left out: those cost a share of the smallest bound, or of K without lines.
        spare = 0.011 * min([problem.prior.gain_bound, *(f.bound.min() for f in problem.frequency)])
        assert np.array_equal(result.solution(0.0).A, result.model.A)
        for E in (0.0, 0.5, -0.5, 1.0):
            other = result.solution(E)
            assert max(r.ratio.max() for r in model_residuals(problem, other)) <= level * (1 + 1e-5)
            outside = np.abs(other(np.exp(1j * omega * DT)) - centre) - radius
            assert outside.max() <= spare


WIDER = 11.0  # than the scatter of the realisations: what pairs at rough poles need
MIRROR = np.array([635.0, 806, 921, 1315, 1674, 2124, 2310, 2544])  # Hz


def mirror_entry():
    """Entry (1, 1) of the steering mirror: mean and statistical bound over the realisations of the training set, in um."""
    u, y = (np.load(rid.datasets.find(f"fsm_cubespec/{name}_300mV_train.npy")).mean(axis=3) for name in "uy")
    records = [
        rid.TimeRecord(*(a[..., k] - a[..., k].mean(axis=0) for a in (u, 1e6 * y)), dt=1 / 6400, initial="periodic")
        for k in range(u.shape[2])
    ]
    return rid.estimate_frf(records).entry(0, 0)


@pytest.mark.slow
@pytest.mark.realdata
def test_measured_lines_are_answered_with_proof():
    """Every 12th line; pairs at rough poles: what the realisations scatter refutes them, eleven times as much doesn't."""
    frf = mirror_entry().select(slice(None, None, 12))
    basis = rid.kautz(2 * np.pi * MIRROR, np.full(8, 0.01), dt=1 / 6400, repeat=2, delay=1)
    prior = rid.Prior(gain_bound=1.3, decay_rate=1.3)
    for factor, verdict in ((WIDER, True), (1.0, False)):
        data = frf.with_bound(factor * frf.bound)
        result = rid.identify(rid.MixedProblem(frequency=data, prior=prior, parametric=basis))
        assert result.verification.passed
        assert (result.margin_lower > 1, result.consistent) == (not verdict, verdict)


@pytest.mark.slow
@pytest.mark.realdata
def test_all_measured_lines_in_one_command(tmp_path, capsys, monkeypatch):
    """3839 lines, eleven times the bound of the realisations, pairs at the modes: model, bounds, proof and report."""
    from support.command_line import main as run

    monkeypatch.chdir(tmp_path)
    frf = mirror_entry()
    np.savez("mirror.npz", omega=frf.omega, values=frf.values[:, 0, 0], bound=WIDER * frf.bound[:, 0, 0], dt=frf.dt)
    modes = [word for hz in MIRROR for word in ("--mode", f"{hz:g}:0.01")]
    command = ["identify", "--frequency", "mirror.npz", *modes, "--repeat", "2", "--report", "mirror.html"]
    code, out, _ = run(command, capsys, monkeypatch)
    print(out)
    assert code == 0
    assert "FAILS" not in out
    assert (tmp_path / "mirror.html").stat().st_size > 1e5
    assert rid.load("result").verification.passed
