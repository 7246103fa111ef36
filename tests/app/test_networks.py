"""Touchstone and SPICE files: what is written is read back, and simulates as the model."""

import shutil
import subprocess

import control
import numpy as np
import pytest

import robustid as rid
from robustid.core import response_at
from robustid.errors import InputError, InputTypeError
from support.networks import foster, rc_ladder, scattering
from support.nodal import port_impedances

OMEGA = np.geomspace(0.1, 1e3, 30)


def values(model, omega=OMEGA):
    return response_at((model.A, model.B, model.C, model.D), 1j * omega)


def waves(impedance, reference):
    eye = np.eye(impedance.shape[1])
    return (impedance - reference * eye) @ np.linalg.inv(impedance + reference * eye)


@pytest.mark.parametrize("ports", [1, 2, 3, 5])
def test_touchstone_comes_back(tmp_path, ports):
    pytest.importorskip("skrf")
    rng = np.random.default_rng(ports)
    data = rid.FrequencyResponse(
        OMEGA, rng.standard_normal((30, ports, ports)) + 1j * rng.standard_normal((30, ports, ports))
    )
    path = tmp_path / f"net.s{ports}p"
    rid.save(path, data)
    again = rid.load(path)
    assert np.array_equal(again.values.reshape(data.values.shape), data.values)
    np.testing.assert_allclose(again.omega, OMEGA, rtol=1e-15)
    assert "# Hz S RI R 50\n" in path.read_text()


def test_impedances_and_models_are_written_as_scattering(tmp_path):
    skrf = pytest.importorskip("skrf")
    model = foster(np.random.default_rng(0), 3, 2, resistance=0.5)
    impedance = values(model)
    for parameter, matrix in (("z", impedance), ("y", np.linalg.inv(impedance))):
        rid.save(tmp_path / "data.s2p", rid.FrequencyResponse(OMEGA, matrix), parameter=parameter, reference=75.0)
        np.testing.assert_allclose(rid.load(tmp_path / "data.s2p").values, waves(impedance, 75.0), atol=1e-12)
    rid.save(tmp_path / "model.s2p", model, parameter="z", reference=2.0, omega=OMEGA)
    network = skrf.Network(str(tmp_path / "model.s2p"))
    np.testing.assert_allclose(network.s, waves(impedance, 2.0), atol=1e-12)
    np.testing.assert_allclose(network.z, impedance, rtol=1e-9, atol=1e-9)
    assert np.all(network.z0 == 2.0)


@pytest.mark.parametrize("reference", [1.0, 50.0])
def test_subcircuits_have_the_impedance_of_the_model(tmp_path, reference):
    two_port = foster(np.random.default_rng(1), 3, 2, resistance=0.5)
    for number, impedance in enumerate((rc_ladder(4), two_port)):
        path = tmp_path / f"net {number}.cir"
        rid.save(path, impedance, parameter="z", reference=reference)
        np.testing.assert_allclose(port_impedances(path.read_text(), OMEGA), values(impedance), rtol=1e-9, atol=1e-9)
        rid.save(
            path,
            scattering(impedance, reference) if number == 0 else impedance,
            parameter="sz"[number],
            reference=reference,
        )
        np.testing.assert_allclose(port_impedances(path.read_text(), OMEGA), values(impedance), rtol=1e-8, atol=1e-8)
    admittance = control.StateSpace(-3.0, 2.0, 1.0, 0.25, 0)  # R, L beside a resistor
    rid.save(tmp_path / "y.sp", admittance, parameter="y", reference=reference)
    np.testing.assert_allclose(
        port_impedances((tmp_path / "y.sp").read_text(), OMEGA), 1 / values(admittance), rtol=1e-9
    )


@pytest.mark.skipif(shutil.which("ngspice") is None, reason="ngspice is not installed")
def test_ngspice_simulates_the_same(tmp_path):
    impedance, w = rc_ladder(3), 2 * np.pi * 0.25
    rid.save(tmp_path / "ladder.cir", impedance, parameter="z")
    deck = (
        "test\n.include ladder.cir\nX1 in 0 ladder\nI1 0 in DC 0 AC 1\n.control\nac lin 1 0.25 0.25\n"
        "print vr(in) vi(in)\n.endc\n.end\n"
    )
    (tmp_path / "deck.cir").write_text(deck)
    said = subprocess.run(
        ["ngspice", "-b", "deck.cir"], cwd=tmp_path, capture_output=True, text=True, check=False
    ).stdout
    found = [float(line.split("=")[1]) for line in said.splitlines() if line.startswith(("vr(in)", "vi(in)"))]
    np.testing.assert_allclose(complex(*found), values(impedance, [w])[0, 0, 0], rtol=1e-5)


@pytest.mark.parametrize(
    ("name", "thing", "options", "message"),
    [
        ("a.s2p", rid.FrequencyResponse([1.0], [1.0]), {}, r"`path` must end in \.s1p"),
        ("a.s1p", rid.FrequencyResponse([1.0], [1.0], dt=0.1), {}, "continuous time; got dt = 0.1"),
        ("a.s1p", rid.FrequencyResponse([1.0], np.ones((1, 1, 2))), {}, "as many outputs as inputs"),
        ("a.s1p", control.StateSpace(-1.0, 1.0, 0.5, 0.0, 0), {}, "`omega` is needed"),
        ("a.s1p", control.StateSpace(-1.0, 1.0, 0.5, 0.0, 0), {"omega": [2.0, 1.0]}, "that increase"),
        ("a.cir", control.StateSpace(-1.0, 1.0, 3.0, 0.0, 0), {}, r"isn't passive.*is 3 at 0 Hz\. make_passive"),
        ("a.cir", control.StateSpace(0.5, 1.0, 0.5, 0.0, 0.1), {}, "continuous time; got dt = 0.1"),
        ("a.cir", rid.FrequencyResponse([1.0], [1.0]), {}, "made of a model"),
        ("a.cir", control.StateSpace(-1.0, 1.0, 0.5, 0.0, 0), {"reference": -50.0}, "`reference` must be positive"),
        (
            "a.cir",
            control.StateSpace(-1.0, 1.0, 0.5, 0.0, 0),
            {"parameter": "h"},
            '`parameter` must be "s", "z" or "y"',
        ),
        ("a.csv", rid.FrequencyResponse([1.0], [1.0]), {"reference": 50.0}, "`reference` is for Touchstone"),
    ],
)
def test_misuse_is_refused_in_a_sentence(tmp_path, name, thing, options, message):
    with pytest.raises(InputError, match=message):
        rid.save(tmp_path / name, thing, **options)
    assert not (tmp_path / name).exists()


def test_other_objects_are_refused(tmp_path):
    with pytest.raises(InputTypeError, match=r"FrequencyResponse or a control\.StateSpace for this ending; got int"):
        rid.save(tmp_path / "a.s1p", 3)
