"""Modes from a frequency response: intervals that hold the truth, and that a conic solver confirms."""

import os
from pathlib import Path

import cvxpy as cp
import numpy as np
import pytest

import robustid as rid
from robustid.advice import suggest_kautz, suggest_prior
from robustid.advice.pole_fit import LineData, told_apart, wanted_in_basis
from robustid.advice.pole_interval import _least_squares, damped_outside
from robustid.advice.real_poles import over_decades
from robustid.core import Budget
from robustid.errors import InputTypeError
from robustid.formats import datasets
from support.measured import needs
from support.refusals import refusals
from support.structure import ANY

FINE = np.linspace(17.2, 18.1, 10)


@pytest.mark.parametrize("seeds", [1, pytest.param(12, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("extra", "determined"), [((), False), (FINE, True)])
def test_modes_of_the_structure_lie_in_their_intervals(extra, determined, seeds):
    held = 0
    for seed in range(seeds):
        data = rid.datasets.flexible_structure(seed=seed, extra_hz=extra)
        found = suggest_kautz(data.frequency)
        assert found.omega.size == 2
        assert found.delay == 1  # a zero-order-hold mode without feed-through
        np.testing.assert_allclose(found.omega, data.modes[:, 0], rtol=0.01)
        intervals = np.stack([found.omega_interval, found.damping_interval], axis=1)
        held += np.all((intervals[..., 0] <= data.modes) & (data.modes <= intervals[..., 1]))
        # 11 lines 2 Hz apart can't tell the light mode's damping; ten more around it can.
        assert found.undetermined[1] != determined
        assert not found.undetermined[0]
        assert ("measure more of them" in found.summary()) != determined
    assert held == seeds  # errors are within the bounds, so the true poles may not be left out


@pytest.mark.parametrize("damping", [0.5, 0.005])
def test_a_resonance_above_the_points_stays_where_they_refute_that_it_is_damped(damping):
    """Points up to 0.5 rad, a mode at 0.52 rad: light in the fit, whatever the truth is."""
    angle = np.linspace(0.02, 0.5, 60)
    rest = rid.kautz(0.52, damping, dt=1.0).response(angle) @ [1.0, 0.5]
    value = rid.kautz(0.2, 0.01, dt=1.0).response(angle) @ [1.0, 0.3] + rest
    data = LineData(angle, value, 0.01 * np.abs(value), 1.0)
    poles = np.log([[0.2, 0.01], [0.52, 0.005]])
    found = damped_outside(data, poles)
    np.testing.assert_array_equal(found[0], poles[0])
    assert (np.exp(found[1, 1]) >= 0.3) == (damping == 0.5)
    assert wanted_in_basis(found, data).tolist() == [True, damping != 0.5]


def smallest_margin(data, pole, other):
    """By a conic solver: pair at `pole`, double pair at `other`, three smooth terms."""
    angle = data.omega * data.dt
    pair, double = rid.kautz(*pole, dt=data.dt), rid.kautz(*other, dt=data.dt, repeat=2)
    columns = np.hstack([pair.response(angle), double.response(angle), np.exp(-1j * np.outer(angle, [0, 1, 2]))])
    weights = cp.Variable(columns.shape[1])
    residual = cp.multiply(1 / data.bound[:, 0, 0], data.values[:, 0, 0] - columns @ weights)
    return cp.Problem(cp.Minimize(cp.max(cp.abs(residual)))).solve(solver="CLARABEL")


def test_poles_outside_the_interval_are_refuted_by_a_conic_solver():
    data = rid.datasets.flexible_structure().frequency
    found = suggest_kautz(data)
    other = found.omega[0], found.damping[0]
    low, high = found.omega_interval[1]
    for omega in (low - 0.05 * (high - low), high + 0.05 * (high - low)):
        margins = [smallest_margin(data, (omega, zeta), other) for zeta in np.geomspace(1e-5, 0.1, 8)]
        assert min(margins) > 1
    heaviest = found.damping_interval[1, 1]
    for omega in np.linspace(low, high, 8):
        assert smallest_margin(data, (omega, 1.1 * heaviest), other) > 1
    assert smallest_margin(data, (found.omega[1], found.damping[1]), other) <= 1


@pytest.mark.parametrize("power", [60, pytest.param(-60, marks=pytest.mark.slow)])
def test_modes_do_not_depend_on_units(power):
    frf, factor = rid.datasets.flexible_structure(lines=6, extra_hz=FINE[::2]).frequency, 2.0**power
    values, bound = frf.values / factor, frf.bound / factor
    scaled = rid.FrequencyResponse(frf.omega * factor, values, bound=bound, dt=frf.dt / factor)
    one, two = suggest_kautz(frf), suggest_kautz(scaled)
    for name, unit in (("omega", factor), ("damping", 1), ("omega_interval", factor), ("damping_interval", 1)):
        np.testing.assert_allclose(getattr(two, name), getattr(one, name) * unit, rtol=1e-9)


def test_exact_data_give_exact_poles():
    omega, zeta, dt = np.array([40.0, 90.0, 130.0]), np.array([0.02, 0.005, 0.01]), 0.01
    line = np.linspace(5, 180, 120)
    basis = rid.kautz(omega, zeta, dt=dt, delay=1)
    values = basis.response(line * dt) @ np.array([1, 0.5, -0.3, 0.2, 0.1, 0.4])
    found = suggest_kautz(rid.FrequencyResponse(line, values, bound=1e-6, dt=dt))
    np.testing.assert_allclose(found.omega, omega, rtol=1e-6)
    np.testing.assert_allclose(found.damping, zeta, rtol=1e-4)
    few = rid.FrequencyResponse(line[::12], values[::12], bound=1e-3, dt=dt)
    problem = rid.MixedProblem(frequency=few, prior=ANY, parametric=found.basis)
    assert suggest_prior(problem, decay_rates=[1.2]).gains[0] == 0


def test_smooth_data_have_no_mode():
    frf = rid.FrequencyResponse(np.linspace(1, 100, 20), np.full(20, 0.3), bound=0.01, dt=0.01)
    found = suggest_kautz(frf)
    assert found.omega.shape == (0,)
    assert found.omega_interval.shape == (0, 2)
    assert found.basis is None
    assert found.summary().startswith("0 modes")


def test_options_of_suggest_kautz():
    frf = rid.datasets.flexible_structure(lines=6, extra_hz=FINE).frequency
    found = suggest_kautz(frf, modes=1, delay=2, repeat=2)
    assert found.omega.size == 1
    assert (found.basis.size, found.delay) == (4, 2)
    continuous = rid.FrequencyResponse(frf.omega, frf.values, bound=frf.bound)
    np.testing.assert_array_equal(suggest_kautz(continuous, dt=frf.dt).omega, suggest_kautz(frf).omega)
    without = rid.FrequencyResponse(frf.omega, frf.values, dt=frf.dt)
    np.testing.assert_allclose(suggest_kautz(without).omega[1], 2 * np.pi * 17.67, rtol=1e-3)


LINES = np.arange(1.0, 9.0)
EIGHT = rid.FrequencyResponse(LINES, np.ones(8), dt=0.1)


test_suggest_kautz_refuses = refusals(
    (lambda: suggest_kautz("frf"), "`frf` must be a FrequencyResponse; got str", InputTypeError),
    (
        lambda: suggest_kautz(rid.FrequencyResponse(LINES, np.ones(8)), dt=1.0),
        "`dt` = 1 s allows frequencies up to 3.14",
    ),
    (lambda: suggest_kautz(rid.FrequencyResponse(LINES, np.ones(8)), dt=-1.0), "`dt` must be positive"),
    (lambda: suggest_kautz(rid.FrequencyResponse(LINES, np.zeros(8), dt=0.1)), "`frf` is zero at all frequency points"),
    (lambda: suggest_kautz(EIGHT.select(slice(3))), "`frf` has 3 frequency points; at least 4"),
    (lambda: suggest_kautz(EIGHT, modes=4), "can't tell more than 3 modes"),
    (lambda: suggest_kautz(EIGHT, modes=0), "`modes` must be at least 1"),
    (lambda: suggest_kautz(EIGHT, repeat=0), "`repeat` must be at least 1"),
    (lambda: suggest_kautz(EIGHT, delay=0.5), "`delay` must be an integer", InputTypeError),
)


def torsion():
    needs("two_mass/MultisineTypeA.mat")
    bench = datasets.load("two_mass/MultisineTypeA.mat")
    record = rid.TimeRecord(bench.u, bench.y.sum(axis=1), dt=bench.dt, initial="periodic", reference=bench.reference)
    return rid.estimate_frf(record, period=2500)


@pytest.mark.realdata
def test_measured_torsion_shows_one_mode():
    frf = torsion()
    found = suggest_kautz(frf)
    assert found.omega.size == 1
    assert 75.5 < found.omega[0] / (2 * np.pi) < 77.5
    assert 0.01 < found.damping[0] < 0.03
    assert found.level[0] == 1  # the distortion beside the band is in the bound
    noise_alone = suggest_kautz(frf.with_bound(3.5 * frf.noise))
    assert noise_alone.level[0] > 1  # the bench isn't linear down to its noise
    assert "with bounds times" in noise_alone.summary()


@pytest.mark.realdata
@pytest.mark.parametrize(
    ("last", "modes", "every", "asked"),
    [(2000, 4, 8, 8), *(pytest.param(*size, marks=pytest.mark.slow) for size in ((2000, 4, 2, 9), (3400, 8, 2, 10)))],
)
def test_measured_mirror_shows_its_eight_modes(last, modes, every, asked):
    """From 625 Hz to 1.56 kHz, where four of them are, or to 2.66 kHz, among all that a fit takes: some are weak here."""
    # the first block of three orthogonal experiments, averaged over its two periods; (8192, 3, 6, 2) arrays
    signals = [np.load(needs(f"fsm_cubespec/{s}_300mV_train.npy")) for s in "uy"]
    U, Y = (np.fft.rfft(s[:, :, :3].mean(axis=3), axis=0)[800:last:every] for s in signals)
    lines = np.arange(800, last, every)
    full = np.all(np.linalg.svd(U, compute_uv=False)[:, -1:] > 1e-3 * np.abs(U).max(), axis=1)
    values = np.linalg.solve(U[full].transpose(0, 2, 1), Y[full].transpose(0, 2, 1)).transpose(0, 2, 1)[:, 0, 0]
    frf = rid.FrequencyResponse(2 * np.pi * 6400 / 8192 * lines[full], values, bound=0.06 * np.abs(values), dt=1 / 6400)
    found = suggest_kautz(frf, modes=asked).omega / (2 * np.pi)
    for hz in (635, 806, 921, 1315, 1674, 2124, 2310, 2544)[:modes]:
        assert np.abs(found / hz - 1).min() < 0.02, hz


@pytest.mark.slow
def test_a_mode_that_fits_as_well_with_any_damping_is_left_to_the_gain_bound():
    """Entry (1, 1) of the mirror hardly shows the mode at 922 Hz; taken along, its box of all dampings would leave no band."""
    for signal in "uy":
        needs(f"fsm_cubespec/{signal}_300mV_train.npy")
    record = datasets.load("fsm/train")
    whole = rid.estimate_frf(record, period=8192).band(500, 1700)
    radius = whole.bound.outer_radius[:, :1, :1]
    frf = rid.FrequencyResponse(whole.omega, whole.values[:, :1, :1], bound=radius, dt=whole.dt)
    found = suggest_kautz(frf)
    assert not np.any((found.omega > 2 * np.pi * 850) & (found.omega < 2 * np.pi * 970))
    assert np.all(found.damping_interval[:, 1] < 0.5)
    assert found.omega.size == found.omega_interval.shape[0] == found.level.size == 4
    prior = rid.Prior(gain_bound=5e-6, decay_rate=1.04)
    problem = rid.MixedProblem(frequency=frf, prior=prior, parametric=found.basis)
    one = rid.band(problem, box=(found.omega_interval, found.damping_interval), omega=frf.omega[::40])
    assert np.isfinite(one.radius).all()
    assert suggest_kautz(frf, modes=5).omega.size == 5  # as many as are asked for


def test_modes_that_coincide_are_one():
    pole, other = np.log([0.5, 0.4]), np.log([0.5001, 0.4])
    assert told_apart(np.array([pole, other, np.log([0.6, 0.4])])).shape == (2, 2)
    assert told_apart(np.array([pole, np.log([0.5, 0.3])])).shape == (2, 2)


@pytest.mark.realdata
@pytest.mark.slow
def test_of_two_modes_that_the_lines_do_not_tell_apart_one_is_left_to_the_gain_bound_so_that_the_mirror_has_a_band():
    frf = rid.estimate_frf(datasets.load("fsm/train"), period=8192).band(500, 1700)
    found = suggest_kautz(frf)
    assert "nothing bounds their amplitudes" in found.reason
    assert (
        found.omega.size >= 6
    )  # of 8, as the bounds of the response are: those near 1385 and 1450 Hz are the doubtful ones
    assert not np.any((found.omega > 2 * np.pi * 1350) & (found.omega < 2 * np.pi * 1480))
    prior = rid.Prior(gain_bound=1.0, decay_rate=1.05, scaling=np.median(np.abs(frf.values), axis=0))
    problem = rid.MixedProblem(frequency=frf, prior=prior, parametric=found.basis)
    band = rid.band(problem, box=found, knots=400)
    assert np.isfinite(band.radius).all()


@pytest.mark.slow
def test_the_truth_is_in_the_band_where_the_heavier_of_two_modes_was_left_to_the_gain_bound():
    """Modes at about 1382 and 1446 Hz beside two strong ones, bounds of 15 %: K and rho as the program suggests them."""
    dt, left_out = 1 / 6400, 0
    omega, between = (2 * np.pi * np.arange(900, 1700, step) for step in (4.0, 1.0))
    for seed in range(40):
        rng = np.random.default_rng(seed)
        hz = np.array([990, 1382 * rng.uniform(0.995, 1.005), 1446 * rng.uniform(0.99, 1.01), 1680])
        damping = np.array([0.012, rng.uniform(0.006, 0.012), rng.uniform(0.02, 0.05), 0.013])
        poles = np.exp(2 * np.pi * hz * dt * (-damping + 1j * np.sqrt(1 - damping**2)))
        size = np.array([1, rng.uniform(0.05, 0.3), rng.uniform(0.1, 0.5), 0.8]) * (1 - np.abs(poles))
        residue = size * np.exp(2j * np.pi * rng.random(4))

        def truth(omega, poles=poles, residue=residue):
            z = np.exp(1j * omega * dt)[:, None]
            return 0.3 + (residue / (z - poles) + residue.conj() / (z - poles.conj())).sum(axis=1)

        bound = 0.15 * np.abs(truth(omega))
        noise = bound * np.sqrt(rng.random(omega.size)) * np.exp(2j * np.pi * rng.random(omega.size))
        found = suggest_kautz(frf := rid.FrequencyResponse(omega, truth(omega) + noise, bound=bound, dt=dt))
        if "nothing bounds their amplitudes" not in found.reason:
            continue
        left_out += 1
        problem = rid.MixedProblem(
            frequency=frf, prior=rid.Prior(gain_bound=1.0, decay_rate=1.05), parametric=found.basis
        )
        prior = suggest_prior(problem).prior
        problem = problem.with_prior(gain_bound=prior.gain_bound, decay_rate=prior.decay_rate)
        centre, radius = rid.band(problem, box=found, knots=300).at(between)
        assert np.all(np.abs(centre[:, 0, 0] - truth(between)) <= radius[:, 0, 0]), seed
    assert left_out >= 5


# --- poles over decades


OMEGA = np.geomspace(1, 1e3, 60)


def response(values):
    return rid.FrequencyResponse(OMEGA, values, bound=1e-3 * np.abs(values))


@pytest.mark.parametrize("seed", [pytest.param(k, marks=pytest.mark.slow) if k else k for k in range(8)])
def test_damped_modes_over_decades_are_no_relaxations(seed):
    """Six modes of damping 0.3: pairs follow them, and a real pole would say what is not there."""
    rng, s = np.random.default_rng(seed), 1j * OMEGA
    values = sum(rng.uniform(0.5, 2) * f**2 / (s**2 + 0.6 * f * s + f**2) for f in 10 ** rng.uniform(0.3, 2.7, 6))
    assert over_decades(response(values), Budget()) is None


@pytest.mark.parametrize("seed", [pytest.param(k, marks=pytest.mark.slow) if k else k for k in range(8)])
def test_real_poles_are_found_and_nothing_over_less_than_two_decades(seed):
    rng, s = np.random.default_rng(seed), 1j * OMEGA
    places = np.geomspace(0.5, 500, 4) * np.exp(rng.uniform(-0.3, 0.3, 4))
    frf = response(0.1 + sum(rng.uniform(0.5, 2) * p / (s + p) for p in places))
    found = over_decades(frf, Budget())
    assert np.all(found.damping == 1)
    assert found.largest <= 1
    assert over_decades(frf.select(frf.omega < 90), Budget()) is None


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 20))])
def test_a_cell_of_two_relaxations_has_real_poles_whatever_modes_beside_a_remainder_leave(seed):
    """Of seed 0 four heavily damped modes keep to the bounds too, and none of them may stand in a class."""
    omega, rng = 2 * np.pi * np.geomspace(0.01, 1e4, 61), np.random.default_rng(seed)
    values = 0.02 + 0.03 / (1 + 0.015j * omega) + 0.05 / (1 + 1j * omega)
    noise = 0.002 * (rng.standard_normal(61) + 1j * rng.standard_normal(61))
    found = rid.suggest_kautz(rid.estimate_bound(rid.FrequencyResponse(omega, values * (1 + noise))))
    real = found.omega[found.damping == 1]
    assert np.abs(np.log(real / 1.0)).min() < 0.05
    assert np.abs(np.log(real * 0.015)).min() < 0.05


