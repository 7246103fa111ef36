"""Universal files (58) through pyuff and Touchstone through scikit-rf, against arrays written by them or by hand."""

import sys

import numpy as np
import pytest

from robustid import load
from robustid.errors import FileFormatError, InputError
from support.exchange_files import HZ, INPUTS, OUTPUTS, RNG, G, S, function, matrix, signal, touchstone, write
from support.pairwise import every_one

pytestmark = pytest.mark.quick
skrf = pytest.importorskip("skrf")


@pytest.mark.parametrize(("binary", "spacing"), [(0, 0), (1, 0), (0, 1), (1, 1)])
def test_functions_of_several_degrees_of_freedom_make_a_matrix(tmp_path, binary, spacing):
    extra = function(6, (12, 3), (12, 3), HZ, np.ones(8))  # a coherence is no response
    path = write(tmp_path / "frf.uff", [*matrix(binary=binary, abscissa_spacing=spacing), extra])
    frf = load(path, dt=0.01)
    np.testing.assert_allclose(frf.values, G, rtol=1e-10)
    np.testing.assert_allclose(frf.freq_hz, HZ, rtol=1e-12)
    assert frf.outputs == (("12Z+", "m/s^2"), ("7X-", "m/s^2"))
    assert frf.inputs == (("12Z+", "N"), ("3Y+", "N"))
    assert frf.dt == 0.01
    assert load(path).dt is None
    path.rename(tmp_path / "no_matter.dat")
    np.testing.assert_allclose(load(tmp_path / "no_matter.dat").values, G, rtol=1e-10)


@pytest.mark.parametrize(
    ("changes", "scale"),
    [
        ({"abscissa_axis_units_lab": "rad/s"}, 1),
        ({"abscissa_axis_units_lab": "kHz"}, 2e3 * np.pi),
        ({"abscissa_axis_units_lab": "NONE"}, 2 * np.pi),
        ({"abscissa_axis_units_lab": "Hz", "abscissa_spec_data_type": 0}, 2 * np.pi),
    ],
)
def test_units_of_frequency(tmp_path, changes, scale):
    np.testing.assert_allclose(load(write(tmp_path / "frf.uff", matrix(**changes))).omega, HZ * scale, rtol=1e-12)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda: matrix(abscissa_axis_units_lab="RPM"), "the unit 'RPM', which isn't a frequency; store Hz"),
        (lambda: matrix(abscissa_axis_units_lab="", abscissa_spec_data_type=0), "the unit '', which isn't a frequency"),
        (lambda: matrix()[:3], "of 2 outputs and 2 inputs the entries 7X- / 3Y[+] are missing"),
        (
            lambda: [*matrix()[:3], function(4, OUTPUTS[1], INPUTS[1], HZ, HZ + 0j, orddenom_axis_units_lab="V")],
            r"3Y\+ is in 'N' in one function and in 'V' in another",
        ),
        (lambda: [function(6, (1, 1), (1, 1), HZ, np.ones(8))], r"function types there: \[6\]"),
    ],
)
def test_what_is_not_certain_is_refused(tmp_path, change, sentence):
    with pytest.raises(FileFormatError, match=sentence):
        load(write(tmp_path / "frf.uff", change()))


def test_time_responses_with_forces_make_a_record(tmp_path):
    sets = [signal(1, 12), signal(2, 13, ordinate_axis_units_lab="N"), signal(3, 8, ordinate_axis_units_lab="m")]
    record = load(write(tmp_path / "time.unv", sets))
    np.testing.assert_allclose(record.u[:, 0], sets[1]["data"], rtol=1e-10)
    np.testing.assert_allclose(record.y, np.column_stack([sets[0]["data"], sets[2]["data"]]), rtol=1e-10)
    assert record.dt == 0.25
    assert (record.inputs, record.outputs) == ((("2X+", "N"),), (("1X+", "m/s^2"), ("3X+", "m")))


def test_time_responses_of_unknown_types_are_named_by_the_user(tmp_path):
    sets = [signal(1, 0), signal(2, 0, abscissa_axis_units_lab="s")]
    path = write(tmp_path / "time.uff", sets)
    with pytest.raises(InputError, match=r"no .u. found.* The file has 1X\+, 2X\+, time"):
        load(path)
    record = load(path, fields={"u": "2X+", "y": "1X+"})
    np.testing.assert_allclose(record.u[:, 0], sets[1]["data"], rtol=1e-10)
    assert record.dt == 0.25
    milliseconds = [signal(1, 12, abscissa_axis_units_lab="ms"), signal(2, 13, abscissa_axis_units_lab="ms")]
    assert load(write(tmp_path / "ms.uff", milliseconds)).dt == pytest.approx(0.25e-3)


