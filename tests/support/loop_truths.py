"""Machines in loops from their records: truths at the edge of the class of R against every band, beside an open-loop estimate."""

import dataclasses
from typing import NamedTuple
from unittest import mock

import numpy as np

import robustid as rid
from robustid.core import Real, StateMatrices, poles_of, response_at, simulate
from robustid.guarantees.linear.entry_band import EntryBand
from support.loops import Measured, measured_machine

DT, LINES = 0.01, 40
PERIOD, PERIODS, SETTLED = 400, 10, 30  # of a periodic excitation, and periods before the record begins
SAMPLES = 8000  # of a random one
QUIET, LOUD = 0.05, 1.0  # rms of what the noise makes of y, over that of what the excitation makes
ROUNDED = 1e-9


class Recorded(NamedTuple):
    """A machine, the record of its loop, and what `estimate_frf` needs for it."""

    case: Measured
    record: rid.TimeRecord
    how: dict


def in_loop(case):
    """The loop from [r, v] to [u, y], v added to y: u = r - C y in one system, since the controller may not be stable."""
    A, B, C, _ = StateMatrices.of(case.plant)
    E, F, G, H = StateMatrices.of(case.controller)
    zero, one = np.zeros((len(E), 1)), np.eye(1)
    return StateMatrices(
        np.block([[A - B @ H @ C, -B @ G], [F @ C, E]]),
        np.block([[B, -B @ H], [zero, F]]),
        np.block([[-H @ C, -G], [C, zero.T]]),
        np.block([[one, -H], [0 * one, one]]),
    )


def recorded(seed, *, periodic=None, level=None, samples=SAMPLES):
    """Of even seeds a periodic excitation and little noise, of odd ones a random excitation and noise that moves y as much.

    The noise is of a colour, white noise behind one pole; its level and the excitation may be others.
    """
    case, rng = measured_machine(seed), np.random.default_rng([seed, 21])
    periodic = seed % 2 == 0 if periodic is None else periodic
    if periodic:
        index = np.linspace(3, PERIOD // 2 - 3, LINES).astype(int)
        spectrum = np.zeros(PERIOD // 2 + 1, complex)
        spectrum[index] = np.exp(2j * np.pi * rng.random(LINES))
        one = np.fft.irfft(spectrum)
        r = np.tile(one / one.std(), SETTLED + PERIODS)
        kept, how, start = PERIODS * PERIOD, {"period": PERIOD, "lines": index}, "periodic"
    else:
        r, kept, start = rng.standard_normal(samples), samples, "rest"
        how = {"lines": np.linspace(0.01 * samples, 0.49 * samples, LINES).astype(int)}
    pole = rng.uniform(0.5, 0.95)
    colour = (np.array([[part]]) for part in (pole, 1.0, pole, 1.0))
    v, nothing = simulate(StateMatrices(*colour), rng.standard_normal((r.size, 1)))[0][:, 0], np.zeros(r.size)
    moved, noise = (simulate(in_loop(case), np.stack(pair, axis=1))[0] for pair in ((r, nothing), (nothing, v)))
    part = (QUIET if periodic else LOUD) if level is None else level
    u, y = (moved + part * moved[:, 1].std() / noise[:, 1].std() * noise)[-kept:].T
    record = rid.TimeRecord(u, y, dt=DT, reference=r[-kept:], initial=start)
    return Recorded(case, record, how)


class Judged(NamedTuple):
    """Verdict on one machine: of R and its bands, and of the response from u to y."""

    missed: int  # lines at which R is not inside its bound
    consistent: bool  # R is not refuted by its own samples
    far: dict[str, float]  # largest distance of the truth from the centre, in radii: of P, S, T, PS, CS
    over: float  # peaks of the true loop over their bounds
    open_missed: int  # lines at which P is not inside the bound of the response from u to y
    open_refuted: bool  # the class of stable plants that is suggested for it has no member
    open_outside: float  # part of the frequencies at which P is outside its band
    gap: float  # nu-gap of its model to P: 1 if the poles that are not stable are not as many

    @property
    def inside(self):
        return self.consistent and max(self.far.values()) <= 1 + ROUNDED and self.over <= 1


def outside(frf, truth):
    return int(np.sum(np.abs(frf.values - truth) > np.asarray(frf.bound)))


def largest_part(true, discs):
    """Largest distance from the centres, in radii."""
    centre, radius = discs
    return float(np.max(np.abs(true - centre)[:, 0, 0] / np.ravel(radius)))


def remembered(method):
    """The method of an entry's band that keeps its last answer: four bounds at the same frequencies ask for the same discs."""
    last = {}

    def at(self, angles: Real):
        key = id(self), angles.tobytes()
        if key not in last:
            last.clear()
            last[key] = self, method(self, angles)
        centre, radius = last[key][1]
        return centre.copy(), radius.copy()

    return at


def distances(case, found, omega):
    """Of P, S, T, PS, CS, and of the peaks."""
    true = case.maps(omega)
    with mock.patch.object(EntryBand, "at", remembered(EntryBand.at)):
        discs, plant = found.at(omega), found.plant_at(omega)
    far = {name: largest_part(true[name], discs[name]) for name in true}
    far["plant"] = largest_part(response_of(case.plant, omega), plant)
    return far, max(float(np.abs(true[name]).max() / found.peaks[name].value) for name in true)


def response_of(system, omega):
    return response_at(StateMatrices.of(system), np.exp(1j * omega * DT))


def around_small_model(result):
    """The band of R about a small model."""
    return rid.band(result).with_model(rid.balanced_truncation(result.model, order=min(12, result.model.nstates)).model)


def judged(seed, frequencies, *, beside=True):
    """R from the record in the class whose edge it is at, and what is said without the controller, from the same record."""
    case, record, how = recorded(seed)
    omega = np.linspace(0, np.pi / DT, frequencies)
    frf = rid.prepare.loop_response(record, case.loop, **how)
    problem = rid.MixedProblem(frequency=frf, prior=case.problem.prior)
    result = rid.identify(problem)
    missed, far, over = outside(frf, response_of(case.residual, frf.omega)), {"plant": np.inf}, np.inf
    if result.consistent:
        far, over = distances(case, rid.loop_bounds(around_small_model(result), case.loop), omega)
    return Judged(
        missed, result.consistent, far, over, *(open_loop(case, record, how, omega) if beside else (0, 0, 0.0, 0.0))
    )


def open_loop(case, record, how, omega):
    """From u and y alone: lines outside, refuted, part of every fifth frequency outside the band, gap of the model."""
    frf = rid.estimate_frf(dataclasses.replace(record, reference=None), **how)
    problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.0, decay_rate=1.1))
    missed, omega = outside(frf, response_of(case.plant, frf.omega)), omega[::5]
    prior = rid.suggest_prior(problem).prior
    result = None if prior is None else rid.identify(dataclasses.replace(problem, prior=prior))
    if result is None or not result.consistent:
        return missed, True, 1.0, 1.0
    centre, radius = rid.band(result).at(omega)
    gap = rid.guarantee.nu_gap(
        case.plant, rid.balanced_truncation(result.model, order=min(12, result.model.nstates)).model
    )
    return missed, False, float(np.mean(np.abs(response_of(case.plant, omega) - centre) > radius)), gap.value


def unstable_poles(case):
    return int(np.sum(np.abs(poles_of(StateMatrices.of(case.plant).A)) >= 1))
