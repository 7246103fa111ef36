"""Run files as text: what is written reads back, and what is wrong is one sentence."""

import dataclasses
import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import robustid as rid
from robustid.app.run import class_choice
from robustid.app.run.run_file import RunFile, read_run_file
from robustid.app.run.toml import write_toml
from robustid.core import Source
from support.run_files import CLASS, DATA, ask

pytestmark = pytest.mark.quick
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
    "entry": [0, "u"],
    "record": [
        {"dataset": "two_mass", "use": "response", "combine": {"theta_mx": 1.0, "theta_my": 1.0}, "start": 1.0},
        {
            "file": "rest.mat",
            "use": "noise_floor",
            "fields": {"u": "current", "y": ["a", "b"]},
            "dt": 0.01,
            "detrend": "mean",
        },
    ],
    "frequency": [{"file": "a.csv", "unit": "Hz", "bound": 0.1}],
    "estimate": {"period": 2500, "method": "periodic"},
    "delay": {"seconds": "auto"},
    "frequency_points": {"band_hz": [1.0, 2.0], "every": 2, "near_hz": 0.5},
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


MISUSE = {
    "unknown section": ({"mods": {"hz": [1.0]}}, "ask.toml: the file has no key 'mods'; the nearest is 'modes'"),
    "nothing near": ({"xyz": {"every": 2}}, "has no key 'xyz'; these are known: title, time_limit, entry, column, split, record"),
    "old section": ({"lines": {"every": 2}}, "no key 'lines' any more: it is called 'frequency_points' now"),
    "old key": (
        {"estimate": {"rest_factor": 2.0}},
        r"\[estimate\] has no key 'rest_factor' any more: it is called 'noise_floor_factor' now",
    ),
    "old key of the file": ({"channel": [0, 0]}, "no key 'channel' any more: it is called 'entry' now"),
    "unknown key": ({"modes": {"damp": [0.1]}}, r"\[modes\] has no key 'damp'; the nearest is 'damping'"),
    "unknown key of a record": (
        {"record": [{"file": "step.csv", "usee": "rest"}]},
        r"\[\[record\]\] 1: has no key 'usee'; the nearest is 'use'",
    ),
    "text for a number": ({"prior": {"gain_bound": "big"}}, r"\[prior\] gain_bound must be a number; got 'big'"),
    "number for text": ({"title": 3}, "title must be text in quotes; got 3"),
    "flag for a number": ({"frequency_points": {"every": True}}, r"\[frequency_points\] every must be a whole number; got True"),
    "number for a flag": ({"worst_case": {"circle": 1}}, r"\[worst_case\] circle must be true or false; got 1"),
    "number for an array": ({"modes": {"hz": 9.0}}, r"\[modes\] hz must be an array in \[ \]; got 9.0"),
    "text in an array": ({"modes": {"hz": [9.0, "x"]}}, r"\[modes\] hz, item 2, must be a number; got 'x'"),
    "text in an array of arrays": (
        {"modes": {"hz_interval": [[8.9, 9.1], [17.0, "x"]]}},
        r"\[modes\] hz_interval, item 2, item 2, must be a number; got 'x'",
    ),
    "infinite": ({"prior": {"gain_bound": float("inf")}}, "gain_bound must be finite"),
    "negative": ({"prior": {"gain_bound": -1.0}}, "gain_bound must be positive; got -1"),
    "decay": ({"prior": {"gain_bound": 1.0, "decay_rate": 1.0}}, "decay_rate must be above 1; got 1"),
    "use": ({"record": [{"file": "step.csv", "use": "nothing"}]}, "must be one of response, samples, noise_floor"),
    "inflate": ({"identify": {"inflate": "much"}}, 'inflate must be "auto" or a number'),
    "section as a value": ({"modes": 3}, r"\[modes\] must be a section with keys; got 3"),
    "record as a section": ({"record": {"file": "step.csv"}}, r"must be written \[\[record\]\]"),
    "half a prior": ({"prior": {"gain_bound": 1.0}}, "gain_bound is given without decay_rate"),
    "half a mode": ({"modes": {"hz": [9.0]}}, "hz is given without damping"),
    "sizes": ({"modes": {"hz": [9.0], "damping": [0.1, 0.2]}}, "damping has 2 items, hz has 1"),
    "percent": ({"modes": {"hz": [9.0], "damping": [1.5]}}, "ratio below 1, not percent; got 1.5"),
    "count and hz": ({"modes": CLASS["modes"] | {"count": 2}}, "give one of them"),
    "fit without order": ({"fit": {"modal": "general"}}, r'\[fit\] needs order = ..., a whole number or "auto"'),
    "order of a fit": ({"fit": {"order": "many"}}, r'\[fit\] order must be "auto" or a number'),
    "shapes without structure": ({"fit": {"order": 4, "symmetric": True}}, "give modal too"),
    "fit and modes": ({"fit": {"order": 4}, "modes": CLASS["modes"]}, r"\[fit\] takes the modes from a fit, .* give one"),
    "fit and count": ({"fit": {"order": 4}, "modes": {"count": 2}}, "give one of them"),
    "circle without bounds": ({"worst_case": {"compute": False, "circle": True}}, "contradicts compute = false"),
    "no box": ({**CLASS, "worst_case": {"over_poles": True}}, "needs the pole-uncertainty box"),
    "near without every": ({"frequency_points": {"near_hz": 1.0}}, "give every = 2 or more too"),
    "band": ({"frequency_points": {"band_hz": [3.0, 2.0]}}, r"must be \[low, high\]; got \[3.0, 2.0\]"),
    "file and dataset": ({"record": [{"file": "step.csv", "dataset": "two_mass"}]}, "needs either file or dataset"),
    "neither": ({"record": [{"use": "noise_floor"}]}, "needs either file or dataset"),
    "no data": ({"record": [], "frequency": []}, "no data: give"),
    "missing file": ({"frequency": [{"file": "other.csv"}]}, "there is no file .*other.csv"),
    "estimate without records": ({"estimate": {"period": 10}}, "there is no .* with use = \"response\""),
    "rest alone": ({"record": [{"file": "step.csv", "use": "noise_floor"}], "frequency": []}, "nothing to bound"),
    "samples without bound": (
        {"record": [{"file": "bare.csv", "use": "samples"}]},
        'no error bound can be taken from the data: .* Give bound = ...',
    ),
    "kind of file": ({"record": [{"file": "frf.csv", "use": "samples"}]}, r"\[\[record\]\] 1, frf.csv: .*"),
    "window": ({"record": [{"file": "step.csv", "use": "samples", "start": 5.0}]}, r"\[\[record\]\] 1, step.csv: .*start"),
    "past alone": ({"record": [{"file": "step.csv", "past": "known"}]}, "give start or stop too"),
    "a note about other numbers": (
        {"prior": {"gain_bound": 0.3, "decay_rate": 1.1, "source": "data", "note": "0.2 fits", "digest": "0" * 64}},
        r"\[prior\] note tells how other values were chosen than gain_bound = 0.3, decay_rate = 1.1: leave source, note",
    ),
    "digest": ({"frequency": [{"file": "frf.csv", "digest": "0" * 64}]}, "aren't the data that the run file was made with"),
    "solver": ({"identify": {"solver": "MAGIC"}}, "MAGIC"),
    "directions": ({"worst_case": {"directions": 400}}, "directions must be at most 360; got 400"),
    "dataset": ({"record": [{"dataset": "three_mass"}]}, "three_mass"),
}  # fmt: skip


