"""Responses of several signals from columns that are called by output and input."""

import numpy as np
import pytest

import robustid as rid

HZ = np.linspace(1.0, 9.0, 9)
VALUES = np.exp(-1j * HZ[:, None] * np.arange(1, 5)) * np.arange(1, 5)  # of four entries
RECTANGULAR, DECIBELS = ("real", "imag"), ("dB", "deg")


def written(path, names, columns):
    np.savetxt(path, np.column_stack([HZ, *columns]), delimiter=",", header=",".join(["f [Hz]", *names]), comments="")
    return path


def parts(value, kind):
    if kind is RECTANGULAR:
        return [value.real, value.imag]
    return [20 * np.log10(np.abs(value)), np.angle(value, deg=True)]


@pytest.mark.parametrize("kind", [RECTANGULAR, DECIBELS])
@pytest.mark.parametrize(
    ("entries", "outputs", "inputs"),
    [
        (["y1/u1", "y1/u2", "y2/u1", "y2/u2"], ["y1", "y2"], ["u1", "u2"]),
        (["acc 1/force", "acc 2/force", "acc 3/force"], ["acc 1", "acc 2", "acc 3"], ["force"]),
        (["tip/motor"], ["tip"], ["motor"]),
    ],
)
def test_a_quotient_of_names_is_an_entry(entries, outputs, inputs, kind, tmp_path):
    names = [f"{one} {part}" for one in entries for part in kind]
    columns = [part for value in VALUES.T[: len(entries)] for part in parts(value, kind)]
    found = rid.load(written(tmp_path / "a.csv", names, columns))
    assert [one.name for one in found.outputs] == outputs
    assert [one.name for one in found.inputs] == inputs
    shape = found.values.shape
    np.testing.assert_allclose(found.values, VALUES[:, : len(entries)].reshape(shape), rtol=1e-12)


def test_functions_of_quotients_and_units_that_are_quotients(tmp_path):
    columns = [part for value in VALUES.T[:2] for part in (value.real, value.imag)]
    found = rid.load(written(tmp_path / "a.csv", ["Re(x/F)", "Im(x/F)", "Re(z/F)", "Im(z/F)"], columns))
    assert ([one.name for one in found.outputs], found.inputs[0].name) == (["x", "z"], "F")
    np.testing.assert_allclose(found.values[:, :, 0], VALUES[:, :2])
    names = [f"acc {k} {part} [um/N]" for k in (1, 2) for part in RECTANGULAR]
    found = rid.load(written(tmp_path / "b.csv", names, columns))
    assert [(one.name, one.unit) for one in found.outputs] == [("acc 1", "um"), ("acc 2", "um")]
    assert found.inputs[0].unit == "N"


@pytest.mark.parametrize(
    "names",
    [
        ["acc real", "acc imag", "force real", "force imag"],  # spectra of two signals
        ["y1/u1 real", "y1/u1 imag", "y2/u2 real", "y2/u2 imag"],  # two entries of four
        ["y1/u1 real", "y1/u1 imag", "y2/u1 real", "y2/u1 phase [deg]"],
    ],
)
def test_what_makes_no_whole_response_is_asked_about(names, tmp_path):
    columns = [part for value in VALUES.T[:2] for part in (value.real, value.imag)]
    with pytest.raises(rid.InputError, match="needs 'values'"):
        rid.load(written(tmp_path / "a.csv", names, columns))
