"""A run file from the measurements to the report: every choice stated, kept, and made again."""

import dataclasses
import html.parser
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import robustid as rid
from robustid import _pipeline_core, _pipeline_steps, cli
from robustid._pipeline_file import RunFile, read_run_file
from robustid._pipeline_toml import write_toml
from robustid.data import datasets
from robustid.errors import DatasetNotFoundError
from robustid.identification.residuals import model_residuals

EXAMPLES = Path(__file__).parent.parent / "examples"
DATA = {"frequency": [{"file": "frf.csv"}], "record": [{"file": "step.csv", "use": "samples"}]}
CLASS = {
    "modes": {"hz": [9.0, 17.67], "damping": [0.1, 0.004]},
    "prior": {"gain_bound": 0.2, "decay_rate": 1.1},
}
QUICK = {"worst_case": {"compute": False}}
SHORT = {"worst_case": {"at_hz": [5.0, 17.0], "directions": 4}}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    data = rid.flexible_structure(seed=0, lines=5, samples=4, extra_hz=[17.4, 17.6, 17.8])
    rid.save(tmp_path / "frf.csv", data.frequency)
    rid.save(tmp_path / "step.csv", data.time)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def unreduced(monkeypatch):
    """For tests of other steps: the identified model in place of a search for a smaller one."""

    def whole(identification, rigid_body):
        return rid.balanced_truncation(identification.model, order=identification.order)

    monkeypatch.setattr(_pipeline_core, "reduce_within_bounds", whole)


def ask(folder, *parts, name="ask.toml"):
    content = {}
    for part in parts:
        content |= part
    (folder / name).write_text(write_toml(content), encoding="utf-8")
    return folder / name


def command(arguments, capsys, monkeypatch):
    """Through `main`, as the installed command does; returns (exit code, stdout, stderr)."""
    monkeypatch.setattr("sys.argv", ["robustid", "run", *map(str, arguments)])
    monkeypatch.setenv("COLUMNS", "200")
    with pytest.raises(SystemExit) as stop:
        cli.main()
    out = capsys.readouterr()
    return stop.value.code or 0, out.out, out.err


def numbers(folder, *names):
    out = {}
    for name in names:
        with np.load(folder / f"{name}.npz") as archive:
            out |= {f"{name}/{key}": archive[key] for key in archive.files}
    return out


def same_numbers(one, two, *names):
    first, second = numbers(one, *names), numbers(two, *names)
    return first.keys() == second.keys() and all(np.array_equal(first[k], second[k]) for k in first)


plain = st.one_of(
    st.text(st.characters(exclude_categories=["Cs"])),
    st.booleans(),
    st.integers(-(2**62), 2**62),
    st.floats(allow_nan=False),
)
values = st.one_of(plain, st.lists(plain), st.dictionaries(st.text(st.characters(exclude_categories=["Cs"])), plain))
names = st.text("abcXYZ_-09", min_size=1)


@settings(max_examples=60, deadline=None)
@given(
    st.dictionaries(names, st.one_of(plain, st.lists(plain, min_size=1), st.dictionaries(names, values, min_size=1)))
)
def test_what_is_written_as_toml_reads_back_the_same(content):
    assert tomllib.loads(write_toml(content)) == content


FULL = {
    "title": 'A "title" with \\ and é',
    "channel": [0, "u"],
    "record": [
        {"dataset": "two_mass", "use": "response", "combine": {"theta_mx": 1.0, "theta_my": 1.0}, "start": 1.0},
        {"file": "rest.mat", "use": "rest", "fields": {"u": "current", "y": ["a", "b"]}, "dt": 0.01, "detrend": "mean"},
    ],
    "frequency": [{"file": "a.csv", "unit": "Hz", "bound": 0.1}],
    "estimate": {"period": 2500, "method": "periodic"},
    "delay": {"seconds": "auto"},
    "lines": {"band_hz": [1.0, 2.0], "every": 2, "near_hz": 0.5},
    "modes": {
        "hz": [1.5],
        "damping": [0.01],
        "hz_interval": [[1.4, 1.6]],
        "damping_interval": [[0.005, 0.02]],
        "note": "a\nb",
    },
    "prior": {"gain_bound": 1.0, "decay_rate": 1.1},
    "identify": {"inflate": "auto", "objective": "gain"},
    "small_model": {"rigid_body": 2},
    "worst_case": {"circle": True, "over_poles": True, "at_hz": [1.25]},
}


