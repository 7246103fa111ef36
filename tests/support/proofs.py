"""Random problems with proofs, the checker in C, and files that are almost proofs."""

import atexit
import functools
import hashlib
import json
import random
import re
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import robustid as rid
from robustid.guarantees import Band, proof_text
from support.proof_judge import judged

SOURCE = Path(__file__).parents[2] / "proof" / "robustid_proof.c"
SANITIZED = ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")


@functools.cache
def built(*flags: str) -> Path:
    """The checker, compiled once a process; skips where there is no C compiler or no GMP."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler")
    # One header less would be another failure than a source that does not compile.
    here = subprocess.run([compiler, "-E", "-x", "c", "-"], input="#include <gmp.h>", capture_output=True, text=True)
    if here.returncode:
        pytest.skip("no GMP (libgmp-dev)")
    folder = tempfile.mkdtemp()
    atexit.register(shutil.rmtree, folder)
    program = Path(folder, "robustid-proof")
    warned = ("-std=c11", "-Wall", "-Wextra", "-Werror", *(flags or ("-O2",)))
    subprocess.run([compiler, *warned, "-o", str(program), str(SOURCE), "-lgmp"], check=True)
    return program


def asked(program: Path, text: str | bytes, folder: Path, seconds: float = 60) -> tuple[int, str]:
    """Exit status and lines of the checker."""
    path = folder / "proof.json"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    done = subprocess.run(
        [str(program), str(path)],
        capture_output=True,
        text=True,
        env={"ASAN_OPTIONS": "detect_leaks=0"},
        timeout=seconds,
    )
    return done.returncode, done.stdout + done.stderr


def problem(seed: int, lines: int = 8, *, off: float = 0.0, samples: int = 0) -> rid.MixedProblem:
    """A random plant of a class, with a mode or without, and a record of `samples`; `off` moves one line by so many gains."""
    rng = np.random.default_rng(seed)
    dt, rho, gain = float(rng.choice([1e-3, 0.1, 2.0])), float(rng.uniform(1.05, 1.4)), float(10 ** rng.uniform(-3, 3))
    omega = np.sort(rng.uniform(0.02, 3.0, lines)) / dt
    first = 0.9 * gain * rng.uniform(-1, 1) / rho
    values, pulses = first * np.exp(-1j * omega * dt), first * np.eye(1, max(samples, 2), 1)[0]
    basis = None
    if seed % 2:
        damping, natural = float(rng.uniform(0.005, 0.05)), float(rng.uniform(0.3, 2.5)) / dt
        basis = rid.kautz([natural], [damping], dt=dt)
        parameters = rng.normal(size=2) * gain
        values = values + basis.response(omega * dt) @ parameters
        pulses = pulses + basis.impulse(pulses.size) @ parameters
    bound = 0.05 * gain
    values = values + bound * rng.uniform(0, 1, lines) * np.exp(2j * np.pi * rng.uniform(0, 1, lines))
    values[lines // 2] += off * gain
    frf = rid.FrequencyResponse(omega, values, bound=bound, dt=dt)
    record = None
    if samples:
        u = rng.choice([-1.0, 1.0], samples)
        y = np.convolve(u, pulses)[:samples] + bound * rng.uniform(-1, 1, samples)
        record = rid.TimeRecord(u, y, bound=bound, dt=dt)
    prior = rid.Prior(gain_bound=gain, decay_rate=rho)
    return rid.MixedProblem(frequency=frf, time=record, prior=prior, parametric=basis)


def close_lines(high: bool) -> rid.MixedProblem:
    """Lines so close, at low or `high` frequencies, that coefficients along their kernels are huge; a mode and a record."""
    rng, dt, bound, p, samples = np.random.default_rng(1), 1e-3, 0.02, np.array([0.3, -0.2]), 12
    angles = np.concatenate([[0.0], np.linspace(0.1, 0.4, 12), [np.pi]])
    omega = (np.pi - angles[::-1] if high else angles) / dt
    basis = rid.kautz([0.6 / dt], [0.01], dt=dt)
    values = 0.14 * np.exp(-1j * omega * dt) + basis.response(omega * dt) @ p
    values = values + bound * rng.uniform(-1, 1, omega.size)
    values[[0, -1]] = values[[0, -1]].real
    u = rng.choice([-1.0, 1.0], samples)
    y = np.convolve(u, 0.14 * np.eye(1, samples, 1)[0] + basis.impulse(samples) @ p)[:samples]
    record = rid.TimeRecord(u, y + bound * rng.uniform(-1, 1, samples), bound=bound, dt=dt)
    frf = rid.FrequencyResponse(omega, values, bound=bound, dt=dt)
    return rid.MixedProblem(
        frequency=frf, time=record, prior=rid.Prior(gain_bound=0.2, decay_rate=1.3), parametric=basis
    )


@functools.cache
def band_of(seed: int, lines: int = 8, frequencies: int = 2) -> tuple[Band, str]:
    """A band, and its proof."""
    posed = problem(seed, lines)
    omega = posed.frequency[0].omega
    found = rid.band(posed, omega=np.linspace(omega[0], omega[-1], frequencies + 2)[1:-1])
    return found, proof_text(found)


def sealed(question: dict[str, Any] | str, evidence: Any) -> str:
    """The file of a question and evidence, with its digest."""
    text = question if isinstance(question, str) else json.dumps(question)
    digest = hashlib.sha256(text.encode()).hexdigest()
    head = f'"format": "robustid-proof", "version": 1, "digest": "{digest}"'
    return f'{{{head},\n"question": {text},\n"evidence": {json.dumps(evidence)}}}\n'


def resealed(text: str) -> str:
    """The file with the digest of the question that now stands in it, where one can be found."""
    start = re.search(r'"question"\s*:\s*', text)
    if start is None:
        return text
    try:
        end = json.JSONDecoder().raw_decode(text, start.end())[1]
    except ValueError:
        return text
    digest = hashlib.sha256(text[start.end() : end].encode()).hexdigest()
    return re.sub(r'"digest": "[^"]*"', f'"digest": "{digest}"', text)


def parts(text: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Question and evidence of a file."""
    whole = json.loads(text)
    return whole["question"], whole["evidence"]


