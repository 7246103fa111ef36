"""Sections of controllers: a product of known factors is split into the same, by closed forms in s and z."""

import dataclasses

import control
import numpy as np
import pytest

from robustid.controllers.by_hand import HZ, Corner, Gains, Kept, OneRoot, Sections, TwoRoots
from robustid.controllers.splitting import split
from robustid.controllers.structure import basis_of
from robustid.core import StateMatrices, points_of, response_at
from robustid.design import FIR, PID, Fixed, LeadLag, LowPass, Notch
from robustid.errors import InputError

DT = 1e-3
PARTS = (
    Gains(2.0, 200.0, 0.01, 200.0),
    TwoRoots(31.0, 0.05, 30.0, 0.6),
    TwoRoots(90.0, 0.02, 88.0, 1.3),
    OneRoot(5.0, 60.0),
    Corner(180.0, 2),
)
STRUCTURE = (
    PID(filter=HZ * 200),
    Notch((HZ * 20, HZ * 40), 0.6),
    Notch(HZ * 88, 1.3),
    LeadLag(HZ * 60),
    LowPass(HZ * 180, 2),
)
AT = [HZ * hz for hz in (200.0, 30.0, 88.0, 60.0, 180.0)]


def values(system, omega, dt):
    return response_at(StateMatrices.of(system), points_of(omega, dt))[:, 0, 0]


def frequencies(dt):
    return np.geomspace(0.1, 0.999 * np.pi / dt if dt else 1e5, 300)


def closed_form(omega, dt):
    """The product of PARTS, with every root where it is in s and gain 1 at frequency 0."""
    x = points_of(omega, dt)
    one = 1.0 if dt else 0.0

    def at(s):
        return np.exp(s * dt) if dt else s

    def ratio(zeros, poles):
        top, bottom = np.poly([at(s) for s in zeros]), np.poly([at(s) for s in poles])
        plain = np.polyval(top, x) / np.polyval(bottom, x)
        return plain * np.polyval(bottom, one) / np.polyval(top, one)

    def quadratic(hz, damping):
        return np.roots([1, 2 * damping * HZ * hz, (HZ * hz) ** 2])

    a = at(-HZ * 200)
    integrator, derivative = (dt or 1.0) / (x - one), (one - a) / (dt or 1.0) * (x - one) / (x - a)
    found = 2.0 + 200.0 * integrator + 0.01 * derivative
    found = found * ratio(quadratic(31, 0.05), quadratic(30, 0.6)) * ratio(quadratic(90, 0.02), quadratic(88, 1.3))
    found = found * ratio([-HZ * 5], [-HZ * 60])
    w = HZ * 180
    s = 2 / dt * (x - 1) / (x + 1) if dt else x
    return found / (1 + np.sqrt(2) * s / w + (s / w) ** 2)


@pytest.mark.parametrize("dt", [DT, 0.0])
def test_a_row_of_sections_has_the_closed_form(dt):
    omega = frequencies(dt)[:-2]  # sampled, the low-pass filter has its zeros at the end
    wanted = closed_form(omega, dt)
    assert np.abs(values(Sections(dt, 1.0, PARTS).system, omega, dt) / wanted - 1).max() < 1e-9


@pytest.mark.parametrize("dt", [DT, 0.0])
def test_a_product_of_known_factors_is_split_into_the_same(dt):
    given = Sections(dt, 1.0, PARTS)
    found = split(given.controller(), STRUCTURE, AT, dt)
    assert [type(one) for one in found.parts] == [type(one) for one in PARTS]
    assert found.gain == 1.0
    for name, value in given.numbers.items():
        assert found.numbers[name] == pytest.approx(value, rel=1e-9), name
    omega = frequencies(dt)[:-2]
    assert np.abs(values(found.system, omega, dt) / values(given.system, omega, dt) - 1).max() < 1e-9


STRUCTURES = (
    (PID(),),
    (PID(integral=False),),
    (PID(filter=300.0, integral=False),),
    (PID(), LeadLag(900.0)),
    (PID(), LeadLag(900.0), Notch(700.0)),
    (PID(filter=800.0), Notch(300.0), Notch(320.0, 1.5)),
    (Notch(300.0), LeadLag(50.0), LeadLag(900.0)),
    (PID(filter=800.0), FIR(3)),
    (FIR(4),),
    (PID(), Fixed(control.ss(0.5, 0.5, 1, 0, DT)), LowPass(900.0, 1)),
    (LowPass(900.0, 1),),
)


@pytest.mark.parametrize("structure", STRUCTURES, ids=lambda one: "-".join(type(part).__name__ for part in one))
def test_any_controller_of_a_structure_comes_back_from_its_sections(structure):
    """Whatever the numerator: complex, real, unstable or at negative z; what has no numbers is kept."""
    at = [one[0] for factor in structure for one in factor.free]
    basis, omega, rng = basis_of(structure, at, DT), frequencies(DT), np.random.default_rng(len(structure))
    for _ in range(12):
        given = basis.controller(rng.standard_normal(basis.count))
        found = split(given, structure, at, DT)
        true, again = values(given, omega, DT), values(found.controller(), omega, DT)
        assert np.abs(again - true).max() <= 1e-9 * np.abs(true).max()
        assert np.all(np.abs(again - true) <= 1e-7 * np.abs(true) + 1e-12 * np.abs(true).max())


def test_factors_without_numbers_of_their_own_are_kept_and_a_pair_over_pi_and_lead_is_a_pid():
    structure = (Notch(300.0), Fixed(control.ss(0.5, 0.5, 1, 0, DT)))
    s = Notch(300.0).parts([300.0]).poles[0]
    poles = np.exp(np.array([s, s.conjugate()]) * DT)
    given = control.ss(control.zpk([0.9, 1.05], poles, 3.0, DT)) * structure[1].model  # one zero is stable, one is not
    found = split(given, structure, [300.0], DT)
    assert [(type(one), one.name) for one in found.parts] == [(Kept, "known model"), (Kept, "notch")]
    assert list(found.numbers) == ["gain"]
    pid = Gains(1.0, 500.0, 0.02, 100.0)
    given = Sections(DT, 1.0, (pid,)).controller()
    assert np.iscomplex(given.zeros()).all()
    (joined,) = split(given, (PID(), LeadLag(HZ * 100)), [HZ * 100], DT).parts
    assert isinstance(joined, Gains)
    assert dataclasses.astuple(joined) == pytest.approx(dataclasses.astuple(pid))


def test_numbers_are_turned_by_name_and_what_makes_no_section_is_refused():
    given = Sections(DT, 1.0, PARTS)
    turned = given.turned({"gain": 2.0, "0-kp": -1.0, "3-zero_hz": -7.0, "1-zero_damping": -0.1})
    assert turned.numbers == given.numbers | {"gain": 2.0, "0-kp": -1.0, "3-zero_hz": -7.0, "1-zero_damping": -0.1}
    s = np.log(turned.controller().zeros()) / DT
    assert np.abs(s - 2 * np.pi * 7).min() < 1e-6
    for name, value, words in (
        ("1-zero_hz", 0.0, "must not be 0"),
        ("1-pole_hz", 600.0, "half the sample rate, 500 Hz"),
        ("2-pole_damping", 0.0, "above 0"),
        ("0-kp", np.nan, "finite"),
        ("9-kp", 1.0, "must be some of"),
    ):
        with pytest.raises(InputError, match=words):
            given.turned({name: value})


def test_a_controller_of_another_structure_is_refused():
    with pytest.raises(InputError, match="no numerator gives its values"):
        split(Sections(DT, 1.0, PARTS).controller(), (PID(),), [], DT)
