"""Proofs on arcs of the frequency axis: the checker in C and the judge know the answers that are known by hand, and agree."""

import json
from fractions import Fraction
from pathlib import Path

import control
import numpy as np
import pytest

import robustid as rid
from robustid.core import StateMatrices, response_at
from robustid.errors import InputError
from robustid.guarantees import Band, proof_loop, proof_text
from robustid.guarantees.proof_arcs import Known
from support.proof_judge import judged
from support.proof_loops import (
    Functions,
    band_with_model,
    by_hand,
    constants,
    controller_for,
    loop_of,
    polynomials,
    shortened,
    small_proofs,
    statement_of,
)
from support.proofs import asked, sealed

pytestmark = pytest.mark.quick


def both(program: Path, folder: Path, text: str) -> bool:
    """What checker and judge say, which must be the same."""
    status, said = asked(program, text, folder)
    assert status in (0, 1), said
    assert (status == 0) == judged(text), said
    return status == 0


def test_the_largest_distance_from_a_model_is_that_of_the_class(program, tmp_path):
    # |F - 1/2| is 3/2 at most, and is reached at F = -1; the class bends by 4/9.
    bend = 4 / 9 * (np.pi / 16) ** 2 / 8
    assert both(program, tmp_path, by_hand("arcs", constants(-0.5, 1.0), 1.5 + 1.01 * bend))
    assert not both(program, tmp_path, by_hand("arcs", constants(-0.5, 1.0), 1.5 + 0.9 * bend))
    # 2 F - (z + 1)/z: at z = 1 the distance is 4.
    model = polynomials([-1.0, -1.0], [2.0, 0.0])
    assert both(program, tmp_path, by_hand("arcs", model, 4.04))
    assert not both(program, tmp_path, by_hand("arcs", model, 4.0))


def test_the_worst_sensitivity_of_a_gain_is_that_of_the_small_gain_theorem(program, tmp_path):
    # 1/(1 + g F) is at most 1/(1 - g).
    assert both(program, tmp_path, by_hand("loop", constants(1.0, 0.5, 1.0), 2.01))
    assert not both(program, tmp_path, by_hand("loop", constants(1.0, 0.5, 1.0), 2.0))
    # c = b: the largest input, g/(1 - g).
    assert both(program, tmp_path, by_hand("loop", constants(1.0, 0.5, 0.5), 1.01))
    assert not both(program, tmp_path, by_hand("loop", constants(1.0, 1.001, 0.0), 1e9))


@pytest.mark.parametrize(
    ("kind", "gain", "x", "y", "worst"),
    [
        ("loop", 0.6, 1.0, 0.0, 2.5),
        ("loop", 0.6, -1.0, 1.0, 1.5),
        ("loop", 0.6, 1.0, -0.5, 2.0),
        ("arcs", 0.4, -1.0, 1.0, 2 / 3),
        ("arcs", 0.4, 1.0, -2.0, 9 / 7),
    ],
)
def test_other_peaks_of_a_gain_are_those_of_the_small_gain_theorem(program, tmp_path, kind, gain, x, y, worst):
    # x S + y with S = 1/(1 + g F) between 1/(1 + g) and 1/(1 - g): T = 1 - S is -1.5 or -2/3 at most; S - 1/2 is the disk margin's.
    one, zero = [Fraction(1)], list[Fraction]()
    known = Known([], [], [zero, zero, zero], [one, [Fraction(gain)], one])
    for factor, proved in ((1.01, True), (0.999, False)):
        D = [float(row[0]) for row in known.within(x, y, worst * factor).D]
        assert both(program, tmp_path, by_hand(kind, constants(*D), 1.0, arcs=48)) == proved


def test_beside_a_known_function_an_error_is_proved_where_that_is_not_zero(program, tmp_path):
    # |F/(4 + 1/z)| with |F| <= 1 is 1/3 at most, at z = -1; 1/(1 - 1/z) has no bound at z = 1.
    for bound, proved in ((0.34, True), (0.333, False)):
        text = by_hand("arcs", polynomials([0.0, 0.0], [1.0, 0.0], [4.0, 1.0]), bound, arcs=64)
        assert both(program, tmp_path, text) == proved
    assert not both(program, tmp_path, by_hand("arcs", polynomials([0.0, 0.0], [1e-9, 0.0], [1.0, -1.0]), 1e9))


