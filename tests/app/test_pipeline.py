"""A run file from the measurements to the report: found, kept, and made again."""

import dataclasses
import html.parser
import tomllib

import numpy as np
import pytest

import robustid as rid
from robustid.app.run import modes, sequence
from robustid.identification import model_residuals
from robustid.report import verdict
from support.interrupts import ctrl_c
from support.measured import needs
from support.refusals import refused
from support.run_files import CLASS, DATA, EXAMPLES, QUICK, SHORT, ask, keep_discs, keep_whole


def numbers(folder, *names):
    out = {}
    for name in names:
        with np.load(folder / f"{name}.npz") as archive:
            out |= {f"{name}/{key}": archive[key] for key in archive.files}
    return out


def same_numbers(one, two, *names):
    first, second = numbers(one, *names), numbers(two, *names)
    # A side that the proof of a larger set gives has no system that comes near to it: its point is NaN in both.
    return first.keys() == second.keys() and all(
        np.array_equal(first[k], second[k], equal_nan=first[k].dtype.kind in "fc") for k in first
    )


@pytest.mark.usefixtures("unpaged")
@pytest.mark.parametrize("sharpened", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_the_run_file_beside_the_results_gives_the_same_again(folder, sharpened, monkeypatch):
    """With modes, prior and bounds left to the program; the second time from another place, without its choosing anything."""
    if not sharpened:
        keep_discs(monkeypatch)
        keep_whole(monkeypatch)
    frf = rid.datasets.flexible_structure(seed=0, lines=5, extra_hz=[17.4, 17.5, 17.6, 17.7, 17.8]).frequency
    rid.save(folder / "frf.csv", frf.with_bound(0.3 * frf.bound, "too tight"))
    chosen = {"identify": {"inflate": "auto"}, "frequency_points": {"every": 2, "near_hz": 1.0}}
    chosen["worst_case"] = {"at_hz": [17.0], "directions": 4}
    (folder / "sub").mkdir()
    first = rid.run(ask(folder, {"frequency": DATA["frequency"]}, chosen), folder / "sub" / "first")
    stated = tomllib.loads((folder / "sub" / "first" / "run.toml").read_text(encoding="utf-8"))
    assert stated["frequency"][0]["file"] == "../../frf.csv"
    for section, keys in {
        "modes": ("hz", "damping", "delay", "hz_interval", "damping_interval", "source", "note"),
        "prior": ("gain_bound", "decay_rate", "source", "note", "curve"),
        "identify": ("inflate", "inflate_source", "inflate_note"),
        "worst_case": ("at_hz",),
    }.items():
        assert set(keys) <= set(stated[section])
    assert isinstance(stated["identify"]["inflate"], float)

    second = rid.run(folder / "sub" / "first" / "run.toml", folder / "second")
    assert same_numbers(folder / "sub" / "first", folder / "second", "identification", "band", "small_model")
    assert second.findings == first.findings
    assert second.identification.choices == first.identification.choices == first.choices
    assert len(first.choices) == 3
    assert first.error is None  # of poles as they were taken nothing is said
    assert any("the poles anywhere in the pole-uncertainty box" in finding for finding in first.findings)
    one, two = ((folder / place / "run.toml").read_text(encoding="utf-8") for place in ("sub/first", "second"))
    assert one.replace("../../frf.csv", "../frf.csv") == two


@pytest.mark.usefixtures("unpaged", "searched")
def test_the_steps_are_those_done_by_hand(folder):
    result = rid.run(ask(folder, DATA, CLASS, {"worst_case": {"at_hz": [17.0], "directions": 4}}), "out")
    frf, step = rid.load("frf.csv"), rid.load("step.csv")
    basis = rid.kautz(2 * np.pi * np.array([9.0, 17.67]), [0.1, 0.004], dt=0.01, delay=1)
    problem = rid.MixedProblem(
        frequency=frf, time=step, prior=rid.Prior(gain_bound=0.2, decay_rate=1.1), parametric=basis
    )
    by_hand = rid.identify(problem)
    assert result.identification.margin == by_hand.margin
    small = rid.reduce_within_bounds(by_hand, band=rid.band(by_hand))
    assert result.reduction.order == small.order
    error = rid.worst_case_error(by_hand, model=small.model, omega=2 * np.pi * np.array([17.0]), directions=4)
    np.testing.assert_array_equal(result.error.upper, error.upper)
    assert result.error.certified
    assert result.choices == {}  # nothing was left to the program
    assert not any("not for the box" in finding for finding in result.findings)
    assert max(r.ratio.max() for r in model_residuals(problem, result.model)) <= 1 + 1e-5
    sums = dataclasses.replace(result.band, polygons=None).error_at(error.omega)
    for found in (result.band, rid.load(folder / "out" / "band")):  # poles are stated: the sweep bounds the same
        np.testing.assert_allclose(found.error_at(error.omega), np.minimum(sums, error.upper), rtol=1e-12)
        assert found.certified
    assert any(result.band.narrowing_words in finding for finding in result.findings)
    assert rid.load("out/identification").margin == by_hand.margin
    assert rid.load("out/worst_case").upper.max() == error.upper.max()


@pytest.mark.usefixtures("unreduced", "unpaged")
def test_a_time_limit_leaves_bounds_at_some_frequencies_and_says_so(folder):
    limited = {"worst_case": {"at_hz": [5.0, 17.0, 30.0], "directions": 4, "time_limit": 1e-6}}
    result = rid.run(ask(folder, DATA, CLASS, limited), "out")
    assert 1 <= result.error.omega.size < 3
    assert result.error.unfinished
    assert any(result.error.unfinished in finding for finding in result.findings)
    assert result.error.certified


@pytest.mark.usefixtures("unreduced", "undrawn")
def test_contradicting_data_end_with_a_finding_and_nothing_is_widened(folder, run, request):
    wrong = {"modes": {"hz": [9.0, 17.2], "damping": [0.1, 0.004]}, "prior": CLASS["prior"]}
    ask(folder, DATA, wrong, SHORT)
    code, out, _ = run(["run", "ask.toml", "-o", "out", "--static", "-v"])
    assert code == 3
    result = rid.load("out/identification")
    assert not result.consistent
    page = (folder / "out" / "report.html").read_text(encoding="utf-8")
    assert "<script" not in page
    assert "Most likely cause" in page.split('<details class="part">')[0]
    assert np.array_equal(result.problem.frequency[0].bound, rid.load("frf.csv").bound)
    assert "No system of the class explains the data: the other samples leave" in out
    assert " of 12 samples outside their bounds: " in out
    assert out.index("No system of the class") < out.index("The data contradict the class")
    assert "each pair repeated once more" in out
    assert "Nothing was widened" in out
    assert f"inflate = {1.1 * result.margin:.4g}" in out
    assert not (folder / "out" / "worst_case.npz").exists()

    request.getfixturevalue("unpaged")
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


@pytest.mark.usefixtures("unreduced", "unpaged")
def test_consistent_data_are_not_widened_by_auto(folder):
    result = rid.run(ask(folder, DATA, CLASS, {"identify": {"inflate": "auto"}}, QUICK), "out")
    assert result.run_file.identify.inflate == 1
    assert "left as they are" in result.choices["inflate"].reason
    assert np.array_equal(result.identification.problem.frequency[0].bound, rid.load("frf.csv").bound)


@pytest.mark.usefixtures("unreduced")
def test_a_class_of_anything_at_all_is_not_chosen():
    """Two lines side by side that no smooth rest passes: a finding, not a huge gain bound."""
    frf = rid.FrequencyResponse([50.0, 50.001, 60.0], [1.0, 1.5, 1.0], bound=0.01, dt=0.01)
    result = rid.identify_reduced(frf, modes=[], worst_case=False)
    assert result.identification.status is rid.Status.INCONSISTENT
    assert result.identification.problem.prior.gain_bound <= 1.5
    assert "Not taken" in result.choices["prior"].reason
    assert result.identification.choices["prior"].in_place
    first, *others = result.diagnosis.causes  # the class does not fit: no word of bounds before that
    assert not first.option
    assert first.change.startswith("state the modes that you know")
    assert any("bound times" in cause.change for cause in others)
    assert "none that says anything holds the data" in verdict(result.identification).sentence
    widened = rid.identify_reduced(frf, modes=[], worst_case=False, inflate="auto")
    assert widened.consistent
    assert widened.run_file.identify.inflate == pytest.approx(1.1 * 25, rel=0.05)  # half the difference over the bound


@pytest.mark.usefixtures("unreduced", "unpaged")
def test_nothing_is_replaced_without_force(folder, run):
    ask(folder, DATA, CLASS, SHORT)
    code, out, _ = run(["run", "ask.toml", "-o", "out", "-v"])
    assert code == 0
    written = sorted(path.name for path in (folder / "out").iterdir())
    assert written == [
        "band.json",
        "band.npz",
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
    code, _, err = run(["run", "ask.toml", "-o", "out"])
    assert code == 2
    assert "--output = 'out' is not empty" in err
    assert "--force" in err
    assert all(path.read_bytes() == content for path, content in before.items())
    ask(folder, DATA, CLASS, QUICK)
    code, _, _ = run(["run", "ask.toml", "-o", "out", "--force"])
    assert code == 0
    assert not (folder / "out" / "worst_case.npz").exists()  # of the earlier run: it would be about another result
    assert (folder / "out" / "mine.txt").read_text() == "mine"
    code, _, err = run(["run", "out/run.toml", "-o", "out", "--force"])
    assert code == 2
    assert "holds the run file itself" in err


@pytest.mark.usefixtures("unreduced", "unpaged")
@pytest.mark.parametrize("sharpened", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_an_interrupted_run_goes_on_where_it_was(folder, run, sharpened, monkeypatch):
    """In the narrowing of the band, which takes most of the time: with what it finds, or with a band that it leaves as it is."""
    if not sharpened:
        monkeypatch.setattr(rid.guarantee.Band, "refine", lambda band, *_, **__: band)
    one = {"worst_case": {"at_hz": [5.0], "directions": 3}}
    ask(folder, DATA, {"prior": CLASS["prior"]}, one)
    whole = rid.run("ask.toml", "whole")
    with monkeypatch.context() as patch:
        patch.setattr(rid.guarantee.Band, "refine", ctrl_c)
        code, out, err = run(["run", "ask.toml", "-o", "out"])
    assert code == 130
    assert "--resume" in out
    assert sorted(p.name for p in (folder / "out").iterdir()) == [
        "band.json", "band.npz", "identification.json", "identification.npz", "report.html", "response-1.csv", "run.toml",
        "small_model.npz", "summary.txt",
    ]  # fmt: skip

    def again(*_, **__):
        raise AssertionError("computed again")

    with monkeypatch.context() as patch:
        patch.setattr(sequence, "identify", again)
        patch.setattr(modes, "suggest_kautz", again)
        code, out, err = run(["run", "ask.toml", "-o", "out", "--resume"])
    assert code == 0, err
    assert "taken from the unfinished run" in out
    assert same_numbers(folder / "whole", folder / "out", "identification", "band", "small_model")
    assert whole.run_file.text() == (folder / "out" / "run.toml").read_text(encoding="utf-8")

    ask(folder, DATA, one, CLASS)
    code, _, err = run(["run", "ask.toml", "-o", "out", "--resume"])
    assert code == 2
    assert "was asked something else" in err


@pytest.mark.usefixtures("unreduced", "unpaged")
def test_changed_data_are_not_taken_for_those_of_an_unfinished_run(folder):
    path = ask(folder, DATA, CLASS, QUICK)
    rid.run(path, "out")
    frf = rid.load("frf.csv")
    rid.save("frf.csv", dataclasses.replace(frf, values=1.01 * frf.values))
    with pytest.raises(rid.InputError, match="aren't the data"):
        rid.run(path, "out", resume=True)


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


@pytest.mark.usefixtures("unreduced", "unsharpened")
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


@pytest.mark.usefixtures("unreduced")
def test_identify_reduced_of_a_problem():
    data = rid.datasets.flexible_structure(seed=0, lines=5, samples=4, extra_hz=[17.4, 17.6, 17.8])
    basis = rid.kautz(data.modes[:, 0], data.modes[:, 1], dt=0.01, delay=1)
    prior = rid.Prior(gain_bound=0.2, decay_rate=1.1)
    problem = rid.MixedProblem(frequency=data.frequency, time=data.time, prior=prior, parametric=basis)
    lines = []
    result = rid.identify_reduced(
        problem, omega=[60.0, 110.0], directions=3, progress=lambda text, *_: lines.append(text)
    )
    assert result.identification.margin == rid.identify(problem).margin
    assert result.wider is None  # no band of wider bounds: that is for data that contradict their class
    np.testing.assert_allclose(result.error.omega, [60.0, 110.0], rtol=1e-15)
    np.testing.assert_array_equal(result.error.upper, result.worst_case.with_model(result.model).upper)
    assert "bounding the error at every frequency" in lines
    assert "given in Python" in result.run_file.text()
    refused("`prior` is part of the problem already", rid.identify_reduced, problem, prior=prior)
    refused("sequence of these two; got int", rid.identify_reduced, 3, error=rid.errors.InputTypeError)
    refused("bound on every sample", rid.identify_reduced, dataclasses.replace(data.frequency, bound=None))
    refused(r"`inflate` must be .auto. or a number", rid.identify_reduced, problem, inflate="very")


def torsion(tmp_path, **changes):
    needs("two_mass/MultisineTypeA.mat")
    content = tomllib.loads((EXAMPLES / "torsion.toml").read_text(encoding="utf-8"))
    result = rid.run(ask(tmp_path, content, changes), tmp_path / "out")
    assert result.consistent
    assert result.error.certified
    # The distortion beside the band is in the bound: a linear class needs no wider one.
    assert result.run_file.identify.inflate == 1
    assert "an estimate from below" in result.identification.problem.frequency[0].note
    assert result.findings[0].startswith("This is about the mean response for this excitation, and rests on it alone")
    residuals = model_residuals(result.identification.problem, result.model)
    assert max(r.ratio.max() for r in residuals) <= 1 + 1e-5
    assert result.reduction.order <= 10
    return result


@pytest.mark.realdata
@pytest.mark.usefixtures("unpaged", "unsharpened")
@pytest.mark.parametrize("every", [80, pytest.param(40, marks=pytest.mark.slow)])
def test_the_torsion_of_a_motor_bench(tmp_path, every):
    prior = {"gain_bound": 1e-3, "decay_rate": 1.2}
    result = torsion(
        tmp_path,
        prior=prior,
        frequency_points={"every": every, "near_hz": 3.0},
        worst_case={"at_hz": [76.0], "directions": 4},
    )
    assert "needs them" in result.choices["inflate"].reason


@pytest.mark.slow
@pytest.mark.realdata
@pytest.mark.usefixtures("unpaged")
def test_the_torsion_of_a_motor_bench_from_its_example(tmp_path):
    result = torsion(tmp_path)
    (points,) = result.identification.problem.frequency
    own = np.median(points.bound.outer_radius / np.abs(points.values))  # 29 %: noise of the samples, jointly at 95 %
    assert np.median(result.error.upper.ravel() / np.abs(result.error.nominal)) < own
    assert any(finding.startswith("Of 152 frequency points that were not used") for finding in result.findings)
