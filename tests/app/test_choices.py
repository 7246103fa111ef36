"""Every choice of a run can be stated, and acts."""

import dataclasses
import tomllib

import control
import numpy as np
import pytest

import robustid as rid
from robustid.app.run import class_choice, modes, sequence
from robustid.app.run.run_file import RunFile
from robustid.app.run.run_folder import Surroundings
from robustid.core import Budget, Source
from robustid.report import verdict
from support.bounds import rebound
from support.matrix_lines import measured
from support.run_files import CLASS, DATA, QUICK, ask

OVERRIDES = {
    "prior and modes": (
        {
            "prior": {"gain_bound": 0.3, "decay_rate": 1.2},
            "modes": {"hz": [9.0, 17.67, 30.0], "damping": [0.1, 0.004, 0.1]},
        },
        lambda r: r.identification.problem.prior.gain_bound == 0.3 and r.identification.problem.parametric.size == 6,
    ),
    "no modes": (
        {"modes": {"hz": [], "damping": []}, "prior": {"gain_bound": 20.0, "decay_rate": 1.02}},
        lambda r: r.identification.problem.parametric is None,
    ),
    "repeat and delay of the pairs": (
        {"modes": CLASS["modes"] | {"repeat": 2, "delay": 2}},
        lambda r: (
            r.identification.problem.parametric.size == 8
            and np.sum(np.abs(r.identification.problem.parametric.poles) < 1e-12) > 0
        ),
    ),
    "every": (
        {"frequency_points": {"every": 2}},
        lambda r: (
            r.identification.problem.frequency[0].omega.size == 4 and "Of 4 frequency points" in " ".join(r.findings)
        ),
    ),
    "near": (
        {"frequency_points": {"every": 20, "near_hz": 0.35}},
        lambda r: r.identification.problem.frequency[0].omega.size == 4,
    ),
    "band and inflate": (
        {"frequency_points": {"band_hz": [5.0, 20.0]}, "identify": {"inflate": 2.0}},
        lambda r: (
            r.identification.problem.frequency[0].freq_hz[0] >= 5
            and np.allclose(r.identification.problem.frequency[0].bound, 2 * rid.load("frf.csv").band(5, 20).bound)
            and np.allclose(r.identification.problem.time[0].bound, 2 * rid.load("step.csv").bound)
            and "times 2" in r.identification.problem.frequency[0].note
            and "2 times" in r.findings[0]
        ),
    ),
    "objective, accuracy and solver": (
        {"identify": {"objective": "margin", "accuracy": 0.5, "solver": "structured"}},
        lambda r: (
            (r.identification.objective, r.identification.accuracy, r.identification.solver)
            == ("margin", 0.5, "structured")
        ),
    ),
    "form": ({"identify": {"form": "taylor"}}, lambda r: not r.identification.formulation.exact),
    "delay": (
        {"delay": {"seconds": 0.01}, "modes": CLASS["modes"] | {"delay": 0}},
        lambda r: r.identification.problem.time[0].u.size == 3 and "0.01 s taken out" in r.choices["delay"].reason,
    ),
}


@pytest.mark.usefixtures("unreduced", "unpaged")
@pytest.mark.parametrize("name", OVERRIDES)
def test_every_choice_can_be_stated(folder, name):
    change, holds = OVERRIDES[name]
    result = rid.run(ask(folder, DATA, CLASS, QUICK, change), "out")
    assert holds(result)
    assert result.worst_case is None  # as QUICK states
    assert result.error is None
    text = (folder / "out" / "run.toml").read_text(encoding="utf-8")
    stated = tomllib.loads(text)
    for section, keys in change.items():
        assert {key: stated[section][key] for key in keys} == keys


def plant_records():
    """Two outputs of one input, three periods of a multisine in steady state, and a noise-floor record."""
    rng = np.random.default_rng(3)
    basis = rid.kautz([40.0], [0.05], dt=0.01, delay=1)
    period = np.concatenate([np.zeros(1), rng.standard_normal(49)])
    period -= period.mean()
    u = np.tile(period, 6)
    clean = basis.response(2 * np.pi * np.arange(26) / 50) @ np.array([1.0, 0.5])
    y = np.tile(np.fft.irfft(np.fft.rfft(period) * clean, 50), 6)
    noise = 0.01 * rng.standard_normal((2, 300, 2))
    signals = np.stack([0.75 * y, 0.25 * y], axis=1)
    names = {"inputs": ["force [N]"], "outputs": ["left [m]", "right [m]"]}
    record = rid.TimeRecord(u, signals + noise[0], dt=0.01, initial="periodic", **names)
    return record, rid.TimeRecord(np.zeros(300), 0.1 + noise[1], dt=0.01, **names)


