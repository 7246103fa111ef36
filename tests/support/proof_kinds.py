"""Random problems of proof files of every kind: of samples, with poles in a box, and in continuous time."""

import functools
import json
from typing import Any

import control
import numpy as np

import robustid as rid
from robustid.core import Real
from robustid.guarantees import Band, contradiction, proof_text
from robustid.guarantees.linear.functions import pairs_of
from support.passive import passive_edge
from support.proof_loops import shortened
from support.proofs import problem, sealed

Box = tuple[Real, Real]


@functools.cache
def proofs_of(seed: int) -> list[str]:
    """A band, a system, a contradiction, and all three of a problem with a record."""
    found: list[str] = []
    for posed, bad in ((problem(seed), problem(seed, off=3.0)), (with_record(seed), with_record(seed, off=3.0))):
        omega = posed.frequency[0].omega
        band = rid.band(posed, omega=np.linspace(omega[0], omega[-1], 4)[1:-1])
        found += [proof_text(band), proof_text(rid.identify(posed)), proof_text(rid.identify(bad))]
    return found


def with_record(seed: int, off: float = 0.0) -> rid.MixedProblem:
    return problem(seed, 4, off=off, samples=10)


def bare(value: str, factors: list[Any]) -> str:
    """The claim Re F <= value at a frequency, of a class with K = 3 and rho = 1.25, from no sample."""
    question = {
        "class": {"gain_bound": "3", "decay_rate": "1.25", "functions": {"A": [], "B": [], "C": [], "D": []}},
        "sample_time": "0.5",
        "units": {"frequency": "rad/s", "time": "s", "response": "m/N"},
        "level": "1",
        "data": [["1", "0", "0", "1"]],
        "records": [],
        "statements": [{"kind": "support", "omega": "2", "direction": ["1", "0"], "value": value}],
    }
    sums = {"base": ["0", "0"], "factors": factors, "multipliers": []}
    return sealed(
        question, {"powers": 0, "parameters": {"centre": [], "radius": [], "combinations": []}, "statements": [sums]}
    )


def factors_of_values() -> list[Any]:
    """Of Re phi(zeta) = (phi(zeta) + phi(zeta*))/2: f = k(., zeta)/2, g = f/|f|^2/2, and so for zeta*."""
    square = 1 / (1 - 1.25**-2)
    return [{"f": [[node, "0.5", "0"]], "g": [[node, repr(1 / square), "0"]]} for node in (2, 3)]


def box_of(posed: rid.MixedProblem, width: float = 0.002) -> Box:
    """A box around the poles of a problem: `width` in frequency to each side, and fifty times as much in damping."""
    assert posed.parametric is not None
    poles = np.array([pole for pole, _ in pairs_of(posed.parametric).values()])
    s = posed.plane.exponents(poles)
    size = np.abs(s)[:, None]
    return size * [1 - width, 1 + width], (-s.real / np.abs(s))[:, None] * [1 - 50 * width, 1 + 50 * width]


def boxed(seed: int, lines: int = 12, *, off: float = 0.0) -> tuple[rid.MixedProblem, Box]:
    """A problem with a mode, and a box around its poles."""
    posed = problem(2 * seed + 1, lines, off=off)
    return posed, box_of(posed)


@functools.cache
def band_over_box(seed: int, lines: int = 12, model: control.StateSpace | None = None) -> Band:
    """A band over a box, at two frequencies between the lines."""
    posed, box = boxed(seed, lines)
    omega = posed.frequency[0].omega
    return rid.band(posed, box=box, model=model, omega=np.linspace(omega[0], omega[-1], 4)[1:-1])


@functools.cache
def with_model_over_box(seed: int) -> Band:
    """The same around a small model, for arcs."""
    small = rid.balanced_truncation(rid.identify(boxed(seed)[0]).model, order=4).model
    return band_over_box(seed, model=small)


def continuous(seed: int, lines: int = 9, *, off: float = 0.0) -> rid.MixedProblem:
    """A random plant of continuous time: of the class, and every other time with a mode."""
    rng = np.random.default_rng(seed)
    scale, gain = float(10 ** rng.uniform(-1, 3)), float(10 ** rng.uniform(-3, 3))
    omega, decay = np.sort(rng.uniform(0.1, 9.0, lines)) * scale, float(rng.uniform(0.4, 0.9)) * scale
    s = 1j * omega
    values, basis = 0.8 * gain * (scale - decay) / (s + scale), None
    if seed % 2:
        natural, damping = float(rng.uniform(1.0, 8.0)) * scale, float(rng.uniform(0.01, 0.05))
        basis = rid.kautz([natural], [damping], dt=0)
        pole = natural * (-damping + 1j * np.sqrt(1 - damping**2))
        values = values + gain * natural * (0.02 / (s - pole) + 0.02 / (s - np.conj(pole)))
    bound = 0.05 * gain
    values = values + bound * rng.uniform(0, 1, lines) * np.exp(2j * np.pi * rng.uniform(0, 1, lines))
    values[lines // 2] += off * gain
    frf = rid.FrequencyResponse(omega, values, bound=bound)
    return rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=gain, decay=decay), parametric=basis)


def first_of(text: str) -> str:
    """The file of the first statement alone."""
    question, evidence = (json.loads(text)[name] for name in ("question", "evidence"))
    for one in (question, evidence):
        one["statements"] = one["statements"][:1]
    return sealed(question, evidence)


@functools.cache
def proofs_over_boxes(seed: int) -> tuple[str, ...]:
    """A band, arcs and a contradiction over boxes of poles."""
    found = contradiction(boxed(seed, off=3.0)[0], box=boxed(seed)[1])  # None of 1 in 116
    arcs = proof_text(with_model_over_box(seed))
    middle = len(json.loads(arcs)["question"]["statements"][-1]["bounds"]) // 2
    refuted = [] if found is None else [proof_text(found)]
    return proof_text(band_over_box(seed)), *refuted, shortened(arcs, middle, 2)


@functools.cache
def proofs_in_continuous_time(seed: int) -> tuple[str, ...]:
    """A band, a system, a contradiction, a support, and a band over a box where there is a mode."""
    posed = continuous(seed)
    omega = posed.frequency[0].omega
    found = rid.identify(posed)
    bounds = rid.worst_case_error(found, omega=1.01 * omega[1:2], directions=3)
    texts = [proof_text(rid.band(posed, omega=[0.0, 1.1 * omega[-1]])), proof_text(found), first_of(proof_text(bounds))]
    if seed % 2:
        texts.append(proof_text(rid.band(posed, box=box_of(posed), omega=1.01 * omega[:1])))
    return *texts, proof_text(rid.identify(continuous(seed, off=3.0)))


def passive(seed: int, kind: str = "positive", *, shifted: float = 0.0) -> rid.MixedProblem:
    """A passive problem of one port; `shifted` moves all its samples into the half-plane that the class forbids."""
    problem_ = passive_edge(seed, kind, 1)[1]
    if not shifted:
        return problem_
    (frf,) = problem_.frequency
    values, s = frf.values[:, 0, 0], 1j * frf.omega
    scale = s if kind == "negative" else np.ones(s.size)
    values = values - shifted * np.median(np.abs(scale * values)) / scale
    moved = rid.FrequencyResponse(frf.omega, values, bound=frf.bound.outer_radius[:, 0, 0])
    return rid.MixedProblem(frequency=moved, prior=problem_.prior)