_NUMBERS = re.compile(r'"(-?\d[^"]*)"')
_STRANGE = ("NaN", "Infinity", "1e400", "1e999", "9p9999", "1p-4000", "", "-", "0x10", "1e-400", "0", "-0", "1p+4000")


def mutated(text: str, rng: random.Random) -> str:
    """A file that differs from a proof in one place, or is broken; its digest is that of the new question more often than not."""
    kind = rng.randrange(9)
    found = list(_NUMBERS.finditer(text))
    if not found:
        return text[: len(text) // 2]
    one = rng.choice(found)

    def put(new: str) -> str:
        return text[: one.start(1)] + new + text[one.end(1) :]

    old = one.group(1)
    if kind == 0:
        text = put(old[1:] if old.startswith("-") else "-" + old)
    elif kind == 1:
        at = rng.choice([k for k, c in enumerate(old) if c.isdigit()])
        text = put(old[:at] + str(rng.randrange(10)) + old[at + 1 :])
    elif kind == 2:
        text = put(rng.choice(_STRANGE))
    elif kind == 3:
        text = put(rng.choice(found).group(1))
    elif kind == 4:  # claims larger, or smaller, by a millionth
        claims = list(re.finditer(r'"(?:radius|value|bounds)": (?:\["|")([^"]*)"', text)) or found
        one = rng.choice(claims)
        value = one.group(1)
        if re.fullmatch(r"[-+.e\d]*\d", value):
            text = put(repr(float(value) * rng.choice([1 - 1e-6, 1 + 1e-6, 1 - 1e-7])))
    elif kind == 5:  # indices
        indices = list(re.finditer(r"\[(\d+), ?\"", text))
        if indices:
            one = rng.choice(indices)
            text = put(str(rng.randrange(40)))
    elif kind == 6:  # two samples exchanged
        rows = list(re.finditer(r'\["[^\[\]]*"\]', text))
        a, b = sorted(rng.choices(rows, k=2) if rows else [one, one], key=lambda row: row.start())
        text = (
            text if a == b else text[: a.start()] + b.group() + text[a.end() : b.start()] + a.group() + text[b.end() :]
        )
    elif kind == 7:
        at = rng.randrange(len(text))
        text = rng.choice(
            [text[:at], text[:at] + chr(rng.randrange(1, 127)) + text[at + 1 :], text[:at] + text[at + 1 :]]
        )
    else:
        units = {"rad/s": "Hz", '"s"': '"ms"', '"version": 1': '"version": 2', '"level": "1"': '"level": "0.999999"'}
        old, new = rng.choice(list(units.items()))
        text = text.replace(old, new)
    return resealed(text) if rng.random() < 0.8 else text


def survive(program: Path, folder: Path, texts: Sequence[str], seed: int, count: int) -> None:
    """Of so many mutants of proofs the checker accepts some, and only such as are true by the judge; it ends with a status."""
    rng, accepted = random.Random(seed), 0
    for text in texts:
        assert asked(program, text, folder)[0] == 0
    for _ in range(count):
        text = mutated(rng.choice(texts), rng)
        status, said = asked(program, text, folder)
        assert status in (0, 1, 2), (said, text)
        accepted += status == 0
        assert status or judged(text), text
    assert 0 < accepted < count / 2
