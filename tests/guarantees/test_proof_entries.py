"""Matrices in proof files: what the samples of an entry prove is a file of that entry, which both checkers accept."""

import functools

import control
import numpy as np
import pytest

import robustid as rid
from robustid.errors import InputError
from robustid.guarantees import Band, contradiction, proof_text, proof_texts
from support.cases import slow
from support.proof_judge import judged
from support.proofs import parts, survive

pytestmark = pytest.mark.quick
PLACES = ((0, 0), (0, 1), (1, 0), (1, 1))


def matrix(seed: int, *, off: float = 0.0) -> rid.MixedProblem:
    """Two inputs and outputs, a common mode, bounds of every entry; `off` moves one line of the entry of output 2 and input 1."""
    rng = np.random.default_rng([seed, 47])
    dt, gain = float(rng.choice([1e-3, 0.1, 2.0])), float(10 ** rng.uniform(-3, 3))
    omega, natural = np.sort(rng.uniform(0.05, 2.9, 6)) / dt, float(rng.uniform(0.5, 2.5)) / dt
    basis = rid.kautz([natural], [0.02], dt=dt)
    modes = np.einsum("fk,kij->fij", basis.response(omega * dt), gain * rng.normal(size=(2, 2, 2)))
    # Every entry of a matrix of norm 1/2 at most is one of the class, times the delay.
    rest = gain / 4 * rng.uniform(-1, 1, (2, 2)) * np.exp(-1j * omega * dt)[:, None, None]
    values = modes + rest + 0.03 * gain * rng.uniform(0, 1, rest.shape) * np.exp(2j * np.pi * rng.random(rest.shape))
    values[3, 1, 0] += off * gain
    frf = rid.FrequencyResponse(omega, values, bound=np.full(values.shape, 0.03 * gain), dt=dt)
    return rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=gain, decay_rate=1.2), parametric=basis)


@functools.cache
def band_of(seed: int, *, boxed: bool = False) -> Band:
    """With a model of no input, whose error is the plant."""
    posed = matrix(seed)
    natural = abs(np.angle(np.linalg.eigvals(posed.parametric.matrices.A)[0])) / float(posed.dt or 1.0)
    box = (natural * np.array([[0.998, 1.002]]), np.array([[0.019, 0.021]])) if boxed else None
    model = control.ss([], [], [], np.zeros((2, 2)), posed.dt)
    return rid.band(posed, omega=posed.frequency[0].omega[1:3], box=box, model=model)


def check_entries(proved, band: Band) -> None:
    """Discs of every entry, a millionth wider than those of the band at most, and the axis."""
    texts = proof_texts(band)
    assert len(texts) == len(PLACES)
    for (i, j), text in zip(PLACES, texts, strict=True):
        proved(text)
        question = parts(text)[0]
        assert question["units"]["response"] == f"that of the data, of output {i + 1} and input {j + 1}"
        values, own = band.problem.frequency[0].values[:, i, j], band.bands[2 * i + j]
        assert [row[1] for row in question["data"]] == [repr(one) for one in values.real.tolist()]
        claimed = [float(one["radius"]) for one in question["statements"] if one["kind"] == "disc"]
        radius = own.at(band.problem.plane.angles(np.asarray(band.omega)))[1]
        np.testing.assert_allclose(claimed, radius, rtol=1e-6)
        assert question["statements"][-1]["kind"] == "arcs"
        largest = max(map(float, question["statements"][-1]["bounds"]))
        assert largest <= band.circle.entries[:, i, j].max() * (1 + 1e-6)


@pytest.mark.parametrize("boxed", [False, slow(True)])
def test_the_band_of_every_entry_of_a_matrix_is_proved(proved, boxed):
    band = band_of(1, boxed=boxed)
    check_entries(proved, band)
    with pytest.raises(InputError, match="each of its 4 entries"):
        proof_text(band)


def test_an_entry_that_refutes_a_matrix_is_proved_in_fractions_too(proved):
    bad = matrix(2, off=8.0)
    for found in (contradiction(bad), rid.identify(bad)):
        text = proof_text(found)
        assert "output 2 and input 1" in text
        proved(text)
        assert judged(text)


def test_entries_that_are_tied_together_are_refused():
    posed, dt = matrix(1), 0.1
    symmetric = rid.FrequencyResponse(np.array([1.0, 2.0]), np.full((2, 2, 2), 0.5), bound=0.1, dt=dt)
    prior = rid.Prior(gain_bound=2.0, decay_rate=1.2)
    record = rid.TimeRecord(np.eye(4, 2), np.zeros((4, 2)), bound=0.1, dt=dt)
    for reason, one in (
        ("tied together", rid.MixedProblem(frequency=symmetric, prior=prior, symmetric=True)),
        ("tied together", rid.MixedProblem(frequency=symmetric, time=record, prior=prior)),
    ):
        with pytest.raises(InputError, match=reason):
            proof_texts(rid.band(one, omega=[1.5]))
    with pytest.raises(InputError, match="several inputs or outputs"):
        proof_text(rid.identify(posed))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(200))
def test_matrices_of_two_hundred_problems_are_proved(proved, seed):
    check_entries(proved, band_of(seed, boxed=bool(seed % 2)))
    proved(proof_text(rid.identify(matrix(seed, off=8.0))))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_no_mutant_of_entries_is_accepted_that_is_not_true(program, tmp_path, seed):
    survive(program, tmp_path, [proof_text(rid.identify(matrix(seed, off=8.0)))], 300 + seed, 250)
