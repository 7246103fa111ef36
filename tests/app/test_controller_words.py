"""Structures and goals as text: read by a grammar, never evaluated; every mistake is one sentence with its place."""

import math

import numpy as np
import pytest
import scipy.io

from robustid.app.run.controller_settings import ControllerChoice, matrix_text
from robustid.app.run.run_file import read_run_file
from robustid.app.run.structure_text import goal_of, structure_of
from robustid.controllers import FIR, PID, Attenuation, LeadLag, LowPass, Notch
from robustid.errors import InputError

HZ = 2 * math.pi
DATA = '[[frequency]]\nfile = "frf.csv"\n'


@pytest.mark.parametrize(
    ("text", "factors"),
    [
        ("P", [PID(integral=False)]),
        ("pi", [PID()]),
        ("PD(80)", [PID(filter=HZ * 80, integral=False)]),
        ("PID(filter=80Hz)", [PID(filter=HZ * 80)]),
        (
            "PID(60..120), Notch(300..400, damping=0.5)",
            [PID(filter=(HZ * 60, HZ * 120)), Notch((HZ * 300, HZ * 400), 0.5)],
        ),
        ("PI * LeadLag(2e1)*LowPass( 900 , order = 2 )", [PID(), LeadLag(HZ * 20), LowPass(HZ * 900, 2)]),
        ("FIR(3)", [FIR(3)]),
        ("Notch(.5 .. 1.5)", [Notch((HZ * 0.5, HZ * 1.5))]),
    ],
)
def test_structures_are_read(text, factors):
    assert structure_of("--structure", text) == tuple(factors)


def test_matrices_are_read():
    both = (PID(filter=HZ * 80), Notch(HZ * 30))
    found = structure_of("--structure", "Matrix(PI, 0; P, PID(80) * Notch(30))")
    assert found.rows == (((PID(),), None), ((PID(integral=False),), both))
    assert structure_of("--structure", "diagonal( PI , PID(80)*Notch(30) )").rows == (((PID(),), None), (None, both))
    assert structure_of("--structure", "Matrix(PI; 0.0)").shape == (2, 1)


def test_constant_matrices_stand_around_a_structure(tmp_path):
    turn = np.array([[1.0, -0.5], [0.25, 2.0], [0.0, 1.0]])
    np.savetxt(tmp_path / "turn.csv", turn, delimiter=",")
    np.savez(tmp_path / "turn.npz", turn=turn)
    scipy.io.savemat(tmp_path / "turn.mat", {"turn": turn})
    for value in ("turn.csv", "turn.npz", "turn.mat", tuple(map(tuple, turn))):
        asked = ControllerChoice(structure="PI, LowPass(9)", actuators=value)
        found = asked.read(str, tmp_path)
        assert np.array_equal(found.actuators, turn)
        assert found.rows == (((PID(), LowPass(HZ * 9)), None), (None, (PID(), LowPass(HZ * 9))))
        assert found.shape == (3, 2)
    asked = ControllerChoice(structure="Matrix(PI, P)", sensors=((1.0, 0.0, 1.0), (0.0, 1.0, 1.0)))
    assert asked.read(str).shape == (1, 3)
    assert matrix_text("--sensors", "1,0;0.5,-1e-3") == [[1.0, 0.0], [0.5, -1e-3]]
    assert matrix_text("--sensors", "turn.csv") == "turn.csv"
    np.savez(tmp_path / "two.npz", a=turn, b=turn)
    (tmp_path / "nan.csv").write_text("1,nan\n0,1\n")
    for value, words in (
        ("none.csv", "--actuators none.csv: there is no such file"),
        (
            "two.npz",
            "--actuators two.npz: one real matrix of finite numbers is needed; got arrays of shape (3, 2), (3, 2)",
        ),
        ("nan.csv", "--actuators nan.csv: one real matrix of finite numbers"),
        (((1.0, 2.0, 3.0),), "--actuators must have 2 columns, one to each axis; got shape (1, 3)"),
    ):
        with pytest.raises(InputError) as error:
            ControllerChoice(structure="Diagonal(PI, P)", actuators=value).read("--{}".format, tmp_path)
        assert words in str(error.value)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("Matrix(PI, 0; P)", "got 2 in row 1 and 1 in row 2. An entry of nothing is 0"),
        ("Matrix(0, 0)", "a matrix needs a factor in one entry at least"),
        ("Matrix(PI, 0", "a comma, a semicolon or a closing bracket is missing at its end"),
        ("Matrix(PI P)", "a comma, a semicolon or a closing bracket is missing at 'P)'"),
        ("Matrix(2, PI)", "a factor, or 0, is missing at '2, PI)'"),
        ("Matrix(PI), P", "the end is missing at ', P'"),
        ("Diagonal(PI; P)", "a comma or a closing bracket is missing at '; P)'"),
        ("Matrix", "there is no factor 'Matrix'"),
        ("PI; P", "a comma between two factors is missing at '; P'"),
        ("", "a factor is missing at its end"),
        ("PID", "PID needs its number, such as PID(80); without a derivative it is PI"),
        ("PID(80", "a closing bracket is missing at its end"),
        ("PID(80) Notch(30)", "a comma between two factors is missing at 'Notch(30)'"),
        ("PID(80),", "a factor is missing at its end"),
        ("Lead(80)", "there is no factor 'Lead'"),
        ("__import__(3)", "a factor is missing at '__import__(3)'"),
        ("PID(2pi*80)", "a closing bracket is missing at 'pi*80)'"),
        ("Notch(30, 40)", "a name, such as damping= is missing at '40)'"),
        ("Notch(30, width=3)", "Notch has no argument width; it has omega and damping"),
        ("Notch(30, damping=0.1..0.3)", "damping of Notch is one number, no interval"),
        ("Notch(40..30)", "Notch needs positive frequencies, low before high; got 40..30"),
        ("Notch(30, damping=1, damping=2)", "damping of Notch is given twice"),
        ("LowPass(0)", "LowPass needs positive frequencies"),
        ("LowPass(10, order=1.5)", "order of LowPass is a whole number; got 1.5"),
        ("PI(3)", "PI has no argument without a name; it has none"),
        ("PID(-3)", "a number is missing at '-3)'"),
    ],
)
def test_what_is_no_structure_is_one_sentence(text, sentence):
    with pytest.raises(InputError) as error:
        structure_of("--structure", text)
    assert sentence in str(error.value)
    assert str(error.value).startswith("--structure ")


