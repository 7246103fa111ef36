"""Passive classes from the command line and from run files."""

import numpy as np
import pytest

import robustid as rid
from robustid.app.prior_options import PriorChoice, prior_keys


def write(path, values, omega):
    rows = zip(omega / (2 * np.pi), values.real, values.imag, strict=True)
    path.write_text("frequency_hz,re,im,bound\n" + "\n".join(f"{f},{a},{b},1e-3" for f, a, b in rows) + "\n")


def test_keys_of_a_passive_class_are_those_that_state_it():
    for prior in (rid.PositiveReal(decay=3.0, slack=0.1), rid.BoundedReal(decay_rate=1.1)):
        keys = prior_keys(prior)
        assert "gain_bound" not in keys
        assert PriorChoice(**keys).stated(None) == prior


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"passive": "positive real"}, "without decay"),
        ({"passive": "positive real", "decay": 1.0, "gain_bound": 2.0}, "gain_bound has no meaning with passive"),
        ({"passive": "bounded real", "decay": 1.0, "roll_off": 2, "corner_hz": 1.0}, "roll_off has no meaning"),
        ({"gain_bound": 1.0, "decay": 1.0, "slack": 0.1}, "slack belongs to passive"),
    ],
)
def test_what_a_passive_class_has_no_use_for_is_refused(given, words):
    names = {"gain_bound": "gain_bound", "passive": "passive"}
    with pytest.raises(rid.InputError, match=words):
        PriorChoice(**given).check(names)


def test_a_run_file_with_a_passive_class(tmp_path):
    omega = np.linspace(5, 60, 10)
    s = 1j * omega
    write(tmp_path / "frf.csv", 1 / (s + 20) + 0.5 * (s + 5) / ((s + 5) ** 2 + 900), omega)
    text = '[[frequency]]\nfile = "frf.csv"\n[prior]\npassive = "positive real"\ndecay = 4.0\n[worst_case]\nat_hz = [4.0]\n'
    (tmp_path / "run.toml").write_text(text)
    found = rid.run(tmp_path / "run.toml", tmp_path / "out")
    assert found.consistent
    assert found.identification.prior.positive_real
    again = rid.run(tmp_path / "out" / "run.toml", tmp_path / "again")
    assert again.identification.margin == found.identification.margin
    assert "passive" in (tmp_path / "out" / "report.html").read_text()
