"""Obvious spellings lead on: names of other programs, attributes that are not there, arguments without their names."""

import copy
import inspect
import pickle
import re

import control
import numpy as np
import pytest

import robustid as rid
from robustid.app.cli.main import COMMANDS
from robustid.errors import InputTypeError
from robustid.spellings import _COMMANDS, MEANT, command_meant
from support.command_line import words

pytestmark = pytest.mark.quick

OMEGA = np.linspace(1, 9, 40)
FRF = rid.FrequencyResponse(OMEGA, 1 / (16 - OMEGA**2 + 0.2j * OMEGA), bound=0.01)
RECORD = rid.TimeRecord(np.cos(np.arange(40.0) ** 2), np.ones(40), dt=0.1, bound=0.1)
FIT = rid.fit_mfd(FRF, order=2)
CLASS = rid.datasets.flexible_structure(lines=5)
RESULT = rid.identify(rid.MixedProblem(frequency=CLASS.frequency, prior=rid.Prior(gain_bound=20.0, decay_rate=1.04)))

# thing, what is typed, what the message says
ATTRIBUTES = [
    *((FRF, typed, "frf.freq_hz") for typed in ("freq", "frequency", "f", "hz", "freqs")),
    *((FRF, typed, "numpy.abs(frf.values)") for typed in ("magnitude", "mag", "gain")),
    (FRF, "phase", "numpy.angle(frf.values)"),
    *((FRF, typed, "frf.values") for typed in ("H", "response", "G")),
    (FRF, "w", "frf.omega"),
    (FRF, "fit", "robustid.fit_mfd(frf)"),
    (FRF, "fit_mfd", "robustid.fit_mfd(frf)"),
    *((FRF, typed, "frf.plot()") for typed in ("plot_bode", "bode", "show")),
    (FRF, "between", "frf.band(low_hz, high_hz)"),
    *((FRF, typed, "frf.save(path)") for typed in ("to_csv", "export", "write")),
    *((FRF, typed, "frf.to_dataframe()") for typed in ("df", "to_pandas")),
    (FRF, "std", "frf.bound"),
    (FRF, "valeus", "frf.values"),
    (RECORD, "t", "record.time"),
    *((RECORD, typed, "record.dt") for typed in ("fs", "sample_rate", "Ts")),
    (RECORD, "input", "record.u"),
    (RECORD, "output", "record.y"),
    (RECORD, "estimate_frf", "robustid.estimate_frf(record)"),
    (RECORD, "frf", "robustid.estimate_frf(record)"),
    (RECORD, "welch", "robustid.estimate_frf(record)"),
    (RECORD, "crop", "record.window(start, stop)"),
    (FIT, "order", "fit.model.nstates"),
    (FIT, "zeros", "fit.model.zeros()"),
    (FIT, "tf", "fit.model"),
    (FIT, "ss", "fit.model"),
    (FIT, "A", "fit.model"),
    (FIT, "damping", "fit.modes"),
    (FIT, "validate", "robustid.validate(fit)"),
    (RESULT, "poles", "result.model.poles()"),
    (RESULT, "ss", "result.model"),
    (RESULT, "describe", "result.summary()"),
    (RESULT, "worst_case_error", "robustid.worst_case_error(result)"),
    (RESULT, "bounds", "robustid.worst_case_error(result)"),
    (RESULT, "reduce", "robustid.reduce_within_bounds(result)"),
]


@pytest.mark.parametrize(
    ("thing", "typed", "meant"), ATTRIBUTES, ids=[f"{type(a).__name__}.{b}" for a, b, _ in ATTRIBUTES]
)
def test_an_attribute_that_is_not_there_leads_on(thing, typed, meant):
    assert not hasattr(thing, typed)
    with pytest.raises(AttributeError, match=re.escape(f"; {meant} is what you look for")):
        getattr(thing, typed)
    if not meant.startswith("numpy"):  # what it says is there
        names = meant.replace("robustid.", "rid.").split("(")[0].split(".")
        found = {"rid": rid, "frf": FRF, "record": RECORD, "fit": FIT, "result": RESULT}[names[0]]
        for name in names[1:]:
            found = getattr(found, name)


def test_sixty_spellings_and_more_lead_on():
    assert len(MEANT) + len(ATTRIBUTES) >= 60


def test_what_means_nothing_is_answered_by_what_there_is():
    with pytest.raises(
        AttributeError, match=r"a TimeRecord has no 'xyzzy'; it has bound, dt, entry, held, initial, inputs"
    ):
        RECORD.xyzzy  # noqa: B018


def test_a_property_that_fails_fails_as_it_did():
    class Broken(rid.TimeRecord):
        @property
        def time(self):
            return self.u.there_is_none

    with pytest.raises(AttributeError, match=r"'numpy.ndarray' object has no attribute 'there_is_none'"):
        Broken([1.0], [1.0], dt=1.0).time  # noqa: B018