def test_both_kinds_in_one_file_are_told_apart_by_the_kind(tmp_path):
    path = write(tmp_path / "both.uff", [*matrix(), signal(1, 12), signal(2, 13)])
    with pytest.raises(InputError, match="can't tell whether"):
        load(path)
    assert load(path, kind="frequency").values.shape == (8, 2, 2)
    assert load(path, kind="time").u.shape == (40, 1)


def test_a_declared_number_of_points_must_be_there(tmp_path):
    path = write(tmp_path / "frf.uff", matrix())
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[:15] + lines[16:]))
    with pytest.raises(FileFormatError, match=r"12Z\+ / 12Z\+ declares 8 points and has 7"):
        load(path)


# --- Touchstone


@pytest.mark.parametrize(
    ("unit", "scale", "style"), every_one([("Hz", 1), ("kHz", 1e3), ("MHz", 1e6), ("GHz", 1e9)], ["ri", "db"])
)
def test_scattering_parameters(tmp_path, unit, scale, style):
    frf = load(touchstone(tmp_path / "two.s2p", S, unit, style))
    np.testing.assert_allclose(frf.values, S, rtol=1e-12)
    np.testing.assert_allclose(frf.freq_hz, scale * np.arange(1, 7), rtol=1e-14)
    assert frf.dt is None
    assert [c.name for c in (*frf.inputs, *frf.outputs)] == ["a1", "a2", "b1", "b2"]


@pytest.mark.parametrize("ports", [1, 3])
def test_other_numbers_of_ports(tmp_path, ports):
    values = RNG.standard_normal((5, ports, ports)) + 1j * RNG.standard_normal((5, ports, ports))
    np.testing.assert_allclose(load(touchstone(tmp_path / f"n.s{ports}p", values)).values, values, rtol=1e-14)


def test_what_scikit_rf_writes(tmp_path):
    network = skrf.Network(f=np.arange(1, 7), f_unit="MHz", s=S, z0=50)
    network.write_touchstone("net", dir=str(tmp_path))
    frf = load(tmp_path / "net.s2p")
    np.testing.assert_allclose(frf.values, S, rtol=1e-9)
    np.testing.assert_allclose(frf.freq_hz, 1e6 * np.arange(1, 7))


@pytest.mark.parametrize(
    ("name", "change", "sentence"),
    [
        ("wrong.s2p", lambda p: touchstone(p, S[:, :1, :1]), "6 lines begin a frequency where 2 frequencies of 2 x 2"),
        ("wrong.s1p", lambda p: touchstone(p, S), "number of ports"),
        ("bare.s2p", lambda p: touchstone(p, S, option=False), "no option line such as"),
        ("unit.s2p", lambda p: touchstone(p, S, unit="rad/s"), "can't be read as Touchstone .*frequency_unit"),
        ("vast.s99999999p", lambda p: touchstone(p, S), "declares 99999999 ports and has .* bytes only"),
        ("z.s2p", lambda p: p.write_text("# Hz Z RI R 50\n1 1 0 1 0 1 0 1 0\n"), "holds Z-parameters; convert them"),
        ("empty.s2p", lambda p: p.write_text("# Hz S RI R 50\n! nothing\n"), "0 lines begin a frequency"),
    ],
)
def test_touchstone_that_does_not_fit_is_refused(tmp_path, name, change, sentence):
    change(tmp_path / name)
    with pytest.raises(FileFormatError, match=sentence):
        load(tmp_path / name)


@pytest.mark.parametrize(
    ("name", "module", "extra"), [("a.uff", "pyuff", "uff"), ("a.s1p", "skrf.io.touchstone", "touchstone")]
)
def test_a_missing_reader_is_named_with_its_extra(tmp_path, monkeypatch, name, module, extra):
    monkeypatch.setitem(sys.modules, module, None)
    (tmp_path / name).write_text("# Hz S RI R 50\n1 0 0\n" if extra == "touchstone" else "    -1\n    58\n")
    with pytest.raises(FileFormatError, match=rf"isn't installed here: pip install 'robustid\[{extra}\]'"):
        load(tmp_path / name)