def test_a_run_file_reads_back_the_same():
    stated = read_run_file(FULL)
    again = read_run_file(tomllib.loads(stated.text()))
    assert dataclasses.asdict(again) == dataclasses.asdict(stated)
    assert again.text() == stated.text()
    for section, content in FULL.items():
        found = getattr(again, section)
        for item, want in (
            zip(found, content, strict=True) if section in ("record", "frequency") else [(found, content)]
        ):
            if isinstance(want, dict):
                for key, value in want.items():
                    assert _as_lists(getattr(item, key)) == value, (section, key)


def _as_lists(value):
    if isinstance(value, dict):
        return {key: _as_lists(item) for key, item in value.items()}
    return [_as_lists(item) for item in value] if isinstance(value, tuple) else value


def test_the_run_file_beside_the_results_gives_the_same_again(folder):
    """With modes, prior and bounds left to the program; the second time from another place, without its choosing anything."""
    frf = rid.flexible_structure(seed=0, lines=5, extra_hz=[17.4, 17.5, 17.6, 17.7, 17.8]).frequency
    rid.save(folder / "frf.csv", frf.with_bound(0.3 * frf.bound, "too tight"))
    chosen = {"identify": {"inflate": "auto"}, "lines": {"every": 2, "near_hz": 1.0}, **SHORT}
    (folder / "sub").mkdir()
    first = rid.run(ask(folder, {"frequency": DATA["frequency"]}, chosen), folder / "sub" / "first")
    stated = tomllib.loads((folder / "sub" / "first" / "run.toml").read_text(encoding="utf-8"))
    assert stated["frequency"][0]["file"] == "../../frf.csv"
    for section, keys in {
        "modes": ("hz", "damping", "delay", "hz_interval", "damping_interval", "note"),
        "prior": ("gain_bound", "decay_rate", "note"),
        "identify": ("inflate", "inflate_note"),
        "worst_case": ("at_hz",),
    }.items():
        assert set(keys) <= set(stated[section])
    assert isinstance(stated["identify"]["inflate"], float)

    second = rid.run(folder / "sub" / "first" / "run.toml", folder / "second")
    assert same_numbers(folder / "sub" / "first", folder / "second", "identification", "worst_case", "small_model")
    assert second.findings == first.findings
    assert second.identification.notes == first.identification.notes == first.choices
    assert len(first.choices) == 3
    assert any("not for the box" in finding for finding in first.findings)
    one, two = ((folder / place / "run.toml").read_text(encoding="utf-8") for place in ("sub/first", "second"))
    assert one.replace("../../frf.csv", "../frf.csv") == two


def test_the_steps_are_those_done_by_hand(folder):
    result = rid.run(ask(folder, DATA, CLASS, SHORT), "out")
    frf, step = rid.load("frf.csv"), rid.load("step.csv")
    basis = rid.kautz(2 * np.pi * np.array([9.0, 17.67]), [0.1, 0.004], dt=0.01, delay=1)
    problem = rid.MixedProblem(
        frequency=frf, time=step, prior=rid.Prior(gain_bound=0.2, decay_rate=1.1), parametric=basis
    )
    by_hand = rid.identify(problem)
    assert result.identification.margin == by_hand.margin
    small = rid.reduce_within_bounds(by_hand)
    assert result.reduction.order == small.order
    error = rid.worst_case_error(by_hand, model=small.model, omega=2 * np.pi * np.array([5.0, 17.0]), directions=4)
    np.testing.assert_array_equal(result.error.upper, error.upper)
    assert result.error.certified
    assert result.choices == ()  # nothing was left to the program
    assert not any("not for the box" in finding for finding in result.findings)
    assert max(r.ratio.max() for r in model_residuals(problem, result.model)) <= 1 + 1e-5
    assert rid.load_identification("out/identification").margin == by_hand.margin
    assert rid.load_worst_case_error("out/worst_case").upper.max() == error.upper.max()


