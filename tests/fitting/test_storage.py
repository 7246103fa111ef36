"""A saved fit comes back exactly, evaluates and draws, and its cost and state space are verified again."""

import functools
import pickle

import control
import numpy as np
import pytest

import robustid as rid
from support.forging import forge
from support.mfd_systems import noisy, random_modal_system

OMEGA = 2 * np.pi * np.geomspace(4, 1200, 30)
SYSTEM = random_modal_system(3, 2, 2, 2, band_hz=(5, 1000), damping=(0.005, 0.02))
FREE = SYSTEM.response(1j * OMEGA)
RIGID = FREE + 1e5 * np.outer([1.0, 0.2], [1.0, -0.3]) / (1j * OMEGA[:, None, None]) ** 2
FITS = {
    "plain": (FREE, {}),
    "left, constrained": (FREE, {"form": "left", "constraints": [rid.fits.RollOff(2)]}),
    "static gain": (FREE, {"constraints": [rid.fits.StaticGain(SYSTEM.response(np.zeros(1))[0].real)]}),
    "rigid body": (RIGID, {"order": 6, "rigid_body": rid.RigidBody(1)}),
    "feed-through": (FREE, {"feedthrough": True}),
    "shared poles": (FREE, {"form": "shared"}),
    "modes, rigid body": (
        RIGID,
        {"order": 6, "rigid_body": 1, "modal": rid.fits.Modal("proportional", symmetric=True)},
    ),
}


@functools.cache
def fitted(case="plain"):
    truth, options = FITS[case]
    values = noisy(np.random.default_rng(1), truth, 0.01)
    spread = 1e-4 * np.abs(truth.transpose(0, 2, 1).reshape(-1, 4)) ** 2
    frf = rid.FrequencyResponse(OMEGA, values, covariance=spread[:, :, None] * np.eye(4), dof=12.0)
    return rid.fit_mfd(frf, **{"order": 4, "restart": False, **options})


@pytest.mark.parametrize("case", FITS)
def test_a_fit_comes_back_as_it_was(case, tmp_path):
    fit = fitted(case)
    fit.save(tmp_path / "fit")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["fit.json", "fit.npz"]
    again = rid.load(tmp_path / "fit")
    omega = np.geomspace(10, 5000, 7)
    for name in ("cost", "start_cost", "status", "reflected", "weight_choice", "stable"):
        assert getattr(again, name) == getattr(fit, name), name
    assert repr(again.modal) == repr(fit.modal)
    np.testing.assert_array_equal(again.fraction.response(omega), fit.fraction.response(omega))
    np.testing.assert_array_equal(again.denominator(1j * omega), fit.denominator(1j * omega))
    np.testing.assert_array_equal(again.poles, fit.poles)
    np.testing.assert_array_equal(again.model.A, fit.model.A)
    np.testing.assert_array_equal(again.condition_numbers, fit.condition_numbers)
    np.testing.assert_array_equal(rid.fits.fit_covariance(again).pole_std, rid.fits.fit_covariance(fit).pole_std)
    assert repr(again) == repr(fit)


def test_it_draws_reports_and_pickles(tmp_path):
    fit = fitted()
    rid.save(tmp_path / "fit", fit)
    again = rid.load(tmp_path / "fit.json")
    assert len(again.plot().axes) == len(fit.plot().axes)
    rid.write_report(again, tmp_path / "fit.html")
    assert "degrees of freedom" in (tmp_path / "fit.html").read_text(encoding="utf-8")
    assert pickle.loads(pickle.dumps(again)).cost == fit.cost


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda text: text.update(cost=0.5 * text["cost"]), "its cost is"),
        (lambda text: text["fraction"].update(scale=2 * text["fraction"]["scale"]), "state-space model"),
        (lambda text: text.pop("nodes"), "edited since: the field 'nodes'"),
        (lambda text: text.update(modal={"$class": "Popen"}), "'Popen', which is no class that can be stored"),
        (lambda text: text.update(problem=text["nodes"]), "'problem' of its MatrixFraction can't be a NodeFraction"),
    ],
)
def test_edited_files_are_refused(tmp_path, edit, words):
    fitted().save(tmp_path / "fit")
    forge(tmp_path / "fit", text=edit)
    with pytest.raises(rid.errors.FileFormatError, match=words):
        rid.load(tmp_path / "fit")


def test_a_fit_without_its_text_is_named_as_a_result(tmp_path):
    fitted().save(tmp_path / "fit")
    (tmp_path / "fit.json").unlink()
    with pytest.raises(rid.errors.FileFormatError, match=r"fit\.json is missing"):
        rid.load(tmp_path / "fit.npz")


def test_the_names_that_fingers_try_first():
    fit = fitted()
    assert isinstance(fit.to_control(), control.StateSpace)
    np.testing.assert_allclose(np.sort_complex(fit.poles), np.sort_complex(fit.to_control().poles()), rtol=1e-8)
    with pytest.raises(AttributeError):
        fit.cost = 0.0
