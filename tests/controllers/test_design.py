"""Designs of controllers: against closed forms, search over their numbers, and members of the set that they are proved for."""

import control
import numpy as np
import pytest
import scipy.signal

import robustid as rid
from robustid.controllers.conditions import conditions_of
from robustid.controllers.designing import At, Task
from robustid.controllers.discs import Discs
from robustid.controllers.plants import Plants
from robustid.controllers.structure import basis_of
from robustid.core import StateMatrices, points_of
from robustid.design import FIR, PID, Bandwidth, Fixed, LeadLag, Limits, LowPass, Notch
from support.design_cases import DT, PEAK, band_of, reached, values_of
from support.unstable_loop import growing


@pytest.mark.parametrize("dt", [0.0, 0.001])
def test_a_structure_holds_every_numerator_over_its_poles(dt):
    factors = [PID(filter=900.0), Notch(380.0, 0.4), LeadLag(50.0), LowPass(2000.0, 2)]
    basis = basis_of(factors, [900.0, 380.0, 50.0, 2000.0], dt)
    assert basis.count == 3 + 2 + 1
    omega = np.geomspace(1.0, 3000.0, 60)
    x = points_of(omega, dt)
    poles = [0.0, -900.0, -50.0, 380.0 * (-0.4 + 1j * np.sqrt(0.84)), 380.0 * (-0.4 - 1j * np.sqrt(0.84))]
    bottom = np.poly(np.exp(np.array(poles) * dt) if dt else poles)
    low = control.ss(control.tf([2000.0**2], [1, np.sqrt(2) * 2000.0, 2000.0**2]))
    low = control.c2d(low, dt, "tustin") if dt else low
    top = np.random.default_rng(0).standard_normal(6) * (1.0 if dt else 500.0 ** np.arange(6))
    true = np.polyval(top, x) / np.polyval(bottom, x) * values_of(low, omega)
    found = basis.response(omega)[:, :, 0, 0]
    weight = 1 / np.abs(true)[:, None]
    both = np.concatenate([(weight * found).real, (weight * found).imag])
    fitted = np.linalg.lstsq(both, np.concatenate([np.real(true / np.abs(true)), np.imag(true / np.abs(true))]))[0]
    assert np.abs(found @ fitted / true - 1).max() < 1e-6
    model = basis.controller(fitted)
    assert np.abs(values_of(model, omega) / true - 1).max() < 1e-6
    near = 1e-6  # of the integrator
    limit = values_of(model, np.array([near]))[0] * ((np.exp(1j * near * dt) - 1) / dt if dt else 1j * near)
    assert np.real(limit) == pytest.approx(basis.integral @ fitted, rel=1e-3)


def test_past_samples_and_a_known_filter():
    delay = control.ss(control.tf([1], [1, 0], DT))
    basis = basis_of([FIR(3), Fixed(delay)], [], DT)
    z = np.exp(1j * np.linspace(0.1, 3, 20))
    true = (1 - 0.5 / z + 0.25 / z**2 + 2 / z**3) / z
    found = basis.response(np.linspace(0.1, 3, 20) / DT)[:, :, 0, 0]
    fitted = np.linalg.lstsq(np.concatenate([found.real, found.imag]), np.concatenate([true.real, true.imag]))[0]
    assert np.abs(found @ fitted - true).max() < 1e-12


def test_conditions_are_the_limits_for_all_values_of_a_disc():
    """|S|, |T|, |C S|, |P S| at most a limit for all F of a disc, margins of the gain and phase, against its dense edge."""
    rng, turn = np.random.default_rng(1), np.exp(2j * np.pi * np.arange(2000) / 2000)
    discs = Discs.of(np.ones(1), np.full((1, 1, 1), 0.6 - 0.9j), np.array([0.2]), np.ones((1, 1)))
    F = discs.centre[:, 0] + discs.radius * turn
    limits = {
        "sensitivity_peak": (1.7, lambda C: np.abs(1 / (1 + F * C))),
        "complementary_peak": (1.4, lambda C: np.abs(F * C / (1 + F * C))),
        "control_peak": (1.1, lambda C: np.abs(C / (1 + F * C))),
        "process_peak": (0.9, lambda C: np.abs(F / (1 + F * C))),
        "attenuation": (0.8, lambda C: np.abs(1 / (1 + F * C))),
        "roll_off": (0.6, lambda C: np.abs(F * C / (1 + F * C))),
    }
    limits |= {"disturbance": limits["process_peak"], "action": limits["control_peak"]}
    limits["tracking"] = 0.6, lambda C: 0.36 / np.abs(F * C / (1 + F * C))  # at least 0.6
    for name, (limit, size) in limits.items():
        given = limit if name.endswith("peak") else [(0.5, 2.0, limit)]
        (condition,) = conditions_of(Limits(**{"sensitivity_peak": None, name: given}), discs)
        sides = set()
        for C in rng.standard_normal(300) + 1j * rng.standard_normal(300):
            kept, worst = condition.excess(np.full((1, 1, 1), C))[0] >= 0, size(C).max()
            if np.all(np.abs(1 + discs.centre[0] * C) > discs.radius * np.abs(C)):  # -1 is not among the values of L
                assert kept == (worst <= limit) or worst == pytest.approx(limit, rel=1e-4)
                sides.add(bool(kept))
        assert sides == {True, False}, name