@pytest.mark.parametrize(("factor", "proved"), [(1.75, True), (1.78, False)])
def test_errors_may_grow_until_a_loop_is_no_longer_stable(program, tmp_path, factor, proved):
    # 1 + (m + k (F - m))/2 with m = .3 and |F| <= 1 is 0 for k = 2.3/1.3 = 1.769.
    one, zero = [Fraction(1)], list[Fraction]()
    known = Known([], [], [zero, zero, zero], [one, [Fraction(0.5)], one])
    model = StateMatrices(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.array([[0.3]]))
    D = [float(row[0]) for row in known.grown(model, factor).D]
    assert both(program, tmp_path, by_hand("loop", constants(*D), 0.0, arcs=48)) == proved


ZEROS: dict[str, tuple[Functions, bool]] = {
    "inside": (polynomials([1.0, -0.5], [0.01, 0.0], [1.0, 0.0]), True),
    "a pair inside": (polynomials([1.0, -0.8, 0.6], [0.01, 0.0, 0.0], [1.0, 0.0, 0.0]), True),
    "outside, real": (polynomials([1.0, -2.0], [0.01, 0.0], [1.0, 0.0]), False),
    "outside, negative": (polynomials([-1.0, -2.0], [0.01, 0.0], [1.0, 0.0]), False),
    "two outside, the same sign at both ends": (polynomials([1.0, 0.0, -4.0], [0.01, 0.0, 0.0], [1.0, 0.0, 0.0]), False),
    "a pair outside": (polynomials([1.0, -1.0, 4.0], [0.01, 0.0, 0.0], [1.0, 0.0, 0.0]), False),
    "a pole outside": (([[2.0]], [1.0], [[0.1], [0.0], [0.0]], [1.0, 0.01, 1.0]), False),
    "a pole inside": (([[0.9]], [1.0], [[0.01], [0.0], [0.0]], [1.0, 0.01, 1.0]), True),
}  # fmt: skip


@pytest.mark.parametrize("name", ZEROS)
def test_zeros_and_poles_outside_of_the_circle_are_found(program, tmp_path, name):
    functions, stable = ZEROS[name]
    assert both(program, tmp_path, by_hand("loop", functions, 1e6, arcs=24)) == stable


@pytest.mark.parametrize(
    "edges",
    [["0", "1", "2", "3"], ["0.1", "1", "2", "half"], ["0", "2.9", "half"], ["half", "2", "1", "0"], ["0", "0.9", "0"]],
)
def test_a_loop_is_proved_on_the_whole_axis_and_on_short_arcs_only(program, tmp_path, edges):
    assert not both(program, tmp_path, by_hand("loop", constants(1.0, 0.01, 1.0), 2.0, edges=edges))
    assert both(
        program, tmp_path, by_hand("loop", constants(1.0, 0.01, 1.0), 2.0, edges=["0", "0.9", "1.8", "2.6", "half"])
    )


def test_bands_around_a_model_are_proved_on_the_whole_axis_and_hardly_wider(proved, program, tmp_path):
    band = band_with_model(1)
    text = proof_text(band)
    said = proved(text)
    assert "from 0 to half the sample rate" in said
    _hardly_wider(band, text)
    middle = len(statement_of(text)["bounds"]) // 2
    assert both(program, tmp_path, shortened(text, middle, 2))


def _hardly_wider(band: Band, text: str) -> None:
    said, dt = statement_of(text), float(band.problem.dt or 1.0)
    edges = np.array([np.pi / dt if one == "half" else float(one) for one in said["edges"]])
    circle, own = band.circle, np.array(list(map(float, said["bounds"])))
    of = np.clip(np.searchsorted(circle.edges, (edges[:-1] + edges[1:]) / 2) - 1, 0, len(circle.bound) - 1)
    assert np.all(own <= circle.entries[of, 0, 0] * (1 + 1e-6))