def test_missing_attributes_are_asked_for_at_no_cost_and_travel():
    error = None
    try:
        FRF.freq  # noqa: B018
    except AttributeError as found:
        error = pickle.loads(pickle.dumps(found))
    assert str(error) == "a FrequencyResponse has no 'freq'; frf.freq_hz is what you look for"
    assert copy.copy(FRF) == FRF
    assert getattr(FRF, "frdata", None) is None


# call, what its message says
CALLS = [
    (lambda: rid.FrequencyResponse(OMEGA, FRF.values, 0.1), "FrequencyResponse(..., bound=0.1)"),
    (lambda: rid.TimeRecord([1.0], [1.0], 0.01), "TimeRecord(..., dt=0.01)"),
    (lambda: rid.Prior(2.0, 1.1), "Prior(gain_bound=2.0, decay_rate=1.1)"),
    (lambda: rid.kautz(10.0, 0.01, 0.001), "kautz(..., dt=0.001)"),
    (lambda: rid.fit_mfd(FRF, 20), "fit_mfd(..., order=20)"),
    (lambda: rid.estimate_frf(RECORD, "welch"), "estimate_frf(..., method='welch')"),
    (lambda: rid.worst_case_error(RESULT, OMEGA), "worst_case_error(..., model=...)"),
    (lambda: rid.load("frf.csv", "frequency"), "load(..., kind='frequency')"),
    (lambda: rid.compare(FRF, FRF, 0.9), "compare(..., probability=0.9)"),
    (lambda: rid.design.Limits(2.0), "Limits(sensitivity_peak=2.0)"),
    (lambda: rid.plot.bode(FRF, FIT), "bode(..., models=...)"),
    (lambda: FRF.tangential([1.0]), "tangential(right=...)"),
    (lambda: RECORD.window(0, 1, "known"), "window(..., past='known')"),
    (lambda: rid.prepare.multisine((1, 30)), "multisine(period=...)"),
    (lambda: rid.identify(RESULT.problem, "gain"), "identify(..., objective='gain')"),
    (lambda: rid.fit_mfd(FRF, ordr=2), "do you mean `order`?"),
    (lambda: rid.TimeRecord([1.0], [1.0], dt=1.0, bnd=1), "do you mean `bound`?"),
    (lambda: rid.FrequencyResponse(OMEGA, FRF.values, covarianc=1), "do you mean `covariance`?"),
    (lambda: rid.Prior(K=2.0, rho=1.1), "It has gain_bound, decay_rate"),
]


@pytest.mark.parametrize(("call", "said"), CALLS, ids=[said for _, said in CALLS])
def test_an_argument_without_its_name_is_told_its_name(call, said):
    with pytest.raises(InputTypeError, match=re.escape(said)):
        call()


def test_signatures_help_and_processes_are_as_they_were():
    assert list(inspect.signature(rid.fit_mfd).parameters)[:3] == ["frf", "order", "domain"]
    assert list(inspect.signature(rid.FrequencyResponse).parameters)[:3] == ["omega", "values", "bound"]
    assert list(inspect.signature(rid.TimeRecord.window).parameters) == ["self", "start", "stop", "past"]
    assert rid.fit_mfd.__doc__.startswith("Fit a matrix fraction")
    for thing in (rid.fit_mfd, rid.FrequencyResponse, rid.guarantee.coprime, rid.plot.bode, rid.design.PID):
        assert pickle.loads(pickle.dumps(thing)) is thing
    with pytest.raises(TypeError, match="missing 1 required keyword-only argument: 'order'"):
        rid.fit_mfd(FRF)


def test_identify_of_data_alone_names_what_takes_them():
    with pytest.raises(
        InputTypeError, match=r"`problem` must be a MixedProblem; got FrequencyResponse.*identify_reduced"
    ):
        rid.identify(FRF)
    with pytest.raises(InputTypeError, match=r"got int$"):
        rid.identify(3)


# Ten jobs and eight of loops and fleets: what an engineer types first; the answer must be that, or a message whose name works.
JOBS = {
    "load": ["rid.load", "rid.read_csv", "rid.load_csv", "rid.read"],
    "response from noise": ["rid.estimate_frf", "rid.tfestimate", "rid.frf", "record.frf"],
    "fit": ["rid.fit_mfd", "rid.fit", "rid.vectfit", "rid.tfest", "frf.fit"],
    "modes": ["fit.modes", "rid.modes", "rid.damp", "fit.damping"],
    "export": ["rid.save", "rid.export", "rid.to_matlab", "rid.export_c", "rid.to_spice", "fit.export"],
    "bound": ["rid.estimate_bound", "rid.error_bound", "rid.noise_level", "result.bounds"],
    "design": ["rid.design_controller", "rid.hinf", "rid.pidtune", "rid.hinfsyn"],
    "margin": ["rid.loop_bounds", "rid.margins", "rid.diskmargin", "rid.stability_margins"],
    "compare two records": ["rid.compare", "rid.diff", "rid.compare_records", "record.compare"],
    "controller": ["rid.design_controller", "rid.pid", "rid.tune_pid", "rid.design_pid", "rid.notch", "rid.lead_lag"],
    "limits": ["rid.design.Limits", "rid.limits", "rid.specs"],
    "loop": ["rid.Loop", "rid.loop", "rid.closed_loop", "rid.feedback", "rid.loop_response"],
    "loop of every plant": [
        "rid.loop_bounds",
        "rid.robust_stability",
        "rid.stability",
        "rid.step_envelope",
        "rid.nugap",
    ],
    "two parts": ["rid.interconnection", "rid.connect", "rid.interconnect", "rid.impedance_ratio"],
    "watch": ["rid.watch", "rid.monitor", "rid.drift", "rid.anomaly", "rid.alarm", "rid.changed"],
    "fleet": ["rid.run", "rid.fleet", "rid.batch", "rid.run_all"],
    "setups": ["rid.advise.common_modes", "rid.common_modes", "rid.setups", "rid.merge", "rid.compare_modes"],
    "plot": ["frf.plot", "record.plot", "rid.bode", "rid.plot_bode", "frf.bode", "rid.plot.bode"],
}