@pytest.mark.usefixtures("unreduced", "unpaged")
def test_records_become_a_response_with_the_bounds_of_the_noise_floor(folder):
    record, rest = plant_records()
    rid.save("record.npz", record)
    rid.save("rest.npz", rest)
    sources = [
        {"file": "record.npz", "combine": {"left": 1.0, "right": 1.0}, "start": 0.5},
        {"file": "rest.npz", "combine": {"left": 1.0, "right": 1.0}, "use": "noise_floor"},
    ]
    path = ask(folder, {"record": sources, "estimate": {"period": 50, "noise_floor_factor": 2.0}}, QUICK,
               {"modes": {"hz": [40 / 2 / np.pi], "damping": [0.05]}, "prior": {"gain_bound": 0.1, "decay_rate": 1.1}})  # fmt: skip
    result = rid.run(path, "out")
    total = [dataclasses.replace(r, y=r.y.sum(axis=1), outputs=["left + right [m]"]) for r in (record, rest)]
    excited = total[0].window(0.5, past="periodic")
    noise = rid.prepare.bounds_from_noise_floor(total[1], factor=2.0)
    expected = noise.bound_response(rid.estimate_frf(excited, period=50), excited, period=50)
    (found,) = result.identification.problem.frequency
    np.testing.assert_allclose(found.values, expected.values, rtol=1e-12)
    np.testing.assert_allclose(found.bound, expected.bound, rtol=1e-12)
    assert found.bound.kind == "noise_floor"
    assert str(found.outputs[0]) == "left + right [m]"
    assert result.consistent
    stated = tomllib.loads((folder / "out" / "run.toml").read_text(encoding="utf-8"))
    assert (stated["estimate"]["method"], stated["record"][0]["past"]) == ("periodic", "periodic")
    assert rid.load("out/response-1.csv").values.shape == expected.values.shape


@pytest.mark.usefixtures("unreduced", "unpaged")
def test_samples_without_bound_take_that_of_the_noise_floor(folder):
    record, rest = plant_records()
    rid.save("record.npz", record.entry(0))
    rid.save("rest.npz", rest.entry(0))
    sources = [{"file": "record.npz", "use": "samples", "stop": 0.2}, {"file": "rest.npz", "use": "noise_floor"}]
    change = {"record": sources, "modes": {"hz": [40 / 2 / np.pi], "damping": [0.05]},
              "prior": {"gain_bound": 0.5, "decay_rate": 1.05}}  # fmt: skip
    with pytest.raises(rid.InputError, match="bound"):  # known past of an unbounded record
        rid.run(ask(folder, change, QUICK), "out")
    sources[0] |= {"past": "unknown"}
    result = rid.run(ask(folder, change, QUICK), "out")
    (time,) = result.identification.problem.time
    noise = rid.prepare.bounds_from_noise_floor(rest.entry(0))
    np.testing.assert_allclose(time.bound, noise.level[0])
    np.testing.assert_allclose(time.y[:, 0], record.y[:20, 0] - noise.mean[0])


@pytest.mark.usefixtures("unreduced", "unpaged")
def test_entries_are_taken_together_or_one_by_one(folder):
    record, _ = plant_records()
    rid.save("record.npz", record)
    data = {"record": [{"file": "record.npz"}], "estimate": {"period": 50}}
    rest = {"modes": {"hz": [40 / 2 / np.pi], "damping": [0.05]}, "prior": {"gain_bound": 0.1, "decay_rate": 1.1}}
    both = rid.run(ask(folder, data, rest, QUICK), "both")
    right = rid.run(ask(folder, data, rest, QUICK, {"entry": ["right", 0]}), "right")
    left = rid.run(ask(folder, data, rest, QUICK, {"entry": [0, "force"]}), "left")
    ratio = np.abs(left.model(1) / right.model(1))
    assert ratio == pytest.approx(3, rel=0.05)
    assert np.abs(both.model(1)).ravel() == pytest.approx(np.abs([left.model(1), right.model(1)]), rel=0.05)


@pytest.mark.usefixtures("unreduced", "unpaged")
def test_a_delay_is_found_taken_out_and_said(folder):
    omega = 2 * np.pi * np.linspace(1, 45, 20)
    z = np.exp(1j * omega * 0.01)
    late, plant = 0.1 / (z - 0.9) / z**3, 0.1 / (z - 0.9)
    rid.save("late.csv", rid.FrequencyResponse(omega, late, bound=0.01, dt=0.01))
    content = {
        "frequency": [{"file": "late.csv"}],
        "delay": {"seconds": "auto"},
        "modes": {"hz": [], "damping": []},
        "prior": {"gain_bound": 3.0, "decay_rate": 1.05},
    }
    result = rid.run(ask(folder, content, QUICK), "out")
    assert result.run_file.delay.seconds == pytest.approx(0.03, abs=1e-6)
    assert "Delay of 0.03 s taken out" in result.choices["delay"].reason
    np.testing.assert_allclose(result.identification.problem.frequency[0].values[:, 0, 0], plant, atol=1e-3)