def test_a_controller_is_proved_for_every_consistent_plant_and_its_peak_is_that_of_the_package(
    proved, program, tmp_path
):
    found = loop_of(5)
    text = proof_text(found)
    proved(text)
    peak = max(map(float, statement_of(text, 0)["bounds"]))
    assert peak <= found.peaks["sensitivity"].value * (1 + 1e-6)
    # The factors are the controller's, exactly where they are compared: at the knots, in double precision.
    said = statement_of(text, 0)["functions"]
    A, B, C, D = (np.vectorize(_float, otypes=[float])(np.array(said[name], object)) for name in "ABCD")
    for z in np.exp(1j * np.linspace(0.1, 3, 7)):
        a, b, c = C @ np.linalg.solve(z * np.eye(len(A)) - A, B) + D
        assert abs(b / a - found.controller(z)) < 1e-12 * abs(b / a)
        assert a == c
    # Then the control sensitivity, the complementary one, the disk margin, and the factor by which errors may grow.
    further = [max(map(float, statement_of(text, place)["bounds"])) for place in (1, 2, 3, 4)]
    assert further[0] <= found.peaks["control_sensitivity"].value * (1 + 1e-6)
    assert further[1:] == [1, 1, 0]
    states = np.array(statement_of(text, 4)["functions"]["A"]).shape[0]
    assert found.stability is not None
    assert found.band.model is not None
    assert states == len(A) + found.band.model.nstates
    # A bound below the worst one at an edge is no longer proved.
    whole = json.loads(text)
    bounds = whole["question"]["statements"][0]["bounds"]
    bounds[:] = [repr(float(one) * (1 - 1e-3)) for one in bounds]
    assert asked(program, sealed(whole["question"], whole["evidence"]), tmp_path)[0] == 1


def test_a_controller_with_zeros_at_half_the_sample_rate_is_proved_with_all_its_peaks(proved):
    # Beside its zeros doubles know b to few digits.
    band = band_with_model(1)
    one, dt = band.bands[0], float(band.problem.dt or 1.0)
    gain = 0.3 / np.max(np.abs(one.centre) + one.radius) * 0.1**2 / 2.0**2
    controller = control.ss(control.tf(gain * np.poly([-1.0] * 2), np.poly([0.9] * 2), dt))
    proved(proof_text(rid.loop_bounds(band, controller=controller)))


def _float(text: str) -> float:
    above, _, power = text.partition("p")
    return int(above) * 2.0 ** int(power)


def test_an_integrator_is_proved_where_the_centre_of_a_disc_at_zero_is_not_real(proved):
    omega = np.linspace(0.5, 31.0, 30)
    frf = rid.FrequencyResponse(omega, 0.1 / (np.exp(0.1j * omega) - 0.9), bound=0.01, dt=0.1)
    posed = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=4.0, decay_rate=1.08))
    band = rid.band(posed, model=control.ss(0.9, 1.0, 0.1, 0.0, 0.1), omega=[1.0], knots=200)
    bounds = rid.loop_bounds(band, controller=control.ss([[1.0]], [[1.0]], [[0.186]], [[3.312]], 0.1))
    proved(proof_text(bounds), seconds=120)


def test_what_one_statement_could_not_compute_is_no_number_for_the_next_one(program, tmp_path):
    # So near to 1 that no kernel has a bound: a sample of 1 is in the class, whose gain bound is 1.
    question, _ = (json.loads(small_proofs()[1])[name] for name in ("question", "evidence"))
    question["class"]["decay_rate"] = "1." + "0" * 95 + "1"
    question["data"], question["statements"] = [["1", "1", "0", "0.1"]], [{"kind": "inconsistent"}] * 2
    sums = {"base": ["0", "0"], "factors": [], "multipliers": [[0, "1", "0"]]}
    none = {"centre": [], "radius": [], "combinations": []}
    evidence = {"powers": 0, "parameters": none, "statements": [sums, sums]}
    status, said = asked(program, sealed(question, evidence), tmp_path)
    assert status == 1
    assert not [line for line in said.splitlines() if line.startswith("proved")]


def test_loops_that_are_not_expressed_are_refused_with_their_reason():
    band = band_with_model(2)
    unstable = rid.loop_bounds(band, controller=-1e6 * controller_for(band))
    with pytest.raises(InputError, match="not proved to stabilise"):
        proof_text(unstable)