def test_a_gain_and_a_phase_margin_keep_their_arcs_clear():
    discs = Discs.of(np.ones(1), np.full((1, 1, 1), 0.6 - 0.9j), np.array([0.1]), np.ones((1, 1)))
    gain, phase = conditions_of(Limits(sensitivity_peak=None, gain_margin=2.0, phase_margin=0.7), discs)
    rng, turn = np.random.default_rng(2), np.exp(2j * np.pi * np.arange(500) / 500)
    for C in rng.standard_normal(400) + 1j * rng.standard_normal(400):
        L = (discs.centre[:, 0] + discs.radius * turn) * C
        if gain.excess(np.full((1, 1, 1), C))[0] >= 0:
            assert np.all(np.abs(1 + np.linspace(1, 2, 50)[:, None] * L) > 1e-3)
        if phase.excess(np.full((1, 1, 1), C))[0] >= 0:
            t = np.linspace(-0.7, 0.7, 50)[:, None]
            assert np.all(np.abs(1 + np.exp(1j * t) * L) > 1e-4)


@pytest.mark.slow
def test_the_integral_gain_of_a_first_order_plant():
    """PI with 0.1/(z - 0.9): the largest integral gain for |S| <= 2 within the same discs, over a fine grid of both gains."""
    plant = control.ss(control.tf([0.1], [1, -0.9], DT))
    omega = np.linspace(3.0, 312.0, 70)
    frf = rid.FrequencyResponse(omega, values_of(plant, omega), bound=1e-3, dt=DT)
    problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.2, decay_rate=1.08))
    band = rid.band(problem, model=plant)
    found = rid.design_controller(band, PID(), maximise="integral gain")
    assert found.status.name == "PROVED"
    discs = Plants.of(band).discs(np.geomspace(0.3, np.pi / DT, 500))
    z = np.exp(1j * discs.omega * DT)
    kp, ki = (one.ravel() for one in np.meshgrid(np.linspace(-1, 15, 121), np.geomspace(100.0, 900.0, 121)))
    a, b = 0.1 * kp - 1.9, 0.9 + 0.1 * (ki * DT - kp)  # of z^2 + a z + b
    stable = (np.abs(b) < 1) & (np.abs(a) < 1 + b)
    kp, ki = kp[stable], ki[stable]
    C = kp[:, None] + ki[:, None] * DT / (z - 1)
    kept = np.all(np.abs(1 + discs.centre[:, 0, 0] * C) - discs.radius * np.abs(C) >= 0.5, axis=1)
    best = ki[kept].max()
    assert 0.95 * best <= found.level <= 1.02 * best


@pytest.mark.parametrize("seed", [pytest.param(seed, marks=pytest.mark.slow) for seed in (0, 1, 5, 14)])
def test_a_design_is_proved_as_good_as_search_and_no_member_contradicts_it(seed):
    plant, design, by_search = reached(seed)
    assert design.status.name == "PROVED"
    assert design.level >= 0.97 * by_search
    (proof,) = design.proofs
    assert proof.peaks["sensitivity"].value <= PEAK * 1.001
    omega = np.linspace(0.01, np.pi / DT, 10_000)
    C = values_of(design.controller, omega)
    L = values_of(plant, omega) * C
    assert np.abs(control.feedback(plant, design.controller).poles()).max() < 1
    assert np.abs(1 / (1 + L)).max() <= PEAK
    assert np.abs(L[omega <= design.level]).min() >= 1
    centre, radius = proof.plant_at(omega)
    rng = np.random.default_rng(seed)
    for _ in range(20):  # values of the discs, one to a frequency
        F = centre[:, 0, 0] + radius * np.exp(2j * np.pi * rng.uniform(size=omega.size))
        assert np.abs(1 / (1 + F * C)).max() <= PEAK * 1.001


@pytest.mark.slow
def test_fifty_designs_against_search():
    found = [reached(seed) for seed in range(50)]
    assert all(design.status.name == "PROVED" for _, design, _ in found)
    ratios = np.array([design.level / by_search for _, design, by_search in found])
    assert np.sum(ratios >= 0.98) >= 45, np.sort(ratios)


@pytest.fixture(scope="module")
def first():
    return band_of(1)[1]


@pytest.mark.slow
def test_two_bands_have_one_controller(first):
    second = band_of(7)[1]
    both = rid.design_controller([first, second], PID())
    alone = [rid.design_controller(one, PID()).level for one in (first, second)]
    assert both.status.name == "PROVED"
    assert len(both.proofs) == 2
    assert both.level <= 1.02 * min(alone)