OVERRIDES = {
    "prior": (
        {"prior": {"gain_bound": 0.3, "decay_rate": 1.2}},
        lambda r: r.identification.problem.prior.gain_bound == 0.3,
    ),
    "modes": (
        {"modes": {"hz": [9.0, 17.67, 30.0], "damping": [0.1, 0.004, 0.1]}},
        lambda r: r.identification.problem.parametric.size == 6,
    ),
    "no modes": (
        {"modes": {"hz": [], "damping": []}, "prior": {"gain_bound": 20.0, "decay_rate": 1.02}},
        lambda r: r.identification.problem.parametric is None,
    ),
    "repeat": (
        {"modes": CLASS["modes"] | {"repeat": 2}},
        lambda r: r.identification.problem.parametric.size == 8,
    ),
    "delay of the pairs": (
        {"modes": CLASS["modes"] | {"delay": 2}},
        lambda r: np.sum(np.abs(r.identification.problem.parametric.poles) < 1e-12) > 0,
    ),
    "band": ({"lines": {"band_hz": [5.0, 20.0]}}, lambda r: r.identification.problem.frequency[0].freq_hz[0] >= 5),
    "every": (
        {"lines": {"every": 2}},
        lambda r: r.identification.problem.frequency[0].omega.size == 4 and "Of 4 lines" in " ".join(r.findings),
    ),
    "near": (
        {"lines": {"every": 20, "near_hz": 0.35}},
        lambda r: r.identification.problem.frequency[0].omega.size == 4,
    ),
    "inflate": (
        {"identify": {"inflate": 2.0}},
        lambda r: (
            np.allclose(r.identification.problem.frequency[0].bound, 2 * rid.load("frf.csv").bound)
            and np.allclose(r.identification.problem.time[0].bound, 2 * rid.load("step.csv").bound)
            and "times 2" in r.identification.problem.frequency[0].note
            and "2 times" in r.findings[0]
        ),
    ),
    "objective": ({"identify": {"objective": "margin"}}, lambda r: r.identification.objective == "margin"),
    "form": ({"identify": {"form": "taylor"}}, lambda r: r.identification.length > 0),
    "accuracy": ({"identify": {"accuracy": 0.5}}, lambda r: r.identification.accuracy == 0.5),
    "solver": ({"identify": {"solver": "structured"}}, lambda r: r.identification.solver == "structured"),
    "delay": (
        {"delay": {"seconds": 0.01}, "modes": CLASS["modes"] | {"delay": 0}},
        lambda r: r.identification.problem.time[0].u.size == 3 and "0.01 s taken out" in r.choices[0],
    ),
    "no worst case": (QUICK, lambda r: r.worst_case is None and r.error is None),
}


@pytest.mark.usefixtures("unreduced")
@pytest.mark.parametrize("name", OVERRIDES)
def test_every_choice_can_be_stated(folder, name):
    change, holds = OVERRIDES[name]
    result = rid.run(ask(folder, DATA, CLASS, QUICK, change), "out")
    assert holds(result)
    text = (folder / "out" / "run.toml").read_text(encoding="utf-8")
    stated = tomllib.loads(text)
    for section, keys in change.items():
        assert {key: stated[section][key] for key in keys} == keys


def test_contradicting_data_end_with_a_finding_and_nothing_is_widened(folder, capsys, monkeypatch):
    wrong = {"modes": {"hz": [9.0, 17.2], "damping": [0.1, 0.004]}, "prior": CLASS["prior"]}
    ask(folder, DATA, wrong, SHORT)
    code, out, _ = command(["ask.toml", "-o", "out"], capsys, monkeypatch)
    assert code == 3
    result = rid.load_identification("out/identification")
    assert not result.consistent
    assert np.array_equal(result.problem.frequency[0].bound, rid.load("frf.csv").bound)
    assert "The data contradict the class" in out
    assert "each pair repeated once more" in out
    assert "Nothing was widened" in out
    assert f"inflate = {1.1 * result.margin:.4g}" in out
    assert not (folder / "out" / "worst_case.npz").exists()

    stated = wrong | {"identify": {"inflate": float(f"{1.1 * result.margin:.4g}")}}
    wide = rid.run(ask(folder, DATA, stated, QUICK), "wide")
    assert wide.consistent
    assert wide.identification.margin == pytest.approx(1 / 1.1, rel=1e-3)
    auto = rid.run(ask(folder, DATA, wrong, {"identify": {"inflate": "auto"}}, QUICK), "auto")
    factor = auto.run_file.identify.inflate
    assert factor == pytest.approx(1.1 * result.margin, rel=1e-3)
    bound = auto.identification.problem.frequency[0]
    np.testing.assert_array_equal(bound.bound, factor * rid.load("frf.csv").bound)
    assert f"times {factor:.4g}" in bound.note
    assert "as the program found" in bound.note