def test_goals_are_read():
    assert goal_of("--maximise", "integral-gain") == "integral gain"
    assert goal_of("--maximise", "attenuation:1:20") == Attenuation(HZ, HZ * 20)
    for wrong in ("speed", "attenuation", "attenuation:20:1", "attenuation:1:x", "attenuation:1:2:3"):
        with pytest.raises(InputError, match="--maximise must be one of bandwidth, integral-gain"):
            goal_of("--maximise", wrong)


def test_limits_are_in_the_units_of_the_library():
    asked = ControllerChoice(
        structure="PI",
        phase_margin_deg=60.0,
        bandwidth_hz=5.0,
        attenuate=((1.0, 2.0, 0.1),),
        roll_off=((8.0, 9.0, 0.2),),
        tracking=((1.0, 2.0, 0.8),),
        disturbance=((1.0, 3.0, 5.0),),
        action=((8.0, 9.0, 0.3),),
    )
    limits = asked.limits
    assert limits.sensitivity_peak == 2.0
    assert limits.phase_margin == pytest.approx(math.pi / 3)
    assert limits.bandwidth == pytest.approx(HZ * 5)
    assert limits.attenuation == ((HZ, 2 * HZ, 0.1),)
    assert limits.roll_off == ((8 * HZ, 9 * HZ, 0.2),)
    assert limits.tracking == ((HZ, 2 * HZ, 0.8),)
    assert limits.disturbance == ((HZ, 3 * HZ, 5.0),)
    assert limits.action == ((8 * HZ, 9 * HZ, 0.3),)


def test_a_run_file_states_a_controller(tmp_path):
    (tmp_path / "data").mkdir()
    text = DATA + '[controller]\nstructure = "PID(80)"\nattenuate = [[1.0, 2.0, 0.1]]\nfixed = ["delay.npz"]\n'
    text += 'actuators = [[1, 2], [0, 1]]\nsensors = "sensors.csv"\n'
    (tmp_path / "ask.toml").write_text(text)
    asked = read_run_file(tmp_path / "ask.toml")
    assert asked.controller.attenuate == ((1.0, 2.0, 0.1),)
    moved = asked.moved(tmp_path, tmp_path / "data").controller
    assert moved.fixed == ("../delay.npz",)
    assert moved.sensors == "../sensors.csv"
    assert moved.actuators == ((1.0, 2.0), (0.0, 1.0))
    (tmp_path / "again.toml").write_text(asked.text())
    assert read_run_file(tmp_path / "again.toml").controller == asked.controller


@pytest.mark.parametrize(
    ("section", "sentence"),
    [
        ("peak = 2.0", "[controller] needs a structure"),
        ('structure = "PID"', "[controller] structure 'PID': PID needs its number"),
        (
            'structure = "PI"\nactuators = [[1, 2], [3]]',
            "[controller] actuators must be rows of numbers, all of one length",
        ),
        ('structure = "PI"\npeak = 0.9', "[controller] peak must be above 1; got 0.9"),
        ('structure = "PI"\nphase_margin_deg = 100', "[controller] phase_margin_deg must be between 0 and pi/2 rad"),
        ('structure = "PI"\nattenuate = [[2.0, 1.0, 0.1]]', "[controller] attenuate must be rows (low, high, value)"),
        ('structure = "PI"\ntracking = [[1.0, 2.0, 1.5]]', "[controller] tracking must be rows (low, high, value)"),
        ('structure = "PI"\nmaximise = "speed"', "[controller] maximise must be one of bandwidth"),
        ('structure = "PI"\n[worst_case]\ncompute = false', "[controller] needs the band of all consistent plants"),
    ],
)
def test_a_section_that_makes_no_sense_is_one_sentence(tmp_path, section, sentence):
    (tmp_path / "ask.toml").write_text(f"{DATA}[controller]\n{section}\n")
    with pytest.raises(InputError) as error:
        read_run_file(tmp_path / "ask.toml")
    assert sentence in str(error.value)
