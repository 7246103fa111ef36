"""What the examples find, as proof files: the checker in C proves all that the format expresses."""

import sys
from collections.abc import Callable
from typing import Any

import pytest

import robustid as rid
from robustid.errors import InputError
from robustid.guarantees import proof_texts
from support.example_runs import FOLDER
from support.example_runs import load as load_example
from support.measured import needs

# Examples of one entry, and what of theirs the format does not express.
EXAMPLES: dict[str, tuple[str, ...]] = {
    "continuous_time": (),
    "controller_levitation": (),
    "controller_motor": (),
    "controller_stage": (),
    "flexible_structure": (),
    "motor_torsion": ("at rest",),
    "passive_beam": ("bounds a passive class",),
    "proved_band": (),
    "short_records": ("several inputs",),
    "torsion_margin": (),
    "voorhoeve2016": (),
    "worst_case": (),
}
MEASURED = {"controller_motor", "motor_torsion", "torsion_margin"}


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
def test_what_the_examples_find_is_proved(proved, tmp_path, monkeypatch, name):
    if name in MEASURED:
        needs("two_mass/MultisineTypeA.mat")
    found: list[Any] = []

    def keeping(made: Callable[..., Any]) -> Callable[..., Any]:
        def kept(*given: Any, **named: Any) -> Any:
            found.append(made(*given, **named))
            return found[-1]

        return kept

    kept = (rid, "identify"), (rid, "worst_case_error"), (rid, "band"), (rid, "loop_bounds"), (rid, "design_controller")
    for owner, made in (*kept, (rid.guarantee, "contradiction")):
        monkeypatch.setattr(owner, made, keeping(getattr(owner, made)))
    monkeypatch.syspath_prepend(FOLDER)
    monkeypatch.setattr(sys, "argv", [name, "--out", str(tmp_path)])
    main = load_example(name).main
    main(sys.argv[1:]) if main.__code__.co_argcount else main()
    texts: list[str] = []
    refusals: list[str] = []
    for one in found:
        try:
            texts += proof_texts(one)
        except InputError as refusal:
            refusals.append(str(refusal))
    assert all(any(reason in one for reason in EXAMPLES[name]) for one in refusals), refusals
    assert texts
    for text in texts:
        proved(text, seconds=600)