def test_rigid_body_modes_are_asked_of_the_small_model(folder, monkeypatch):
    asked = []

    def whole(identification, rigid_body, **_):
        asked.append(rigid_body.count)
        return rid.balanced_truncation(identification.model, order=identification.order)

    monkeypatch.setattr(sequence, "reduce_within_bounds", whole)
    result = rid.run(ask(folder, DATA, CLASS, QUICK, {"small_model": {"rigid_body": 1}}), "out")
    assert asked == [1]
    assert result.run_file.small_model.rigid_body == 1


def test_wider_bounds_keep_their_shape_and_what_they_are_about():
    """The size of an error in units of the bound is divided by the factor, whatever the bound is; its probability isn't kept."""
    rng = np.random.default_rng(0)
    _, _, frf = measured()
    error = rng.standard_normal(frf.values.shape) + 1j * rng.standard_normal(frf.values.shape)
    root = rng.standard_normal((frf.omega.size, 4, 4)) + 1j * rng.standard_normal((frf.omega.size, 4, 4))
    run = RunFile().changed("identify", inflate=3.0)
    for data in (
        frf,
        rebound(frf, tilt=np.full(frf.omega.size, 0.3 + 0.1j)),
        frf.with_column_bound(0.1),
        rebound(frf, kind="tolerance", probability=0.95, dof=8.0, excitations=2),
        frf.with_bound(rid.Bound(joint="matrix", ellipsoid=root @ root.conj().swapaxes(1, 2))),
    ):
        wide = class_choice.inflated(data, run)
        assert wide.bound.of_kind == data.bound.of_kind | {"probability": None, "dof": None}
        assert (wide.bound.joint, wide.bound.about) == (data.bound.joint, data.bound.about)
        np.testing.assert_allclose(wide.ratio(error), data.ratio(error) / 3, rtol=1e-9)
        assert "times 3" in wide.note