@pytest.mark.parametrize("name", MISUSE)
def test_misuse_is_one_sentence_before_anything_is_computed(folder, run, monkeypatch, name):
    def computed(*_, **__):
        raise AssertionError("computed")

    monkeypatch.setattr("robustid.app.run.pipeline.from_data", computed)
    step = rid.load("step.csv")
    rid.save("bare.csv", dataclasses.replace(step, bound=None))
    change, words = MISUSE[name]
    path = ask(folder, DATA, change)
    with pytest.raises((rid.InputError, rid.errors.InputTypeError), match=words):
        rid.run(path, "out")
    code, _, err = run(["run", "ask.toml", "-o", "out"])
    assert code == 2
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert "--dt" not in err
    assert not (folder / "out").exists()


@pytest.mark.parametrize(
    "change", [{"modes": {"hz": [60.0], "damping": [0.1]}}, {"worst_case": {"at_hz": [60.0]}, "modes": CLASS["modes"]}]
)
def test_frequencies_beyond_the_sample_time_are_refused_first(folder, monkeypatch, change):
    monkeypatch.setattr(class_choice, "useful_prior", None)
    with pytest.raises(rid.InputError, match="60 Hz, above the Nyquist frequency of 50 Hz"):
        rid.run(ask(folder, DATA, change), "out")


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"[modes\n", "is not TOML: .*line 1"), (b"\xff\xfe", "no text in UTF-8"), (None, "there is no such file")],
)
def test_a_file_that_is_no_run_file(folder, run, content, words):
    if content is not None:
        (folder / "ask.toml").write_bytes(content)
    with pytest.raises(rid.errors.FileFormatError, match=words):
        rid.run("ask.toml", "out")
    assert run(["run", "ask.toml"])[0] == 2


def test_what_the_program_chose_is_told_by_its_source_and_changed_values_are_noticed():
    modes = {"hz": (9.0, 17.67), "damping": (0.1, 0.004)}
    run = RunFile().changed("modes", **modes, source=Source.DATA, note="Modes taken from the data")
    content = tomllib.loads(run.text())
    assert content["modes"]["source"] == "data"
    again = read_run_file(content, sources=False)
    assert again == run
    assert again.choices["modes"].source is Source.DATA
    for name in modes:
        changed = {"modes": content["modes"] | {name: [0.2, 0.3]}}
        with pytest.raises(rid.InputError, match=f"note tells how other values were chosen than .*{name} = .0.2, 0.3"):
            read_run_file(changed, sources=False)
    bare = {"modes": {key: value for key, value in content["modes"].items() if key not in ("source", "digest")}}
    stated = read_run_file(bare, sources=False)
    assert stated.choices["modes"].source is Source.STATED  # whatever its note says


def test_defaults_ask_for_nothing():
    assert RunFile().text().count("None") == 0
    assert read_run_file(tomllib.loads(RunFile().text()), sources=False) == RunFile()
