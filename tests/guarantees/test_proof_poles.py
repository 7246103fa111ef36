"""Proofs over boxes of poles and in continuous time: by the checker in C, the judge in fractions, and plants of the box."""

import re
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

import robustid as rid
from robustid.core import Complex
from robustid.errors import InputError
from robustid.guarantees import proof_text
from support.cases import slow
from support.proof_judge import judged
from support.proof_kinds import (
    band_over_box,
    boxed,
    continuous,
    passive,
    proofs_in_continuous_time,
    with_model_over_box,
)
from support.proof_loops import controller_for, statement_of
from support.proof_modes import Mode
from support.proof_numbers import Disc, number
from support.proofs import asked, parts, sealed

pytestmark = pytest.mark.quick


def poles_in(box: tuple[Any, Any], dt: float, rng: np.random.Generator, count: int) -> Complex:
    """Poles in z anywhere in a box of one mode, its corners among them."""
    (low, high), (light, heavy) = (ends[0].tolist() for ends in box)
    omega = np.append(rng.uniform(low, high, count), [low, low, high, high])
    damping = np.append(rng.uniform(light, heavy, count), [light, heavy, light, heavy])
    found: Complex = np.exp(dt * omega * (-damping + 1j * np.sqrt(1 - damping**2)))
    return found


@pytest.mark.parametrize("seed", [0, 1, slow(2), slow(3)])
def test_the_region_of_a_file_holds_the_box_and_its_series_all_modes_of_the_region(seed):
    (posed, box), rng = boxed(seed), np.random.default_rng(seed)
    (said,) = parts(proof_text(band_over_box(seed)))[0]["class"]["modes"]
    mode, dt = Mode(said), float(posed.dt)
    middle = np.array([complex(float(one.re), float(one.im)) for one in mode.poles])
    reach = np.array([float(number(one)) for one in said["reach"]])
    x = np.exp(-1j * rng.uniform(0, np.pi, 30))
    functions = np.array([[complex(float(v.re), float(v.im)) for v in mode.values(_disc(one))[::2]] for one in x])
    for a in poles_in(box, dt, rng, 200).tolist():
        t = (a - middle) / (1 - middle.conj() * a)
        assert np.all(np.abs(np.cumprod(t)) <= reach)
        # C_j of c n/(1 - a x), for an amplitude c C_1 of 1.
        C = (1 - np.abs(middle) ** 2) / (1 - middle.conj() * a) * np.append(1, np.cumprod(t)[:-1])
        assert np.all(np.abs(C[1:] / C[0]) <= np.array(mode.sizes, float) * (1 + 1e-12))
        n = x ** (len(said["numerator"]) - 1)
        left = n / (1 - a * x) / C[0] - functions @ (C / C[0])
        assert np.all(np.abs(left) <= float(mode.rest) * np.abs(functions[:, 0]) + 1e-13 * np.abs(functions[:, 0]))


def _disc(value: complex) -> Disc:
    return Disc(Fraction(value.real), Fraction(value.imag))


@pytest.mark.parametrize("seed", [0, slow(1), slow(2)])
def test_bands_over_a_box_are_proved_as_the_package_claims_them_and_not_smaller(proved, program, tmp_path, seed):
    band = band_over_box(seed)
    text = proof_text(band)
    proved(text)
    assert judged(text)
    question, evidence = parts(text)
    stated = np.array([float(one["radius"]) for one in question["statements"]])
    assert np.all((band.radius.ravel() <= stated) & (stated <= band.radius.ravel() * (1 + 1e-7)))
    for one in question["statements"]:
        one["radius"] = repr(float(one["radius"]) * (1 - 1e-6))
    assert asked(program, sealed(question, evidence), tmp_path)[0] == 1


