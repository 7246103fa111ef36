"""Options are stated once: the run file, the arguments of Python and the command line say the same of each."""

import inspect
import json

import pytest

import robustid as rid
from robustid.app.cli.experiment import excite
from robustid.app.cli.fit import fit
from robustid.app.cli.reduce import reduce
from robustid.app.run.checks import options
from robustid.app.run.settings import PARTS, Fit, Identify, Modes, WorstCase

pytestmark = pytest.mark.quick
ALL = [(kind, field, option) for kind in PARTS.values() for field, option in options(kind)]


def test_every_default_passes_its_own_check_and_every_option_is_explained():
    for kind, field, option in ALL:
        assert len(option.sentence) > 10, (kind, field.name)
        assert option.sentence.endswith("."), (kind, field.name)
        if field.default is not None:
            assert option.check(field.name, field.default) == field.default


@pytest.mark.parametrize(
    ("command", "kinds"),
    [("identify", ("", "[[record]]", "[[frequency]]", "[frequency_points]", "[modes]", "[prior]", "[identify]"))],
)
def test_help_of_a_command_says_what_the_description_says(run, command, kinds):
    _, out, _ = run([command, "--help"])
    text = " ".join(out.replace("│", " ").split())
    for kind in kinds:
        for field, option in options(PARTS[kind]):
            if option.flag:
                assert f"{option.flag} " in text
                assert option.sentence.split(":")[0] in text, field.name


def test_keys_of_a_run_file_are_listed_with_unit_and_default(run):
    code, out, _ = run(["run", "--keys"])
    assert code == 0
    text = " ".join(out.split())
    for place in PARTS:
        assert place in text
    for _, field, option in ALL:
        assert f"{field.name} {option.sentence}"[:70] in text
        if option.unit:
            assert f"In {option.unit}." in text
        if field.default is not None:
            assert f"Default {json.dumps(field.default)}." in text


def test_arguments_of_identify_reduced_are_those_of_the_run_file():
    signature = inspect.signature(rid.identify_reduced).parameters
    stated = [(field, option) for _, field, option in ALL if option.keyword]
    assert {option.keyword for _, option in stated} <= set(signature)
    for field, option in stated:
        parameter = signature[option.keyword]
        assert parameter.kind is inspect.Parameter.KEYWORD_ONLY
        assert (parameter.default, parameter.annotation) == (field.default, field.type)
        assert f"    {option.keyword} : {field.type}, default {field.default!r}" in rid.identify_reduced.__doc__
    assert "{options}" not in rid.identify_reduced.__doc__


def test_options_of_a_fit_have_the_defaults_of_the_library():
    theirs = inspect.signature(rid.fit_mfd).parameters
    assert Fit().arguments == {name: theirs[name].default for name in Fit().arguments}


@pytest.mark.parametrize(
    ("stated", "error", "words"),
    [
        ({"objectiv": "gain"}, rid.errors.InputTypeError, "no argument 'objectiv'; the nearest is 'objective'"),
        ({"repeat": 0}, rid.InputError, "`repeat` must be at least 1; got 0"),
        ({"directions": 2}, rid.InputError, "`directions` must be at least 3; got 2"),
        ({"accuracy": "fine"}, rid.errors.InputTypeError, "`accuracy` must be a number; got 'fine'"),
        ({"worst_case": 1}, rid.errors.InputTypeError, "`worst_case` must be true or false; got 1"),
        ({"form": "best"}, rid.InputError, "`form` must be one of auto, orthonormal"),
    ],
)
def test_wrong_arguments_are_refused_by_their_own_name(stated, error, words):
    with pytest.raises(error, match=words):
        rid.identify_reduced(rid.datasets.flexible_structure(lines=5).frequency, **stated)


@pytest.mark.parametrize(
    ("command", "function", "names"),
    [
        (
            excite,
            rid.prepare.multisine,
            "spacing lines_per_decade inputs realisations periods amplitude rms minimise_crest seed",
        ),
        (fit, rid.fit_mfd, "form domain"),
        (reduce, rid.balanced_truncation, "order tol horizon weight"),
    ],
)
def test_defaults_of_commands_are_those_of_the_library(command, function, names):
    ours, theirs = inspect.signature(command).parameters, inspect.signature(function).parameters
    for name in names.split():
        assert ours[name].default in (theirs[name].default, None), name


def test_sections_left_alone_ask_for_what_the_library_does_by_itself():
    library = inspect.signature(rid.identify).parameters
    assert Identify().arguments == {name: library[name].default for name in Identify().arguments}
    bounds = inspect.signature(rid.worst_case_error).parameters
    assert (WorstCase().directions, WorstCase().rtol) == (bounds["directions"].default, bounds["rtol"].default)
    assert Modes().repeat == inspect.signature(rid.suggest_kautz).parameters["repeat"].default
