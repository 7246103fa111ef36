"""Proofs as files: the checker in C accepts those of this package, and nothing that exact fractions do not confirm."""

import time
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

import robustid as rid
from robustid.errors import InputError
from robustid.guarantees import contradiction, proof_text
from support.cases import slow
from support.proof_judge import Judge, judged
from support.proof_kinds import bare, factors_of_values, proofs_of, with_record
from support.proof_numbers import Disc, number, turn
from support.proofs import SANITIZED, SOURCE, asked, band_of, built, close_lines, parts, problem, resealed, sealed

pytestmark = pytest.mark.quick


def support_of(text: str, u: complex) -> str:
    """The proof of Re(u F) at the first disc of a proof, with the same multipliers, half of each for its conjugate."""
    question, evidence = parts(text)
    disc, sums, lines = question["statements"][0], evidence["statements"][0], len(question["data"])
    d = {k: complex(float(number(a)), float(number(b))) for k, a, b in sums["multipliers"]}
    both: dict[int, complex] = {}
    for k, one in d.items():
        for place, part in ((k, u * one / 2), ((k + lines) % (2 * lines), (u * one).conjugate() / 2)):
            both[place] = both.get(place, 0) + part
    rows = [[k, repr(one.real), repr(one.imag)] for k, one in both.items()]
    centre = complex(*map(float, disc["centre"]))
    value = (u * centre).real + abs(u) * float(disc["radius"]) * (1 + 1e-7)
    statement = {
        "kind": "support",
        "omega": disc["omega"],
        "direction": [repr(u.real), repr(u.imag)],
        "value": repr(value),
    }
    question["statements"], evidence["statements"] = [statement], [{**sums, "base": ["0", "0"], "multipliers": rows}]
    return sealed(question, evidence)


@pytest.mark.parametrize("seed", [2, slow(3)])
def test_proofs_of_this_package_are_proved_by_the_checker_and_by_the_judge(proved, seed):
    for text in proofs_of(seed):
        proved(text)
        assert Judge(text).proved()


def test_a_claim_is_hardly_wider_than_that_of_the_band(program, tmp_path):
    found, text = band_of(1)
    stated = np.array([float(one["radius"]) for one in parts(text)[0]["statements"]])
    assert np.all(stated <= found.radius.ravel() * (1 + 1e-7))
    assert np.all(stated >= found.radius.ravel())


@pytest.mark.parametrize("u", [1 + 0j, 0.6 - 0.8j, -2j])
def test_a_support_follows_from_the_sums_of_a_disc_on_both_halves_of_the_circle(proved, program, tmp_path, u):
    # The residual cost is then seen from the centre, which is a wider measure: the value needs the room it takes.
    text = support_of(band_of(3)[1], u)
    assert (asked(program, text, tmp_path)[0] == 0) == judged(text)
    question, evidence = parts(text)
    question["statements"][0]["value"] = repr(float(question["statements"][0]["value"]) + 1e6 * abs(u))
    wide = sealed(question, evidence)
    proved(wide)
    assert judged(wide)


def test_without_samples_the_class_says_its_gain_bound_and_nothing_less(proved, program, tmp_path):
    proved(bare("3.000000000001", factors_of_values()))
    assert asked(program, bare("2.999999999", factors_of_values()), tmp_path)[0] == 1
    # Without factors the norm of H2 takes their place: K/(1 - rho^-2)^(1/2) at most.
    root = 3 / float(np.sqrt(1 - 1.25**-2))
    proved(bare(repr(root), []))
    assert not judged(bare("2.999999999", factors_of_values()))


def test_a_frequency_is_placed_to_more_digits_than_a_double_has():
    # exp(-j): cos 1 and sin 1 to 30 digits.
    e = turn(Fraction(1))
    assert abs(e.re - Fraction("0.540302305868139717400936607443")) < Fraction(1, 10**29)
    assert abs(e.im + Fraction("0.841470984807896506652502321630")) < Fraction(1, 10**29)
    assert (e * e.conj - Disc(1)).most < Fraction(1, 10**100)


def polygons_of(seed: int, lines: int, directions: int) -> str:
    """Supports by multipliers of the matrix inequality, at a line and beside one."""
    found = rid.identify(problem(seed, lines))
    omega = found.problem.frequency[0].omega
    return proof_text(rid.worst_case_error(found, omega=[omega[1], 1.01 * omega[2]], directions=directions))


def test_supports_by_the_matrix_inequality_are_proved_and_hardly_larger(proved, program, tmp_path):
    text = polygons_of(1, 4, 3)
    proved(text)
    assert judged(text)
    question, evidence = parts(text)
    for one in question["statements"]:  # a certificate proves its value, and nothing below
        one["value"] = repr(float(one["value"]) - 1e-5 * float(question["class"]["gain_bound"]))
    assert asked(program, sealed(question, evidence), tmp_path)[0] == 1


def test_supports_of_problems_with_records_and_in_other_forms_are_proved(proved):
    found = rid.identify(with_record(1))
    text = proof_text(rid.worst_case_error(found, omega=1.05 * found.problem.frequency[0].omega[:1], directions=3))
    proved(text)
    assert any(k >= 2 * 4 + 2 for k, *_ in parts(text)[1]["statements"][0]["factors"][0]["f"])