def test_a_larger_region_or_less_said_of_the_amplitudes_is_not_proved(proved, program, tmp_path):
    text = proof_text(band_over_box(1))
    for place in range(len(parts(text)[0]["class"]["modes"][0]["reach"])):
        question, evidence = parts(text)
        reach = question["class"]["modes"][0]["reach"]
        reach[place] = repr(1.2 * float(number(reach[place])))
        wider = sealed(question, evidence)
        assert asked(program, wider, tmp_path)[0] == 1
        assert not judged(wider)
    question, evidence = parts(text)
    evidence["parameters"] = {"centre": [], "radius": [], "combinations": []}
    assert asked(program, sealed(question, evidence), tmp_path)[0] == 1
    question, evidence = parts(text)
    question["class"]["modes"][0]["reach"][0] = "1"
    assert asked(program, sealed(question, evidence), tmp_path)[0] == 2


def test_plants_with_poles_in_the_box_are_in_the_discs_of_the_file():
    # Plants at the border: a mode of a corner, moved by less than the bounds, beside a function of gain K.
    rng, dt, gain, bound = np.random.default_rng(1), 0.1, 1.0, 0.05
    box = np.array([[11.98, 12.02]]), np.array([[0.018, 0.022]])
    omega = np.linspace(2.0, 28.0, 14)
    for a in poles_in(box, dt, rng, 0).tolist():
        z, wanted = np.exp(1j * omega * dt), np.array([11.9, 12.05, 20.3])

        def plant(z: Complex, a: complex = a) -> Complex:
            c = 0.3 * (1 - abs(a)) * np.exp(0.7j)
            values: Complex = c / (1 - a / z) + np.conj(c) / (1 - np.conj(a) / z) + gain / 1.2 / z
            return values

        y = plant(z) + 0.999 * bound * np.exp(2j * np.pi * rng.uniform(0, 1, omega.size))
        posed = rid.MixedProblem(
            frequency=rid.FrequencyResponse(omega, y, bound=bound, dt=dt),
            prior=rid.Prior(gain_bound=gain, decay_rate=1.2),
            parametric=rid.kautz([12.0], [0.02], dt=dt),
        )
        question, _ = parts(proof_text(rid.band(posed, box=box, omega=wanted)))
        truth = plant(np.exp(1j * wanted * dt))
        for one, value in zip(question["statements"], truth.tolist(), strict=True):
            assert abs(value - complex(*map(float, one["centre"]))) <= float(one["radius"])


def test_a_controller_is_proved_for_all_poles_of_a_box_on_the_whole_axis(proved):
    band = with_model_over_box(1)
    text = proof_text(band)
    proved(text)
    assert max(map(float, statement_of(text)["bounds"])) <= band.circle.bound.max() * (1 + 1e-6)
    found = rid.loop_bounds(band, controller=controller_for(band))
    text = proof_text(found)
    proved(text)
    assert max(map(float, statement_of(text, 0)["bounds"])) <= found.peaks["sensitivity"].value * (1 + 1e-6)
    assert len(parts(text)[0]["class"]["modes"]) == 1


@pytest.mark.parametrize("seed", [1, slow(2)])
def test_continuous_time_is_proved_in_every_kind(proved, program, tmp_path, seed):
    for text in proofs_in_continuous_time(seed):
        proved(text)
        assert judged(text)
    question, evidence = parts(proofs_in_continuous_time(seed)[0])
    question["class"]["decay_rate"][0] = repr(float(question["class"]["decay_rate"][0]) * 0.9)
    assert asked(program, sealed(question, evidence), tmp_path)[0] == 1


def test_in_continuous_time_the_class_says_its_gain_bound_and_nothing_less(program, tmp_path):
    # Seen from its own zeta the value is a mean: K at every frequency, whatever the decay rate.
    for radius, proved in (("3.0000001", True), ("2.9999999", False)):
        text = _bare(radius)
        assert (asked(program, text, tmp_path)[0] == 0) == proved == judged(text)