@pytest.mark.usefixtures("unreduced")
def test_consistent_data_are_not_widened_by_auto(folder):
    result = rid.run(ask(folder, DATA, CLASS, {"identify": {"inflate": "auto"}}, QUICK), "out")
    assert result.run_file.identify.inflate == 1
    assert "left as they are" in result.choices[0]
    assert np.array_equal(result.identification.problem.frequency[0].bound, rid.load("frf.csv").bound)


def test_a_class_of_anything_at_all_is_not_chosen():
    """Two lines side by side that no smooth rest passes: a finding, not a huge gain bound."""
    frf = rid.FrequencyResponse([50.0, 50.001, 60.0], [1.0, 1.5, 1.0], bound=0.01, dt=0.01)
    result = rid.identify_reduced(frf, modes=[], worst_case=False)
    assert result.identification.status is rid.Status.INCONSISTENT
    assert result.identification.problem.prior.gain_bound <= 1.5
    assert "Not taken" in result.choices[0]
    widened = rid.identify_reduced(frf, modes=[], worst_case=False, inflate="auto")
    assert widened.consistent
    assert widened.run_file.identify.inflate == pytest.approx(1.1 * 25, rel=0.05)  # half the difference over the bound


MISUSE = {
    "unknown section": ({"mods": {"hz": [1.0]}}, "ask.toml: the file has no key 'mods'; the nearest is 'modes'"),
    "unknown key": ({"modes": {"damp": [0.1]}}, r"\[modes\] has no key 'damp'; the nearest is 'damping'"),
    "unknown key of a record": (
        {"record": [{"file": "step.csv", "usee": "rest"}]},
        r"\[\[record\]\] 1: has no key 'usee'; the nearest is 'use'",
    ),
    "text for a number": ({"prior": {"gain_bound": "big"}}, r"\[prior\] gain_bound must be a number; got 'big'"),
    "number for text": ({"title": 3}, "title must be text in quotes; got 3"),
    "flag for a number": ({"lines": {"every": True}}, r"\[lines\] every must be a whole number; got True"),
    "number for a flag": ({"worst_case": {"circle": 1}}, r"\[worst_case\] circle must be true or false; got 1"),
    "number for an array": ({"modes": {"hz": 9.0}}, r"\[modes\] hz must be an array in \[ \]; got 9.0"),
    "text in an array": ({"modes": {"hz": [9.0, "x"]}}, r"\[modes\] hz, item 2, must be a number; got 'x'"),
    "infinite": ({"prior": {"gain_bound": float("inf")}}, "gain_bound must be finite"),
    "negative": ({"prior": {"gain_bound": -1.0}}, "gain_bound must be above 0; got -1"),
    "decay": ({"prior": {"gain_bound": 1.0, "decay_rate": 1.0}}, "decay_rate must be above 1; got 1"),
    "use": ({"record": [{"file": "step.csv", "use": "nothing"}]}, "must be one of 'response', 'samples', 'rest'"),
    "inflate": ({"identify": {"inflate": "much"}}, 'inflate must be "auto" or a number'),
    "section as a value": ({"modes": 3}, r"\[modes\] must be a section with keys; got 3"),
    "record as a section": ({"record": {"file": "step.csv"}}, r"must be written \[\[record\]\]"),
    "half a prior": ({"prior": {"gain_bound": 1.0}}, "gain_bound is given without decay_rate"),
    "half a mode": ({"modes": {"hz": [9.0]}}, "hz is given without damping"),
    "sizes": ({"modes": {"hz": [9.0], "damping": [0.1, 0.2]}}, "damping has 2 items, hz has 1"),
    "percent": ({"modes": {"hz": [9.0], "damping": [1.5]}}, "ratio below 1, not percent; got 1.5"),
    "count and hz": ({"modes": CLASS["modes"] | {"count": 2}}, "give one of them"),
    "circle without bounds": ({"worst_case": {"compute": False, "circle": True}}, "contradicts compute = false"),
    "no box": ({**CLASS, "worst_case": {"over_poles": True}}, "needs the box"),
    "near without every": ({"lines": {"near_hz": 1.0}}, "give every = 2 or more too"),
    "band": ({"lines": {"band_hz": [3.0, 2.0]}}, r"must be \[low, high\]; got \[3.0, 2.0\]"),
    "file and dataset": ({"record": [{"file": "step.csv", "dataset": "two_mass"}]}, "needs either file or dataset"),
    "neither": ({"record": [{"use": "rest"}]}, "needs either file or dataset"),
    "no data": ({"record": [], "frequency": []}, "no data: give"),
    "missing file": ({"frequency": [{"file": "other.csv"}]}, "there is no file .*other.csv"),
    "estimate without records": ({"estimate": {"period": 10}}, "there is no .* with use = \"response\""),
    "rest alone": ({"record": [{"file": "step.csv", "use": "rest"}], "frequency": []}, "nothing to bound"),
    "samples without bound": (
        {"record": [{"file": "bare.csv", "use": "samples"}]},
        'use = "samples" needs bound = ...',
    ),
    "kind of file": ({"record": [{"file": "frf.csv", "use": "samples"}]}, r"\[\[record\]\] 1, frf.csv: .*"),
    "window": ({"record": [{"file": "step.csv", "use": "samples", "start": 5.0}]}, r"\[\[record\]\] 1, step.csv: .*start"),
    "past alone": ({"record": [{"file": "step.csv", "past": "known"}]}, "give start or stop too"),
    "a note about other numbers": (
        {"prior": {"gain_bound": 0.3, "decay_rate": 1.1, "note": "Prior taken from the curve of the smallest gain bound:\n0.2"}},
        "tells how other numbers were chosen, not 0.3",
    ),
    "digest": ({"frequency": [{"file": "frf.csv", "digest": "0" * 64}]}, "aren't the data that the run file was made with"),
    "solver": ({"identify": {"solver": "MAGIC"}}, "MAGIC"),
    "directions": ({"worst_case": {"directions": 400}}, "directions must be at most 360; got 400"),
    "dataset": ({"record": [{"dataset": "three_mass"}]}, "three_mass"),
}  # fmt: skip


