"""Mistakes about the controller that ran: each is named with its size, and clean records are told nothing."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from support.cases import slow
from support.loop_mistakes import MISTAKES, case_of, truth_of
from support.refusals import refused

NAMED, ACCUSED = 0.95, 0.02


@pytest.mark.parametrize(("seeds", "samples"), [(range(1), 150), slow(range(50), 600)])
def test_every_mistake_that_stands_out_of_the_noise_is_named(seeds, samples):
    counted = 0
    for mistake in MISTAKES:
        made = [case_of(mistake, seed, samples=samples) for seed in seeds]
        cases = [case for case in made if case is not None and case.effect >= 1]
        named = [case.named(case.loop.faults(case.record)) for case in cases]
        assert sum(named) >= NAMED * len(named), (mistake, named)
        counted += len(named)
    assert counted >= 0.8 * len(MISTAKES) * len(seeds)


@pytest.mark.parametrize(("seeds", "samples"), [(4, 200), slow(200, 600)])
def test_a_record_without_mistakes_is_told_nothing(seeds, samples):
    told = []
    for seed in range(seeds):
        case = case_of("", seed, samples=samples)
        told += [(seed, faults)] if (faults := case.loop.faults(case.record)) else []
    assert len(told) <= ACCUSED * seeds, told


CONTROLLER = control.ss(control.tf([0.8, -0.5], [1, -0.6], 0.1))
PLANT = control.ss(0.9, 1.0, 0.2, 0.0, 0.1)


def record_of(controller=CONTROLLER, samples=200):
    """An exact record of the loop, u = r - C y."""
    r = np.random.default_rng(0).standard_normal(samples)
    y = control.forced_response(control.feedback(PLANT, controller), inputs=r).outputs
    return rid.TimeRecord(r - control.forced_response(controller, inputs=y).outputs, y, dt=0.1, reference=r)


@pytest.mark.parametrize(
    ("change", "kind", "where", "size"),
    [
        ({}, None, "", None),
        ({"y": lambda one: one.y / 1000}, "unit", "controller", 1000),  # or the gain of the controller
        ({"reference": lambda one: one.reference / 1.05}, "unit", "reference", 1.05),
        ({"reference": lambda one: -one.reference}, "sign", "reference", -1),
        ({"u": lambda one: -one.u}, "sign", "input u", -1),
        ({"y": lambda one: np.roll(one.y, 2)}, "late", "controller", -2),
        ({"y": lambda one: one.y + 0.25}, "offset", "output", 0.25),
        ({"u": lambda one: np.clip(one.u, -1.5, 1.5)}, "saturated", "input", 0.13),
    ],
)
def test_the_fault_says_where_and_how_large(change, kind, where, size):
    record = record_of()
    told = rid.Loop(CONTROLLER).faults(dataclasses.replace(record, **{name: of(record) for name, of in change.items()}))
    if kind is None:
        assert told == ()
        return
    (fault,) = told
    assert (fault.kind, fault.where) == (kind, where)
    assert fault.size == (size if size is None else pytest.approx(size, rel=1e-3))


def test_two_mistakes_that_make_the_same_record_are_both_told():
    """``r = u + C y`` with u and r exchanged is ``u = r + C y``."""
    told = rid.Loop(-CONTROLLER).faults(record_of())
    assert [(fault.kind, fault.where) for fault in told] == [
        ("sign", "controller"),
        ("exchanged", "input and reference"),
    ]


def test_an_unknown_controller_is_another_one_and_its_gain_is_named():
    record = record_of()
    (fault,) = rid.Loop(CONTROLLER / 1.05).faults(record)
    assert (fault.kind, fault.size) == ("controller", pytest.approx(1.05))
    (fault,) = rid.Loop(control.ss(control.tf([0.8, 0.1], [1, 0.6], 0.1))).faults(record)
    assert (fault.kind, fault.where) == ("controller", "controller")
    assert fault.size > 0.05  # part of the signals


@pytest.mark.parametrize("power", [-60, pytest.param(60, marks=pytest.mark.slow)])
def test_faults_do_not_depend_on_the_units(power):
    unit, wrong = 2.0**power, CONTROLLER / 1.3
    record = record_of()
    (fault,) = rid.Loop(wrong).faults(record)
    other = dataclasses.replace(record, u=unit * record.u, reference=unit * record.reference)
    (same,) = rid.Loop(control.ss(wrong.A, wrong.B, unit * wrong.C, unit * wrong.D, 0.1)).faults(other)
    assert same == fault


def test_a_controller_starts_at_any_state():
    truth = truth_of(1)
    assert np.abs(np.linalg.eigvals(truth.controller.A)).max() > 1 - 1e-9  # it integrates
    for seed in range(2):
        case = case_of("", seed, samples=200)
        assert case.loop.faults(case.record) == ()


def test_a_record_without_reference_says_so_and_gets_the_one_that_its_signals_imply():
    record, loop = record_of(), rid.Loop(CONTROLLER)
    bare = dataclasses.replace(record, reference=None)
    (fault,) = loop.faults(bare)
    assert (fault.kind, fault.where) == ("no reference", "reference")
    again = loop.with_reference(bare)
    np.testing.assert_allclose(again.reference, record.reference, atol=1e-12)
    assert loop.faults(again) == ()
    periodic = dataclasses.replace(bare, initial="periodic")
    assert np.abs(loop.residual(loop.with_reference(periodic))).max() < 1e-12


def test_what_cannot_be_tested_is_refused():
    record = record_of()
    refused("in continuous time", rid.Loop(control.ss(-1.0, 1.0, 1.0, 0.0)).faults, record)
    refused("must have a `reference` of 1 signals", rid.Loop(CONTROLLER).faults, record_of_two(record))
    refused("at the input", rid.Loop(CONTROLLER, excitation="reference").with_reference, record)
    unstable = control.ss(1.2, 1.0, 0.3, 0.0, 0.1)
    plant = control.ss(0.5, 1.0, 1.0, 0.0, 0.1)
    refused("is not stable", rid.Loop(unstable, plant).with_reference, record)


def record_of_two(record):
    return dataclasses.replace(record, reference=np.hstack([record.reference, record.reference]))


def test_one_row_and_one_output_of_a_matrix_are_told_apart():
    rng = np.random.default_rng(0)
    gain = np.array([[0.4, -0.2], [0.1, 0.5]])
    loop = rid.Loop(control.ss([], [], [], gain, 0.1))
    r, y = rng.standard_normal((300, 2)), rng.standard_normal((300, 2))
    row = rid.TimeRecord(r - y @ (np.diag([1.0, 1.2]) @ gain).T, y, dt=0.1, reference=r)
    (fault,) = loop.faults(row)
    assert (fault.kind, fault.where, fault.size) == ("controller", "controller, input u2", pytest.approx(1.2))
    column = rid.TimeRecord(r - y @ gain.T, y / [1.2, 1.0], dt=0.1, reference=r)
    (fault,) = loop.faults(column)
    assert (fault.kind, fault.where, fault.size) == ("unit", "output y1", pytest.approx(1.2))