@pytest.mark.parametrize("seed", [4, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(8) if seed != 4)])
def test_a_cell_with_the_inductance_of_its_leads_keeps_its_relaxations(seed):
    """Relocated poles stay near the points and leave five times the bound; that of the inductance is far beyond them."""
    omega, rng = 2 * np.pi * np.geomspace(0.1, 1e4, 51), np.random.default_rng(seed)
    values = 0.0125 + 2e-7j * omega + 0.02 / (1 + 0.05j * omega) + 0.004 / (1 + 3e-4j * omega)
    noise = 0.002 * (rng.standard_normal(51) + 1j * rng.standard_normal(51)) / np.sqrt(2)
    frf = rid.estimate_bound(rid.FrequencyResponse(omega, values * (1 + noise)))
    assert over_decades(frf, Budget()).largest <= 1
    found = rid.suggest_kautz(frf)
    real = found.omega[found.damping == 1]
    assert np.abs(np.log(real * 0.05)).min() < 0.05
    assert np.abs(np.log(real * 3e-4)).min() < 0.05
    assert np.all(np.diff(np.sort(real)) > 0)  # of several far poles one stands for the straight line


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 10))])
def test_points_that_are_off_get_no_pair_of_no_width_over_decades(seed):
    """Pairs on such points explain them to rounding; in a class they have no place, and a pole at zero neither."""
    rng, omega = np.random.default_rng(seed), np.geomspace(250, 63000, 60)
    s = 1j * omega
    values = 0.5 + 30 * (1 + 300 / s) / (1 + s / 3000) + 1.4e-3 * s / (1 + s / 4e5)
    off = 0.15 * rng.choice([0, 1], p=[0.9, 0.1], size=60) * np.exp(2j * np.pi * rng.random(60))
    found = suggest_kautz(rid.FrequencyResponse(omega, values * (1 + off), bound=0.05 * np.abs(values)))
    assert np.all(found.damping >= 1e-5)
    assert np.all(found.omega >= 1e-3 * omega[0])