@pytest.mark.parametrize("samples", [0, 10])
def test_supports_that_were_saved_are_proved_in_a_form_that_leaves_something_out(proved, tmp_path, samples):
    # Factors that are saved as their product cost more one by one; and what is left out costs more in H2 than by Cauchy.
    found = rid.identify(problem(5, 4, samples=samples), form="taylor")
    omega = 1.01 * found.problem.frequency[0].omega[1:2]
    rid.worst_case_error(found, omega=omega, directions=3).save(tmp_path / "bounds")
    read = rid.load(tmp_path / "bounds")
    text = proof_text(read)
    proved(text)
    stated = np.array([float(one["value"]) for one in parts(text)[0]["statements"]])
    assert np.all(stated - read.values[0].support <= 1e-6 * np.abs(read.values[0].support))


def test_supports_in_a_form_that_leaves_much_out_are_refused_rather_than_widened():
    found = rid.identify(problem(5, 4), form="sections")
    omega = 1.01 * found.problem.frequency[0].omega[1:2]
    with pytest.raises(InputError, match=r"leaves out functions.*form=\"auto\""):
        proof_text(rid.worst_case_error(found, omega=omega, directions=3))


@pytest.mark.parametrize(("high", "turn"), [(False, 0.133), (True, np.pi)])
def test_supports_between_close_lines_and_at_the_ends_of_the_axis_are_proved(proved, high, turn):
    # The nodes are those of the decimals in the file: of the doubles these functions would be others, by many times their size.
    found = rid.identify(close_lines(high), form="orthonormal")
    text = proof_text(rid.worst_case_error(found, omega=[turn / 1e-3], directions=3))
    proved(text)


def test_what_only_the_matrix_inequality_refutes_is_refuted(proved, program, tmp_path):
    posed = problem(1, off=0.407)
    assert contradiction(posed) is None
    text = proof_text(rid.identify(posed))
    proved(text)
    assert judged(text)
    question, evidence = parts(text)
    evidence["statements"][0]["factors"] = []
    assert asked(program, sealed(question, evidence), tmp_path)[0] == 1


def test_another_question_with_the_old_digest_is_not_proved(proved, program, tmp_path):
    text = band_of(1)[1]
    changed = text.replace('"sample_time": "', '"sample_time": "1', 1)
    assert changed != text
    status, said = asked(program, changed, tmp_path)
    assert status == 1
    assert "digest" in said
    assert asked(program, resealed(changed), tmp_path)[0] in (1, 2)


def test_an_edge_claim_is_refused_as_soon_as_it_is_smaller(program, tmp_path):
    question, evidence = parts(band_of(1)[1])
    for one in question["statements"]:
        one["radius"] = repr(float(one["radius"]) * (1 - 1e-6))
    text = sealed(question, evidence)
    assert asked(program, text, tmp_path)[0] == 1
    assert not judged(text)


HOSTILE: dict[str, Any] = {
    "empty": "",
    "a list": "[]",
    "nested": "[" * 100000,
    "closed": "[" * 15 + "]" * 15,
    "bytes": b"\xff\xfe{}",
    "zero byte": b"{\x00}",
    "a key twice": lambda text: text.replace('"version": 1', '"version": 1, "version": 1'),
    "another key": lambda text: text.replace('"version": 1', '"version": 1, "more": "1"'),
    "a number that is none": lambda text: text.replace('"sample_time": "', '"sample_time": "NaN'),
    "infinity": lambda text: text.replace('"level": "1"', '"level": "Infinity"'),
    "a huge exponent": lambda text: text.replace('"level": "1"', '"level": "1p99999"'),
    "a huge number": lambda text: text.replace('"level": "1"', f'"level": "1{"0" * 500}"'),
    "no string": lambda text: text.replace('"level": "1"', '"level": 1.5'),
    "an escape": lambda text: text.replace('"that of', '"\\u0041'),
    "something after": lambda text: text + "{}",
    "a frequency below 0": lambda text: text.replace('"data": [', '"data": [["-1p-4000", "0", "0", "1"], ', 1),
    "in Hz": lambda text: text.replace("rad/s", "Hz"),
    "a later version": lambda text: text.replace('"version": 1', '"version": 2'),
    "another kind": lambda text: text.replace('"disc"', '"arc"'),
    "an index too large": lambda text: text.replace('"multipliers":[[', '"multipliers":[[9999'),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_are_not_readable(tmp_path, name):
    text = HOSTILE[name]
    text = resealed(str(text(band_of(1)[1]))) if callable(text) else text
    status, said = asked(built(*SANITIZED), text, tmp_path)
    assert status == 2, said
    assert "not readable" in said


def test_coefficients_that_no_sample_sees_cost_no_time(proved):
    question, evidence = parts(proof_text(rid.identify(problem(2, 2))))
    evidence["powers"] = 4096
    evidence["statements"][0]["reflections"] += ["1p-90"] * 3000
    proved(sealed(question, evidence), seconds=10)  # all 4096 took a minute


def test_what_is_not_expressed_is_refused_with_its_reason():
    posed = problem(1)
    assert posed.parametric is not None
    omega = np.linspace(1, 9, 9)
    frf = rid.FrequencyResponse(omega, np.ones((9, 1, 2)), bound=0.1, dt=0.1)
    two = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=2.0, decay_rate=1.5))
    with pytest.raises(InputError, match="several inputs"):
        proof_text(rid.identify(two))
    with pytest.raises(InputError, match="only bands"):
        proof_text(posed)


def test_the_checker_stays_short_and_without_floating_point():
    text = SOURCE.read_text()
    assert len(text.splitlines()) <= 700
    assert not {"double", "float", "mpf_", "math.h", "strtod"} & set(
        text.replace("floating-point", "").replace("(", " ").split()
    )


@pytest.mark.slow
def test_a_band_of_a_hundred_frequencies_takes_seconds(proved):
    text = band_of(1, lines=50, frequencies=100)[1]
    start = time.perf_counter()
    proved(text)
    assert time.perf_counter() - start < 10