@pytest.mark.parametrize("name", MISUSE)
def test_misuse_is_one_sentence_before_anything_is_computed(folder, capsys, monkeypatch, name):
    def computed(*_, **__):
        raise AssertionError("computed")

    monkeypatch.setattr("robustid.pipeline.from_data", computed)
    step = rid.load("step.csv")
    rid.save("bare.csv", dataclasses.replace(step, bound=None))
    change, words = MISUSE[name]
    path = ask(folder, DATA, change)
    with pytest.raises((rid.InputError, rid.InputTypeError), match=words):
        rid.run(path, "out")
    code, _, err = command(["ask.toml", "-o", "out"], capsys, monkeypatch)
    assert code == 2
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert "--dt" not in err
    assert not (folder / "out").exists()


@pytest.mark.parametrize(
    "change", [{"modes": {"hz": [60.0], "damping": [0.1]}}, {"worst_case": {"at_hz": [60.0]}, "modes": CLASS["modes"]}]
)
def test_frequencies_beyond_the_sample_time_are_refused_first(folder, monkeypatch, change):
    monkeypatch.setattr(_pipeline_steps, "suggest_prior", None)
    with pytest.raises(rid.InputError, match="60 Hz, above the Nyquist frequency of 50 Hz"):
        rid.run(ask(folder, DATA, change), "out")


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"[modes\n", "is not TOML: .*line 1"), (b"\xff\xfe", "no text in UTF-8"), (None, "can't be read: No such file")],
)
def test_a_file_that_is_no_run_file(folder, capsys, monkeypatch, content, words):
    if content is not None:
        (folder / "ask.toml").write_bytes(content)
    with pytest.raises(rid.FileFormatError, match=words):
        rid.run("ask.toml", "out")
    assert command(["ask.toml"], capsys, monkeypatch)[0] == 2