def test_a_run_with_wider_bounds_says_first_that_they_rest_on_one_excitation(tmp_path):
    """In its findings, in the head of its page, and of what is loaded again."""
    omega = 2 * np.pi * np.linspace(5.0, 40.0, 12)
    bound = rid.Bound(0.1, kind="confidence", probability=0.95, dof=20.0, excitations=1)
    frf = rid.FrequencyResponse(omega, 1 / (np.exp(0.01j * omega) - 0.5), bound=bound, dt=0.01, note=bound.words())
    prior = rid.Prior(gain_bound=5.0, decay_rate=1.5)
    found = rid.identify_reduced(frf, modes=[], prior=prior, inflate=2.0, worst_case=False)
    words = "This is about the mean response for this excitation, and rests on it alone: variation of the plant was not measured"
    assert found.findings[0].startswith(words)
    found.identification.save(tmp_path / "result")
    again = rid.load(tmp_path / "result")
    used = again.problem.frequency[0]
    assert (used.bound.excitations, used.bound.probability) == (1, None)
    assert used.note == f"{bound.words()}; times 2, as stated"
    rid.write_report(again, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert page.index(words) < page.index("times 2, as stated")
    assert again.summary().splitlines()[0].endswith(", for this excitation")
    assert verdict(again).word == "Consistent, for this excitation, but the class says little"
    hard = dataclasses.replace(frf, bound=0.1)
    assert (
        verdict(rid.identify(rid.MixedProblem(frequency=hard, prior=prior))).word
        == "Consistent, but the class says little"
    )


def test_modes_are_those_of_a_fit_its_poles_at_one_integrators():
    s = 1j * np.linspace(3.0, 90.0, 60)
    values = 5 / s**2 + 40 / (s**2 + 2 * 0.02 * 40 * s + 1600)
    frf = rid.FrequencyResponse(s.imag, values, bound=1e-3 * np.abs(values))
    fit = rid.fit_mfd(frf, order=4, rigid_body=rid.RigidBody(1))
    found = modes.stated_modes(fit)
    assert found["integrators"] == 2
    assert found["hz"] == pytest.approx([40 / (2 * np.pi)], rel=1e-3)
    assert modes.stated_modes(rid.fits.mode_table(fit)) == found
    assert modes.stated_modes([(9, 0.1)]) == {"hz": [9.0], "damping": [0.1]}
    for wrong, words in ((3.0, "pairs"), ([3.0], "pairs"), ("9:0.1", "pairs")):
        with pytest.raises(rid.errors.InputTypeError, match=words):
            modes.stated_modes(wrong)


@pytest.mark.parametrize("dt", [None, 1e-3])
def test_a_machine_that_is_free_to_move_gets_its_integrators(dt):
    """A mass and a mode from 1 to 200 Hz, bounds of 5 %: beside the mode alone nothing that says anything holds the data."""
    omega = 2 * np.pi * np.geomspace(1.0, 200.0, 60)
    plant = control.tf([0.5], [1, 0, 0]) + control.tf([0.4], [1, 2 * 0.01 * 280, 280**2])
    values = plant(1j * omega) if dt is None else plant.sample(dt)(np.exp(1j * omega * dt))
    error = 0.03 * np.random.default_rng(0).uniform(0, 1, 60) * np.exp(1j * np.arange(60) ** 2)
    frf = rid.FrequencyResponse(omega, values * (1 + error), bound="5%", dt=dt)
    found = rid.identify_reduced(frf, worst_case=False, time_limit=60)
    assert found.consistent
    assert found.run_file.modes.integrators == 2
    poles = found.reduction.model.poles()
    assert np.sum(np.abs(poles - (dt is not None)) < 1e-9) == 2


def test_integrators_and_real_poles_are_stated_in_keyword_and_run_file():
    z = np.exp(1j * 0.01 * np.linspace(1.0, 60.0, 25))
    values = 0.02 / (z - 1) + 0.1 / (z - np.exp(-0.2))
    frf = rid.FrequencyResponse(np.linspace(1.0, 60.0, 25), values, bound=1e-4, dt=0.01)
    prior = rid.Prior(gain_bound=1e-3, decay_rate=1.2)
    found = rid.identify_reduced(frf, modes=[(20 / (2 * np.pi), 1.0)], integrators=1, prior=prior, worst_case=False)
    assert found.consistent
    assert found.identification.problem.parametric.size == 2
    again = tomllib.loads(found.run_file.text())["modes"]
    assert (again["integrators"], again["damping"]) == (1, [1.0])
    assert found.reduction.order == 2


def test_a_chosen_gain_bound_that_all_samples_contradict_a_little_is_doubled():
    """What stands for many points says less than all of them; a stated class stays as it is."""
    record = rid.TimeRecord([1.0, 0.0], [0.5, 1.1], dt=1.0, bound=0.5)
    problem = rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=0.5, decay_rate=1.1))
    result = rid.identify(problem)
    assert 1 < result.margin < 1.5
    stated = RunFile(prior=class_choice.PriorChoice.of(problem.prior))
    assert class_choice.with_larger_gain(stated, result) is None
    chosen = stated.changed("prior", source=Source.DATA, note="0.5 at decay rate 1.1")
    run, wider = class_choice.with_larger_gain(chosen, result)
    assert wider.prior == rid.Prior(gain_bound=1.0, decay_rate=1.1)
    assert run.prior.stated(1.0) == wider.prior
    assert "All samples together contradict K = 0.5" in run.prior.note
    assert rid.identify(wider).consistent
    assert class_choice.with_larger_gain(run, rid.identify(wider)) is None
    reference = chosen.changed("prior", source=Source.PROGRAM)
    assert class_choice.with_larger_gain(reference, result) is None


def test_a_class_that_stands_in_place_of_a_search_without_end_says_so():
    """An unfinished run would take it for the choice, and never go on with the search."""
    frf = rid.FrequencyResponse([50.0, 50.001, 60.0], [1.0, 1.5, 1.0], bound=0.01, dt=0.01)
    problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.0, decay_rate=1.1))
    for seconds, source in ((None, Source.PROGRAM), (1e-9, Source.STOPPED)):
        run, _ = class_choice.with_prior(RunFile(), problem, Surroundings(budget=Budget(seconds)))
        assert run.prior.source is source
        assert run.choices["prior"].in_place


def test_modes_are_those_of_all_bands_of_a_response(unreduced):
    """Files of two bands of one plant, as analysers write them: the poles of the second are not left to the class."""
    hz, rng = [np.linspace(4, 30, 40), np.linspace(28, 300, 70)], np.random.default_rng(0)
    natural, damping = 2 * np.pi * np.array([12.0, 140.0]), np.array([0.01, 0.008])

    def part(one):
        s = 2j * np.pi * one
        values = sum(w**2 / (s**2 + 2 * z * w * s + w**2) for w, z in zip(natural, damping, strict=True))
        noise = 0.01 * np.abs(values) * np.exp(2j * np.pi * rng.uniform(size=one.size)) * rng.uniform(size=one.size)
        return rid.FrequencyResponse(2 * np.pi * one, values + noise, bound=0.01 * np.abs(values))

    first, second = map(part, hz)
    whole = modes._of_all_bands([first, second])
    assert np.all(np.diff(whole.omega) > 0)
    assert whole.omega.size == 40 + np.sum(hz[1] > 30)
    assert modes._of_all_bands([first, first]) is first
    found = rid.identify_reduced([first, second], worst_case=False)
    assert found.consistent
    np.testing.assert_allclose(found.run_file.modes.hz, [12.0, 140.0], rtol=1e-3)