def test_a_design_is_proved_and_its_own_plant_keeps_it(first):
    design = rid.design_controller(first, PID(), limits=Limits(gain_margin=2.0, roll_off=[(150.0, 310.0, 0.9)]))
    assert design.status.name == "PROVED"
    (proof,) = design.proofs
    assert proof.peaks["sensitivity"].value <= PEAK * 1.001
    assert proof.margins.gain[1] >= 1.998
    omega = np.linspace(0.01, np.pi / DT, 2000)
    plant, C = band_of(1)[0], values_of(design.controller, omega)
    L = values_of(plant, omega) * C
    assert np.abs(control.feedback(plant, design.controller).poles()).max() < 1
    assert np.abs(1 / (1 + L)).max() <= PEAK
    assert np.abs(L / (1 + L))[omega >= 150].max() <= 0.9
    assert np.abs(L[omega <= design.level]).min() >= 1
    assert design.limited_by[0] in design.shares


def test_an_unstable_plant_in_its_loop():
    """The mass of 1/(z - 1.1) under the gain .5: PI in place of it, from the loop that ran."""
    plant, loop, _, band = growing()
    found = rid.design_controller(rid.loop_bounds(band, loop), PID(), maximise="integral gain")
    assert found.status.name == "PROVED"
    assert np.abs(control.feedback(plant, found.controller).poles()).max() < 1
    assert found.level > 0


def test_what_cannot_be_had_is_said(first):
    found = rid.design_controller(first, PID(), limits=Limits(sensitivity_peak=1.5, attenuation=[(1.0, 200.0, 0.01)]))
    assert found.status.name == "NONE"
    assert "no controller of this structure" in found.summary()
    assert found.obstacle().have > 1  # the plant may be 0 where it is to be controlled
    assert found.limited_by[0] == "attenuation"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"structure": "PID"}, "`structure` must be factors of robustid.design"),
        ({"structure": []}, "at least one factor"),
        ({"structure": PID(filter=-3.0)}, "`filter` must be positive"),
        ({"structure": Notch((300.0, 200.0))}, "an interval from low to high"),
        ({"structure": LowPass(100.0, 3)}, "must be 1 or 2"),
        ({"structure": Fixed(control.ss(0.5, 1.0, 1.0, 0.0, 0.02))}, "dt = 0.02 s; the plant has dt = 0.01 s"),
        ({"structure": PID(integral=False), "maximise": "integral gain"}, "must hold an integrator"),
        ({"maximise": "speed"}, "`maximise` must be one of"),
        ({"limits": 2.0}, "must be Limits"),
        ({"bands": 3}, "must be a Band"),
        ({"bands": []}, "at least one band"),
    ],
)
def test_what_makes_no_sense_is_refused(first, change, words):
    with pytest.raises(rid.RobustIdError, match=words):
        rid.design_controller(**{"bands": first, "structure": PID(), **change})


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"sensitivity_peak": 0.9}, "must be above 1"),
        ({"gain_margin": 1.0}, "must be above 1"),
        ({"phase_margin": 60.0}, "between 0 and pi/2 rad"),
        ({"attenuation": [(3.0, 1.0, 0.1)]}, "rows \\(low, high, value\\)"),
        ({"control_peak": -1.0}, "`control_peak` must be positive"),
    ],
)
def test_limits_that_make_no_sense_are_refused(given, words):
    with pytest.raises(rid.InputError, match=words):
        Limits(**given)


@pytest.mark.slow
def test_numerators_split_into_those_of_the_factors(first):
    """A PID with a skewed notch, as drives run it, is what a structure gives: zeros in pairs or real."""
    found = rid.design_controller(first, [PID(filter=200.0), Notch(60.0)])
    zeros, poles, gain = scipy.signal.ss2zpk(*(np.asarray(one) for one in StateMatrices.of(found.controller)))
    assert zeros.size == poles.size == 4
    assert np.isreal(gain)
    assert np.abs(np.sort_complex(zeros) - np.sort_complex(zeros.conj())).max() < 1e-9


def test_a_limit_that_is_broken_between_frequencies_is_seen(first):
    """With ten frequencies a controller breaks the peak of S between them: where it is told, and where a dense look says so."""
    plants = Plants.of(first)
    task = Task.of([plants], (PID(),), Limits(), Bandwidth())
    task.grids = [task.grids[0][::12]]
    here = At(task, [])
    found = here.raised(here.first())
    where = np.array(task.broken(found))

    def room(omega):
        discs, C = plants.discs(omega), values_of(found.controller, omega)
        return np.abs(1 + discs.centre[:, 0, 0] * C) - discs.radius * np.abs(C) - 1 / PEAK

    assert where.size
    high = where[where > found.level]
    assert np.all(room(high) < 0)
    dense = np.geomspace(task.grids[0][0], task.grids[0][-1], 4000)
    worst = dense[np.argmin(room(dense))]
    assert np.min(np.abs(np.log(where / worst))) < 0.1
