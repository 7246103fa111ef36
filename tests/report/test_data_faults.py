"""A fault of the data stands before every verdict, with what undoes it, until it is undone."""

import numpy as np
import pytest

import robustid as rid
from robustid.data import Fault, FaultKind, PlacedFault, Undoing
from robustid.fitting import fit_mfd
from robustid.report.data_faults import fault_verdict, undoing_steps
from robustid.report.first_screen import glance
from robustid.report.fit_page import fit_page, fit_summary
from robustid.report.fit_view import FitView
from robustid.report.identification_page import identification_page, identification_summary, identification_verdict
from robustid.report.live import live_words
from robustid.report.notebook import _head
from robustid.report.response_charts import ResponseView
from robustid.report.response_page import response_page, response_summary
from support.faulty_files import response


@pytest.fixture(scope="module", params=[0.3, 0.0], ids=["off", "clean"])
def identified(request):
    problem = rid.MixedProblem(frequency=response(request.param), prior=rid.Prior(gain_bound=20.0, decay_rate=1.05))
    return rid.identify(problem), bool(request.param)


def is_first(blocks, faulty):
    """The first verdict is on the fault, and no other one is."""
    verdicts = [block for block in blocks if getattr(block, "key", None) is not None]
    assert [one.id == "data-fault" for one in verdicts] == [faulty] + [False] * (len(verdicts) - 1)
    assert not faulty or verdicts[0].key == "undecided"


def test_it_stands_before_the_verdict_on_the_class(identified):
    result, faulty = identified
    is_first(identification_page(result, None, {}).head, faulty)
    is_first(identification_summary(result), faulty)
    is_first(_head(result).head, faulty)
    assert result.consistent
    assert not faulty or live_words(result)[0] == "undecided"


def test_it_stands_before_the_verdict_on_a_response_and_on_a_fit():
    for off in (0.3, 0.0):
        frf, faulty = response(off), bool(off)
        is_first(response_page(frf, None, {}).head, faulty)
        is_first(response_summary(ResponseView(frf)), faulty)
        is_first(_head(frf).head, faulty)
        fit = fit_mfd(frf, order=2)
        is_first(fit_page(fit, None, {"data": frf}).head, faulty)
        is_first(fit_summary(FitView(fit, frf)), faulty)


@pytest.mark.parametrize(
    ("fault", "kind", "words"),
    [
        (Fault(FaultKind.OUTLIER, "off", correction="leave out 16.978 50"), "frequency", "--frequency-correct"),
        (Fault(FaultKind.SIGN, "off", correction="negate", where="output y"), "time", "--time-correct"),
        (Fault(FaultKind.OFFSET, "off", correction="detrend", where="output y"), "frequency", "--time-correct"),
    ],
)
def test_where_no_command_is_known_the_correction_is_offered_with_what_takes_it(fault, kind, words):
    (step,) = undoing_steps([PlacedFault(fault, kind, 0)], None)
    assert f'{words} "{fault.correction}"' in step.code
    assert f'correct = ["{fault.correction}"]' in step.code
    told = Undoing(fault, "robustid identify")
    assert undoing_steps([PlacedFault(fault, kind, 0)], told)[0].code == ("robustid identify",)


def test_what_is_guaranteed_of_them_says_so_where_its_number_stands(identified, monkeypatch):
    """On the page and at the terminal; with what the band leaves out."""
    result, faulty = identified
    said = ", from data with a fault"
    model = rid.balanced_truncation(result.model, order=2).model  # of a large one the bound on the axis takes seconds
    small = rid.band(result, omega=2 * np.pi * np.array([2.0, 30.0])).with_model(model)
    sweep = rid.worst_case_error(result, model=model, omega=2 * np.pi * np.array([2.0, 30.0]), directions=4)
    for name, part, beside in (("band", small, ""), ("worst_case", sweep, ", at 2 frequencies")):
        numbers = glance(result, "", {name: part}).numbers
        labels = [label for label, value in numbers if value.startswith("≤")]
        assert labels[0] == f"guaranteed error, order 2{beside}{said * faulty}"
        assert [label.endswith(said) for label in labels] == [faulty] * 2
        assert (said in part.summary().splitlines()[0]) == faulty
    assert (said in result.summary().splitlines()[0]) == faulty
    monkeypatch.setattr(rid.guarantee.Band, "open_ranges", ((2 * np.pi * 11.0, 2 * np.pi * 12.0),))
    small = small.with_model(model)
    label = glance(result, "", {"band": small}).numbers[1][0]
    assert label == f"guaranteed error, order 2, but from 11 to 12 Hz{said * faulty}"
    assert "at every frequency but from 11 to 12 Hz" in small.summary().splitlines()[0]
    assert (f"Consistent{said}" in identification_verdict(result).word) == faulty


def test_a_drift_that_is_removed_is_no_verdict_and_further_faults_are_counted():
    drift, off = Fault(FaultKind.DRIFT, "drifts"), Fault(FaultKind.OUTLIER, "off")
    assert fault_verdict([drift]) == []
    assert fault_verdict([drift, off])[0].sentence == "Off."
    assert dict(fault_verdict([off, drift, off._replace(words="also off")])[0].numbers)["further faults"].startswith(
        "1,"
    )