@pytest.mark.realdata
@pytest.mark.skipif(not os.environ.get("ROBUSTID_DATA"), reason="ROBUSTID_DATA names no folder of measured data")
def test_pairs_far_below_all_points_of_a_measured_impedance_are_no_modes():
    """Pairs of next to no damping around 2.2 Hz followed the slope of a sweep from 40 Hz to 10 kHz; no solver followed them."""
    with np.load(Path(os.environ["ROBUSTID_DATA"]) / "converter_dq" / "load_impedance.npz") as data:
        omega, values = data["omega"], data["values"][:, :1, :1]
    found = suggest_kautz(rid.FrequencyResponse(omega, values, bound=0.05 * np.abs(values)))
    assert found.omega.size > 1
    assert np.all((found.damping == 1) | (found.omega > omega[0] / 2))


def test_what_rises_towards_the_highest_points_is_a_choice_without_an_interval():
    """A loudspeaker: resonance at 60 Hz and the inductance of its coil; no pole of it lies near the points."""
    omega, rng = 2 * np.pi * np.geomspace(10, 20000, 120), np.random.default_rng(1)
    s = 1j * omega
    values = 6 + 4e-4 * s + 30 / (1 + 4 * (s / (120 * np.pi) + 120 * np.pi / s))
    noise = 0.003 * (rng.standard_normal(120) + 1j * rng.standard_normal(120))
    found = suggest_kautz(rid.estimate_bound(rid.FrequencyResponse(omega, values * (1 + noise))))
    far = found.omega > 2 * omega[-1]
    assert np.sum(far) == np.sum(~far) == 1
    assert np.all(np.ptp(found.omega_interval, axis=1)[far] == 0)
    (low, high), *_ = found.omega_interval[~far]
    assert low < 120 * np.pi < high
    assert "far above the frequency points" in found.reason


@pytest.mark.parametrize(("rows", "columns"), [(24, 5), (120, 16), (4, 9)])
def test_least_squares_are_those_by_singular_values_of_dependent_columns_too(rows, columns):
    rng = np.random.default_rng(rows)
    for dependent in (False, True) * 10:
        A, y = rng.standard_normal((rows, columns)), rng.standard_normal(rows)
        if dependent:
            A[:, -1] = A[:, 0]
        np.testing.assert_allclose(_least_squares(A, y), np.linalg.lstsq(A, y, rcond=1e-12)[0], rtol=1e-9, atol=1e-11)