@pytest.mark.usefixtures("unreduced")
def test_nothing_is_replaced_without_force(folder, capsys, monkeypatch):
    ask(folder, DATA, CLASS, SHORT)
    code, out, _ = command(["ask.toml", "-o", "out"], capsys, monkeypatch)
    assert code == 0
    written = sorted(path.name for path in (folder / "out").iterdir())
    assert written == [
        "identification.json",
        "identification.npz",
        "report.html",
        "response-1.csv",
        "run.toml",
        "small_model.npz",
        "summary.txt",
        "worst_case.json",
        "worst_case.npz",
    ]
    assert all(f"out/{name}" in out for name in written)
    before = {path: path.read_bytes() for path in (folder / "out").iterdir()}
    (folder / "out" / "mine.txt").write_text("mine")
    code, _, err = command(["ask.toml", "-o", "out"], capsys, monkeypatch)
    assert code == 2
    assert "--output = 'out' is not empty" in err
    assert "--force" in err
    assert all(path.read_bytes() == content for path, content in before.items())
    ask(folder, DATA, CLASS, QUICK)
    code, _, _ = command(["ask.toml", "-o", "out", "--force"], capsys, monkeypatch)
    assert code == 0
    assert not (folder / "out" / "worst_case.npz").exists()  # of the earlier run: it would be about another result
    assert (folder / "out" / "mine.txt").read_text() == "mine"
    code, _, err = command(["out/run.toml", "-o", "out", "--force"], capsys, monkeypatch)
    assert code == 2
    assert "holds the run file itself" in err


@pytest.mark.usefixtures("unreduced")
def test_an_interrupted_run_goes_on_where_it_was(folder, capsys, monkeypatch):
    ask(folder, DATA, {"prior": CLASS["prior"]}, SHORT)
    whole = rid.run("ask.toml", "whole")

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(_pipeline_core, "worst_case_error", interrupted)
        code, out, err = command(["ask.toml", "-o", "out"], capsys, monkeypatch)
    assert code == 130
    assert "--resume" in out
    assert sorted(p.name for p in (folder / "out").iterdir()) == [
        "identification.json", "identification.npz", "response-1.csv", "run.toml",
    ]  # fmt: skip

    def again(*_, **__):
        raise AssertionError("computed again")

    with monkeypatch.context() as patch:
        patch.setattr(_pipeline_core, "identify", again)
        patch.setattr(_pipeline_steps, "suggest_kautz", again)
        code, out, err = command(["ask.toml", "-o", "out", "--resume"], capsys, monkeypatch)
    assert code == 0, err
    assert "taken from the unfinished run" in out
    assert same_numbers(folder / "whole", folder / "out", "identification", "worst_case", "small_model")
    assert whole.run_file.text() == (folder / "out" / "run.toml").read_text(encoding="utf-8")

    ask(folder, DATA, SHORT, CLASS)
    code, _, err = command(["ask.toml", "-o", "out", "--resume"], capsys, monkeypatch)
    assert code == 2
    assert "was asked something else" in err


@pytest.mark.usefixtures("unreduced")
def test_changed_data_are_not_taken_for_those_of_an_unfinished_run(folder):
    path = ask(folder, DATA, CLASS, QUICK)
    rid.run(path, "out")
    frf = rid.load("frf.csv")
    rid.save("frf.csv", dataclasses.replace(frf, values=1.01 * frf.values))
    with pytest.raises(rid.InputError, match="aren't the data"):
        rid.run(path, "out", resume=True)


def plant_records():
    """Two outputs of one input, three periods of a multisine in steady state, and a rest record."""
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


@pytest.mark.usefixtures("unreduced")
def test_records_become_a_response_with_the_bounds_of_the_rest(folder):
    record, rest = plant_records()
    rid.save("record.npz", record)
    rid.save("rest.npz", rest)
    sources = [
        {"file": "record.npz", "combine": {"left": 1.0, "right": 1.0}, "start": 0.5},
        {"file": "rest.npz", "combine": {"left": 1.0, "right": 1.0}, "use": "rest"},
    ]
    path = ask(folder, {"record": sources, "estimate": {"period": 50, "rest_factor": 2.0}}, QUICK,
               {"modes": {"hz": [40 / 2 / np.pi], "damping": [0.05]}, "prior": {"gain_bound": 0.1, "decay_rate": 1.1}})  # fmt: skip
    result = rid.run(path, "out")
    total = [dataclasses.replace(r, y=r.y.sum(axis=1), outputs=["left + right [m]"]) for r in (record, rest)]
    excited = total[0].window(0.5, past="periodic")
    noise = rid.bounds_from_rest(total[1], factor=2.0)
    expected = noise.bound_response(rid.estimate_frf(excited, period=50), excited, period=50)
    (found,) = result.identification.problem.frequency
    np.testing.assert_allclose(found.values, expected.values, rtol=1e-12)
    np.testing.assert_allclose(found.bound, expected.bound, rtol=1e-12)
    assert found.bound_kind == "rest"
    assert str(found.outputs[0]) == "left + right [m]"
    assert result.consistent
    stated = tomllib.loads((folder / "out" / "run.toml").read_text(encoding="utf-8"))
    assert (stated["estimate"]["method"], stated["record"][0]["past"]) == ("periodic", "periodic")
    assert rid.load("out/response-1.csv").values.shape == expected.values.shape