def test_maps_of_a_loop_that_ran_are_those_of_its_plant():
    # P = 1/(z - 1.1) and C = 1/2: S = (z - 1.1)/(z - .6), T = .5/(z - .6).
    gain, plant, about = (control.ss(*one, 0.01) for one in (([], [], [], 0.5), (1.1, 1, 1, 0), (1.2, 1, 0.9, 0)))
    loop = rid.Loop(gain, about)
    z = np.exp(1j * np.linspace(0, np.pi, 9))
    R, S, T = loop.residual_of(plant)(z), (z - 1.1) / (z - 0.6), 0.5 / (z - 0.6)
    wanted = {
        "sensitivity": S,
        "complementary_sensitivity": T,
        "process_sensitivity": 2 * T,
        "control_sensitivity": S / 2,
    }
    found = Known.maps_of(loop.factors, loop.back)
    assert found.keys() == wanted.keys()
    for name, known in found.items():
        a, b = response_at(known.matrices, z)[:, :, 0].T
        np.testing.assert_allclose(a + b * R, wanted[name], atol=1e-12)
    # With another controller b/a: a u + b y of the plant, y = P u and u = (D - N_c R) x.
    other = Known.loop_of(StateMatrices.of(control.ss(0.5, 1, 0.2, 0.1, 0.01)), 1.0, 0.01)
    (a, b), (x, r) = (response_at(one.matrices, z)[:, :2, 0].T for one in (other, other.behind(loop.factors)))
    u = response_at(loop.factors, z)[:, 0] @ [1, 0] + response_at(loop.factors, z)[:, 0] @ [0, 1] * R
    np.testing.assert_allclose(x + r * R, (a + b / (z - 1.1)) * u, atol=1e-12)


def test_balanced_states_leave_a_function_as_it_is_and_make_its_matrices_small():
    # (0.05/(z - 0.95))^8, a chain whose resolvent at z = 1 has the norm of 20^8 times its couplings.
    A, B, C = 0.95 * np.eye(8) + np.eye(8, k=-1), 0.05**8 * np.eye(8, 1), np.eye(1, 8, 7)
    exact = [[[Fraction(v) for v in row] for row in part.tolist()] for part in (A, B, C, np.zeros((1, 1)))]
    chain = Known(*exact)
    found = chain.balanced.matrices
    z = np.exp(1j * np.linspace(0, np.pi, 9))
    np.testing.assert_allclose(response_at(found, z)[:, 0, 0], (0.05 / (z - 0.95)) ** 8, atol=1e-11)
    before, after = (np.linalg.norm(np.linalg.inv(np.eye(8) - one)) for one in (A, found.A))
    assert before > 20**8 / 2
    assert after < 20**3


def test_of_a_plant_that_was_measured_in_a_loop_peaks_and_another_controller_are_proved(proved):
    band = band_with_model(2)
    size = float(np.max(np.abs(band.bands[0].centre) + band.bands[0].radius))
    small, gain = (control.ss([], [], [], k / size, band.problem.dt) for k in (0.1, 0.5))
    loop = rid.Loop(small)
    ran, other = rid.loop_bounds(band, loop), rid.loop_bounds(band, loop, controller=gain)
    text = proof_text(ran)
    proved(text)
    peaks = [max(map(float, statement_of(text, k)["bounds"])) for k in range(4)]
    names = ("sensitivity", "complementary_sensitivity", "process_sensitivity", "control_sensitivity")
    np.testing.assert_array_less(peaks, [ran.peaks[name].value * (1 + 1e-6) for name in names])
    text = proof_text(other)
    assert statement_of(text)["kind"] == "loop"
    proved(text)


def test_a_controller_with_an_integrator_is_written_for_a_plant_that_has_one_too(monkeypatch):
    # At z = 1 the plant has no bound and the response of the controller is not a number: both meet elsewhere.
    band = band_with_model(2)
    dt, unit = band.problem.dt, 1e6 * float(np.max(np.abs(band.bands[0].centre) + band.bands[0].radius))
    loop = rid.Loop(control.ss([], [], [], 0.5 / unit, dt), control.ss(1, 1, unit, 0, dt))
    other = control.ss([[1, 0], [0.5, 0.5]], [[0.02], [0.15]], [[0, 1 / unit]], 0, dt)
    assert np.isnan(response_at(StateMatrices.of(other), np.ones(1)).item())
    found = rid.loop_bounds(band, loop, controller=other)
    written: list[Known] = []
    monkeypatch.setattr(proof_loop, "arcs_of", lambda band, known, *rest, **named: written.append(known))
    with pytest.raises(InputError, match="on every arc"):  # that there are none here
        proof_text(found)
    assert np.abs(np.linalg.eigvals(written[0].matrices.A)).max() < 1


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(200))
def test_bands_and_controllers_of_two_hundred_problems_are_proved(proved, seed):
    band = band_with_model(seed)
    text = proof_text(band)
    proved(text)
    _hardly_wider(band, text)
    found = rid.loop_bounds(band, controller=controller_for(band))
    if found.guaranteed:
        text = proof_text(found)
        proved(text)
        assert max(map(float, statement_of(text, 0)["bounds"])) <= found.peaks["sensitivity"].value * (1 + 1e-6)
