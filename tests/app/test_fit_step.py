"""[fit] in a run file: the modes of a matrix fraction, kept beside the results, and again from the run file that is written."""

import tomllib

import numpy as np
import pytest

import robustid as rid
from robustid.errors import InputError
from support.run_files import DATA, QUICK, ask

PRIOR = {"prior": {"gain_bound": 0.2, "decay_rate": 1.1}}


@pytest.mark.usefixtures("unreduced", "unpaged")
def test_the_modes_of_a_fit_are_those_of_the_class(folder):
    """Both modes of the structure, with their box; the run file in the folder gives the same again without a fit."""
    result = rid.run(ask(folder, DATA, PRIOR, QUICK, {"fit": {"order": 4, "modal": "proportional"}}), "out")
    modes = result.run_file.modes
    np.testing.assert_allclose(modes.hz, [9.0, 17.67], rtol=0.01)
    for value, ends in zip(modes.hz, modes.hz_interval, strict=True):
        assert ends[0] < value < ends[1]
    assert "a matrix fraction of order 4, weighted by" in result.choices["modes"].reason
    fit = rid.load("out/fit")
    assert fit.modal.damping == "proportional"
    hz = sorted(row.hz for row in rid.fits.mode_table(fit))
    np.testing.assert_array_equal(hz, modes.hz)
    assert tomllib.loads((folder / "out" / "run.toml").read_text(encoding="utf-8"))["fit"]["order"] == 4
    again = rid.run(folder / "out" / "run.toml", "again")
    assert again.identification.margin == result.identification.margin
    assert not (folder / "again" / "fit.npz").exists()


@pytest.mark.usefixtures("unreduced", "unpaged")
def test_the_order_is_that_of_a_sweep_within_its_time(folder):
    told = []
    result = rid.run(
        ask(folder, DATA, PRIOR, QUICK, {"fit": {"order": "auto", "time_limit": 5.0}}),
        "out",
        progress=lambda text, *_: told.append(text),
    )
    assert result.run_file.fit.order == 4
    assert "(orders " in result.choices["modes"].reason
    assert "fitting a range of orders" in told


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"fit": {"order": 5, "modal": "general"}}, r"\[fit\]: `order` must be even"),
        ({"fit": {"order": 900}}, r"\[fit\]: "),
        ({"fit": {"order": 4}, "frequency": [], "prior": {}}, r"\[fit\] needs a frequency response"),
        ({"fit": {"order": 8, "rigid_body": 2}}, r"\[fit\]"),
    ],
)
def test_a_fit_that_cannot_be_is_one_sentence(folder, change, words):
    with pytest.raises(InputError, match=words):
        rid.run(ask(folder, DATA, PRIOR, QUICK, change), "out")