@pytest.mark.usefixtures("unreduced")
def test_samples_without_bound_take_that_of_the_rest(folder):
    record, rest = plant_records()
    rid.save("record.npz", record.channel(0))
    rid.save("rest.npz", rest.channel(0))
    sources = [{"file": "record.npz", "use": "samples", "stop": 0.2}, {"file": "rest.npz", "use": "rest"}]
    change = {"record": sources, "modes": {"hz": [40 / 2 / np.pi], "damping": [0.05]},
              "prior": {"gain_bound": 0.5, "decay_rate": 1.05}}  # fmt: skip
    with pytest.raises(rid.InputError, match="bound"):  # known past of an unbounded record
        rid.run(ask(folder, change, QUICK), "out")
    sources[0] |= {"past": "unknown"}
    result = rid.run(ask(folder, change, QUICK), "out")
    (time,) = result.identification.problem.time
    noise = rid.bounds_from_rest(rest.channel(0))
    np.testing.assert_allclose(time.bound, noise.level[0])
    np.testing.assert_allclose(time.y[:, 0], record.y[:20, 0] - noise.mean[0])


@pytest.mark.usefixtures("unreduced")
def test_several_channels_are_taken_one_by_one(folder):
    record, _ = plant_records()
    rid.save("record.npz", record)
    data = {"record": [{"file": "record.npz"}], "estimate": {"period": 50}}
    rest = {"modes": {"hz": [40 / 2 / np.pi], "damping": [0.05]}, "prior": {"gain_bound": 0.1, "decay_rate": 1.1}}
    with pytest.raises(
        rid.InputError, match=r"2 outputs \(left \[m\], right \[m\]\).* add channel = \[output, input\]"
    ):
        rid.run(ask(folder, data, rest, QUICK), "out")
    right = rid.run(ask(folder, data, rest, QUICK, {"channel": ["right", 0]}), "right")
    left = rid.run(ask(folder, data, rest, QUICK, {"channel": [0, "force"]}), "left")
    ratio = np.abs(left.model(1) / right.model(1))
    assert ratio == pytest.approx(3, rel=0.05)


@pytest.mark.usefixtures("unreduced")
def test_a_delay_is_found_taken_out_and_said(folder):
    omega = 2 * np.pi * np.linspace(1, 45, 40)
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
    assert "Delay of 0.03 s taken out" in result.choices[0]
    np.testing.assert_allclose(result.identification.problem.frequency[0].values[:, 0, 0], plant, atol=1e-3)


class _Text(html.parser.HTMLParser):
    """The text of the element with an id."""

    def __init__(self, wanted):
        super().__init__()
        self.wanted, self.inside, self.text = wanted, False, ""

    def handle_starttag(self, tag, attrs):
        self.inside = self.inside or ("id", self.wanted) in attrs

    def handle_endtag(self, tag):
        self.inside = self.inside and tag != "pre"

    def handle_data(self, data):
        self.text += data if self.inside else ""


def test_the_page_holds_the_run_file_and_the_findings(folder):
    title = "<script>alert(1)</script> & more"
    result = rid.run(ask(folder, {"title": title}, DATA, CLASS, SHORT), "out")
    page = (folder / "out" / "report.html").read_text(encoding="utf-8")
    found = _Text("run-file")
    found.feed(page)
    assert tomllib.loads(found.text) == tomllib.loads(result.run_file.text())
    assert "<script>alert" not in page
    assert "What was found" in page
    assert "keeps all 12 samples within their bounds" in page
    assert "How this was made" in page