def looked_up(spelling):
    """Object of a spelling, found at once or by the name in the message; how many attempts that took."""
    for attempt in (1, 2):
        first, *names = spelling.split(".")
        found = {"rid": rid, "robustid": rid, "frf": FRF, "record": RECORD, "fit": FIT, "result": RESULT}[first]
        try:
            for name in names:
                found = getattr(found, name)
        except AttributeError as error:
            spelling = re.search(r"; ([\w.]+)(\(.*\))? is what you look for", str(error))[1]
        else:
            return found, attempt
    return None, 3


@pytest.mark.parametrize(("job", "spelling"), [(job, one) for job, spellings in JOBS.items() for one in spellings])
def test_each_job_is_found_in_two_attempts(job, spelling):
    found, attempts = looked_up(spelling)
    assert attempts <= 2
    assert callable(found) or job == "modes"


@pytest.mark.parametrize(
    ("typed", "command"),
    [
        ("monitor", "watch"),
        ("fit-model", "fit"),
        ("plot", "report"),
        ("bode", "report"),
        ("vectfit", "fit"),
        ("N4SID", "fit"),
        ("moniter", "watch"),
        ("estimate-frf", "frf"),
        ("tfestimate", "frf"),
        ("chirp", "excite"),
        ("load", "look"),
        ("balred", "reduce"),
        ("margins", "loop"),
        ("pidtune", "control"),
        ("hinfsyn", "control"),
        ("save", "export"),
        ("to-c", "export"),
        ("diff", "compare"),
        ("falsify", "refute"),
        ("proof", "verify"),
        ("gui", "explore"),
        ("mcp", "serve"),
        ("batch", "run"),
        ("fti", None),  # near a command: told by the parser itself
        ("xyzzy", None),
    ],
)
def test_words_of_the_field_lead_on_to_commands(typed, command):
    assert command_meant(typed) == command


def test_the_commands_that_are_meant_are_those_that_there_are(capsys, monkeypatch):
    assert set(_COMMANDS) == set(COMMANDS)
    known = rid._known().values()
    unknown = [word for words in _COMMANDS.values() for word in words.split() if "." in word and word not in known]
    assert [word for word in unknown if not word.startswith("plot.")] == []
    code, _, err = words(["monitor"], capsys, monkeypatch)
    assert code == 2
    assert "No such command 'monitor'; robustid watch is what you look for: Watch a machine" in re.sub(
        r"[│\s]+", " ", err
    )


def test_what_the_ten_jobs_find_does_them(tmp_path):
    """The same ways, carried out: files of others, figures, numbers."""
    (tmp_path / "frf.csv").write_text(
        "frequency [Hz],real,imag\n"
        + "\n".join(f"{w / 2 / np.pi},{v.real},{v.imag}" for w, v in zip(OMEGA, FRF.values[:, 0, 0], strict=True))
    )
    frf = rid.load(tmp_path / "frf.csv")
    rng = np.random.default_rng(0)
    u = rng.standard_normal(600)
    plant = control.ss(control.tf([0.1, 0.05], [1.0, -1.6, 0.9], 0.01))
    records = [
        rid.TimeRecord(u, control.forced_response(plant, inputs=u).outputs + 0.01 * rng.standard_normal(600), dt=0.01)
        for _ in range(2)
    ]
    fit = rid.fit_mfd(frf, order=2)
    assert fit.modes[0].hz == pytest.approx(4 / 2 / np.pi, rel=1e-6)
    assert fit.modes.to_dataframe().shape[0] == 1
    discrete = rid.fit_mfd(rid.estimate_frf(records[0]), order=2)
    for name, thing in {"plant.m": fit, "plant.h": discrete, "plant.zpk": fit}.items():
        rid.save(tmp_path / name, thing)
        assert (tmp_path / name).stat().st_size
    assert isinstance(rid.estimate_bound(frf), rid.FrequencyResponse)
    assert not rid.compare(*records).differ
    for thing in (frf, records[0], fit):
        assert thing.plot().axes
    assert frf.plot(models=fit).axes[0].get_legend_handles_labels is not None
