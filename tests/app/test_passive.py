"""Passive classes from the command line and from run files."""

import numpy as np
import pytest

import robustid as rid
from robustid.app.run.class_settings import PriorChoice, prior_keys
from support.cases import slow
from support.networks import battery
from support.posed import proposed
from support.run_files import ask


def ran(folder, frf, at_hz, **prior):
    """A run of a response with the class of positive real functions, twice: of the effective run file too."""
    rid.save(folder / "frf.csv", frf)
    worst_case = {"at_hz": [at_hz], "directions": 3}
    prior = {"passive": "positive real"} | prior
    path = ask(folder, {"frequency": [{"file": "frf.csv"}], "prior": prior, "worst_case": worst_case})
    found = rid.run(path, folder / "out")
    return found, rid.run(folder / "out" / "run.toml", folder / "again")


def test_keys_of_a_passive_class_are_those_that_state_it():
    for prior in (rid.PositiveReal(decay=3.0, slack=0.1), rid.BoundedReal(decay_rate=1.1)):
        keys = prior_keys(prior)
        assert "gain_bound" not in keys
        assert PriorChoice(**keys).stated(None) == prior


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"passive": "positive real", "decay": 1.0, "gain_bound": 2.0}, "gain_bound has no meaning with passive"),
        ({"passive": "bounded real", "decay": 1.0, "roll_off": 2, "corner_hz": 1.0}, "roll_off has no meaning"),
        ({"gain_bound": 1.0, "decay": 1.0, "slack": 0.1}, "slack belongs to passive"),
    ],
)
def test_what_a_passive_class_has_no_use_for_is_refused(given, words):
    names = {"gain_bound": "gain_bound", "passive": "passive"}
    with pytest.raises(rid.InputError, match=words):
        PriorChoice(**given).check(names)


@pytest.mark.usefixtures("unreduced")
def test_a_run_file_with_a_passive_class(tmp_path):
    omega = np.linspace(5, 60, 10)
    s = 1j * omega
    values = 1 / (s + 20) + 0.5 * (s + 5) / ((s + 5) ** 2 + 900)
    found, again = ran(tmp_path, rid.FrequencyResponse(omega, values, bound=1e-3), 4.0, decay=4.0)
    assert found.consistent
    assert found.identification.prior.positive_real
    assert again.identification.margin == found.identification.margin
    assert "passive" in (tmp_path / "out" / "report.html").read_text()


def cell(seed=0, points=66, noise=0.002):
    """A response over six and a half decades with noise in proportion to it, without a bound."""
    omega, rng = 2 * np.pi * np.geomspace(0.003, 10000, points), np.random.default_rng(seed)
    errors = noise * (rng.standard_normal(points) + 1j * rng.standard_normal(points)) / np.sqrt(2)
    return rid.FrequencyResponse(omega, battery(omega) * (1 + errors))


@pytest.mark.parametrize(("seed", "points"), [(0, 28), *(slow(seed, 66) for seed in range(1, 7))])
def test_an_impedance_over_decades_needs_no_more_than_the_data(seed, points):
    frf = rid.estimate_bound(cell(seed, points))
    truth = battery(frf.omega)
    assert np.all(np.abs(frf.values[:, 0, 0] - truth) <= frf.bound.radius[:, 0, 0])
    assert np.median(frf.bound.radius[:, 0, 0] / np.abs(truth)) < 0.03
    other = 2 * np.pi * (np.array([3000.0]) if seed == 0 else np.geomspace(0.005, 5000, 7))
    for passive in ("positive real",) if seed == 0 else (None, "positive real"):
        result = rid.identify(proposed([frf], prior=PriorChoice(passive=passive))[0])
        assert result.consistent, passive
        assert result.problem.prior.passive == (passive or "")
        band = rid.worst_case_error(result, omega=other, directions=4).upper[:, 0, 0]
        errors = np.abs(np.squeeze(result.model(1j * other)) - battery(other))
        # The cell is no sum of poles and of something that decays fast: passivity holds of it, a gain bound from data only about.
        assert np.all(errors <= (1 if passive else 1.5) * band), passive
        assert np.median(band / np.abs(battery(other))) < 0.06, passive


@pytest.mark.slow
@pytest.mark.usefixtures("unreduced")
def test_a_run_chooses_poles_and_decay_of_an_impedance_over_decades(tmp_path):
    found, again = ran(tmp_path, cell(points=28), 1.0)
    assert found.consistent
    assert max(found.run_file.modes.damping) == 1
    assert found.run_file.prior.decay == found.identification.prior.decay
    assert found.worst_case.upper.max() < 0.1 * abs(battery([2 * np.pi])[0])
    assert again.identification.margin == pytest.approx(found.identification.margin, rel=1e-9)
    assert "a sum of passive modes and of F" in (tmp_path / "out" / "report.html").read_text()


@pytest.mark.parametrize("points", [12, slow(150)])
@pytest.mark.parametrize("kind", ["bounded real", "negative imaginary", "positive real"])
def test_a_decay_is_chosen_at_which_the_plant_is_passive(kind, points):
    """A lossy resonance on a line, a displacement per force (with a slack), a velocity per force: passive up to 10, 5 and 10."""

    def plant(s):
        velocity = (s + 10) / ((s + 10) ** 2 + 900)
        if kind == "negative imaginary":
            return 1 / ((s + 10) ** 2 + 900)
        return velocity if kind == "positive real" else 1 - 2 / (1 + velocity + 0.02)

    omega = np.linspace(3, 80, points)
    values = plant(1j * omega)
    frf = rid.FrequencyResponse(omega, values, bound=2e-3 * np.abs(values).max())
    problem = proposed([frf], prior=PriorChoice(passive=kind, slack=0.006 if kind == "negative imaginary" else None))[0]
    assert problem.prior.passive == kind
    assert 0.5 <= problem.prior.decay <= 10
    result = rid.identify(problem)
    assert result.consistent
    between = np.linspace(4, 79, 7)
    band = rid.worst_case_error(result, omega=between, directions=4).upper[:, 0, 0]
    assert np.all(np.abs(np.squeeze(result.model(1j * between)) - plant(1j * between)) <= band)


def test_a_point_at_zero_frequency_is_one_of_those_over_decades():
    frf = cell(points=36)
    static = rid.FrequencyResponse(np.append(0.0, frf.omega), np.append(0.053, frf.values.ravel()), bound="2%")
    found = rid.suggest_kautz(static)
    assert found.damping.max() == 1
    assert "6.5 decades" in found.reason