def test_identify_reduced_of_a_problem():
    data = rid.flexible_structure(seed=0, lines=5, samples=4, extra_hz=[17.4, 17.6, 17.8])
    basis = rid.kautz(data.modes[:, 0], data.modes[:, 1], dt=0.01, delay=1)
    prior = rid.Prior(gain_bound=0.2, decay_rate=1.1)
    problem = rid.MixedProblem(frequency=data.frequency, time=data.time, prior=prior, parametric=basis)
    lines = []
    result = rid.identify_reduced(
        problem, omega=[60.0, 110.0], directions=4, progress=lambda text, done=None, count=None: lines.append(text)
    )
    assert result.identification.margin == rid.identify(problem).margin
    np.testing.assert_allclose(result.error.omega, [60.0, 110.0], rtol=1e-15)
    np.testing.assert_array_equal(result.error.upper, result.worst_case.with_model(result.model).upper)
    assert "bounding the error at every frequency" in lines
    assert "given in Python" in result.run_file.text()
    with pytest.raises(rid.InputError, match="`prior` is part of the problem already"):
        rid.identify_reduced(problem, prior=prior)
    with pytest.raises(rid.InputTypeError, match="sequence of these two; got int"):
        rid.identify_reduced(3)
    with pytest.raises(rid.InputError, match="bound on every sample"):
        rid.identify_reduced(dataclasses.replace(data.frequency, bound=None))
    with pytest.raises(rid.InputError, match=r"inflate must be .auto. or a number"):
        rid.identify_reduced(problem, inflate="very")


def test_samples_outside_are_named():
    """A bound that no truncated model keeps: the identified one is inflated, and the samples outside stand in a finding."""
    first = rid.FrequencyResponse([50.0], [1.0], bound=0.01, dt=0.01)
    second = rid.FrequencyResponse([50.0], [2.0], bound=0.01, dt=0.01)
    result = rid.identify_reduced([first, second], modes=[], worst_case=False)
    assert not result.consistent
    assert "2 of 2 samples outside their bounds: 7.9577 Hz (50 bounds)" in " ".join(result.findings)


def torsion(tmp_path, **changes):
    try:
        datasets.find("two_mass/MultisineTypeA.mat")
    except DatasetNotFoundError as missing:
        pytest.skip(str(missing))
    content = tomllib.loads((EXAMPLES / "torsion.toml").read_text(encoding="utf-8"))
    result = rid.run(ask(tmp_path, content, changes), tmp_path / "out")
    assert result.consistent
    assert result.error.certified
    assert result.run_file.identify.inflate > 10
    assert "as the program found" in result.identification.problem.frequency[0].note
    residuals = model_residuals(result.identification.problem, result.model)
    assert max(r.ratio.max() for r in residuals) <= 1 + 1e-5
    assert result.reduction.order <= 10
    return result


def test_rigid_body_modes_are_asked_of_the_small_model(folder, monkeypatch):
    asked = []

    def whole(identification, rigid_body):
        asked.append(rigid_body.count)
        return rid.balanced_truncation(identification.model, order=identification.order)

    monkeypatch.setattr(_pipeline_core, "reduce_within_bounds", whole)
    result = rid.run(ask(folder, DATA, CLASS, QUICK, {"small_model": {"rigid_body": 1}}), "out")
    assert asked == [1]
    assert result.run_file.small_model.rigid_body == 1


@pytest.mark.realdata
def test_the_torsion_of_a_motor_bench(tmp_path):
    prior = {"gain_bound": 1e-3, "decay_rate": 1.2}
    result = torsion(
        tmp_path, prior=prior, lines={"every": 24, "near_hz": 3.0}, worst_case={"at_hz": [76.0], "directions": 4}
    )
    assert "needs them" in result.choices[1]


@pytest.mark.slow
@pytest.mark.realdata
def test_the_torsion_of_a_motor_bench_from_its_example(tmp_path):
    result = torsion(tmp_path)
    median = np.median(result.error.upper.ravel() / np.abs(result.error.nominal))
    assert median < 0.2
    assert any(finding.startswith("Of 152 lines that were not used") for finding in result.findings)


def test_defaults_ask_for_nothing():
    assert RunFile().text().count("None") == 0
    assert read_run_file(tomllib.loads(RunFile().text()), sources=False) == RunFile()