def _bare(radius: str, kind: str = "disc") -> str:
    s, alpha, corner = 2j, 0.4, 5.0
    base = (corner - s) / (corner + 2 * alpha + s)
    said: dict[str, Any] = {"kind": "disc", "omega": "2", "centre": ["0", "0"], "radius": radius}
    sums: dict[str, Any] = {"base": [repr(base.real), repr(base.imag)], "factors": [], "multipliers": []}
    if kind == "arcs":
        functions = {"A": [], "B": [], "C": [[], []], "D": ["0", "1"]}
        said = {"kind": "arcs", "functions": functions, "edges": ["2", "2.1"], "bounds": [radius]}
        sums = {"knots": [sums, sums]}
    question = {
        "class": {
            "gain_bound": "3",
            "decay_rate": [repr(alpha), repr(corner)],
            "functions": {"A": [], "B": [], "C": [], "D": []},
        },
        "sample_time": "continuous",
        "units": {"frequency": "rad/s", "time": "s", "response": "m/N"},
        "level": "1",
        "data": [["1", "0", "0", "1"]],
        "records": [],
        "statements": [said],
    }
    none = {"centre": [], "radius": [], "combinations": []}
    return sealed(question, {"powers": 0, "parameters": none, "statements": [sums]})


def test_arcs_in_continuous_time_are_not_readable(program, tmp_path):
    text = _bare("100", "arcs")
    assert asked(program, text, tmp_path)[0] == 2
    assert not judged(text)


@pytest.mark.parametrize("kind", [slow("positive"), "negative"])
def test_a_passive_class_is_one_of_scattering_parameters(proved, kind):
    for shifted, status in ((0.0, "CONSISTENT"), (1.5, "INCONSISTENT")):
        posed = passive(0, kind, shifted=shifted)
        found = rid.identify(posed)
        assert found.status.name == status
        text = proof_text(found)
        proved(text)
        assert judged(text)
        # Every disc of S holds, or is held by, the image of the disc of F that it stands for.
        said, (frf,) = parts(text)[0], posed.frequency
        assert said["class"]["gain_bound"] == "1.0"
        slack, r = map(float, re.findall(r"(?:F \+|r =) ([^,]*),", said["units"]["response"]))
        for (_, *numbers), w, y, e in zip(
            said["data"], frf.omega, frf.values[:, 0, 0], frf.bound.outer_radius[:, 0, 0], strict=True
        ):
            a, b, bound = map(float, numbers)
            G = (y + e * np.exp(1j * np.linspace(0, 2 * np.pi, 100))) * (1j * w if kind == "negative" else 1) + slack
            away = np.abs((G - r) / (G + r) - complex(a, b))
            assert np.all(away <= bound * (1 + 1e-9)) if shifted else np.all(away >= bound * (1 - 1e-9))


def test_bounds_of_passive_classes_are_those_of_bounded_real_ones_only(proved):
    found = rid.identify(passive(0, "bounded"))
    text = proof_text(rid.worst_case_error(found, omega=[0.7], directions=4))
    proved(text)
    found = rid.identify(passive(0))
    with pytest.raises(InputError, match="passive class without a gain bound"):
        proof_text(rid.worst_case_error(found, omega=[0.7], directions=4))


def test_boxes_that_are_not_expressed_are_refused_with_their_reason(proved):
    dt, omega = 0.1, np.linspace(6.0, 18.0, 20)
    prior = rid.Prior(gain_bound=1.0, decay_rate=1.2)
    frf = rid.FrequencyResponse(omega, 0.5 * np.exp(-1j * omega * dt), bound=0.05, dt=dt)

    def over(natural: list[float], box: Any) -> str:
        pairs = rid.kautz(natural, [0.02] * len(natural), dt=dt)
        return proof_text(
            rid.band(rid.MixedProblem(frequency=frf, prior=prior, parametric=pairs), box=box, omega=[10.0])
        )

    def refusal(natural: list[float], box: Any) -> str:
        with pytest.raises(InputError) as found:
            over(natural, box)
        return str(found.value)

    damping = np.array([[0.015, 0.025]] * 2)
    two = over([12.0, 12.4], (np.array([[11.9, 12.1], [12.3, 12.5]]), damping))
    proved(two)
    assert judged(two)
    assert "so close" in refusal([12.0, 12.25], (np.array([[11.9, 12.1], [12.15, 12.35]]), damping))
    assert "border of stability" in refusal([12.0], (np.array([[11.9, 12.1]]), np.array([[1e-5, 0.05]])))
    model = rid.identify(continuous(2)).model
    band = rid.band(continuous(2), model=model, omega=[1.0])
    assert "arcs" not in proof_text(band)
