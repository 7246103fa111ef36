"""Units in the names of columns: converted where they are certain, refused where they aren't."""

import cmath
import math

import h5py
import numpy as np
import pytest

from robustid import load, look
from robustid.errors import InputError
from robustid.formats.role_names import axis_role

pytestmark = pytest.mark.quick
VALUE = 1.5 + 0.25j
OMEGA = 2 * np.pi * 40  # rad/s


def write_frf(path, axis, number):
    path.write_text(f"{axis},real,imag\n{number!r},{VALUE.real!r},{VALUE.imag!r}\n")
    return path


@pytest.mark.parametrize(
    ("axis", "number"),
    [
        ("frequency [Hz]", 40.0),
        ("Frequency (Hz)", 40.0),
        ("f (Hz)", 40.0),
        ("f [hz]", 40.0),
        ("freq_kHz", 0.04),
        ("frequency [kHz]", 0.04),
        ("frequency [MHz]", 40e-6),
        ("frequency [mHz]", 40e3),
        ("Hz", 40.0),
        ("omega", OMEGA),
        ("omega [rad/s]", OMEGA),
        ("w (rad/s)", OMEGA),
        ("ω [rad/s]", OMEGA),
        ("frequency [rad/s]", OMEGA),
        ("freq_rad_s", OMEGA),
        ("angular frequency [rad/sec]", OMEGA),
    ],
)
def test_frequency_axes(tmp_path, axis, number):
    path = write_frf(tmp_path / "frf.csv", axis, number)
    assert load(path).omega[0] == pytest.approx(OMEGA, rel=1e-14)
    # and by its name, or its name without the unit, given as a role
    assert load(path, fields={"omega": axis}).omega[0] == pytest.approx(OMEGA, rel=1e-14)


def test_a_unit_that_is_stated(tmp_path):
    """Of a name without one; in place of none by a role in rad/s; not in place of another."""
    path = write_frf(tmp_path / "frf.csv", "frequency", 0.04)
    assert load(path, frequency_unit="kHz").omega[0] == pytest.approx(OMEGA, rel=1e-14)
    assert load(path, frequency_unit="khz", fields={"omega": "frequency"}).omega[0] == pytest.approx(OMEGA, rel=1e-14)
    with pytest.raises(InputError, match="`frequency_unit` says kHz, and the name of 'frequency' or its role says Hz"):
        load(path, frequency_unit="kHz", fields={"freq_hz": "frequency"})
    with pytest.raises(InputError, match='must be "rad/s", "Hz" or "kHz"; got \'mhz\''):
        load(path, frequency_unit="mhz")


@pytest.mark.parametrize("axis", ["frequency", "freq", "f", "Frequency"])
def test_a_frequency_without_unit_is_refused_until_it_is_stated(tmp_path, axis):
    path = write_frf(tmp_path / "frf.csv", axis, 40.0)
    sentence = (
        f"the unit of the frequencies in '{axis}' isn't certain: give `frequency_unit`.*The file has {axis}, real"
    )
    with pytest.raises(InputError, match=sentence):
        load(path)
    assert load(path, frequency_unit="Hz").omega[0] == pytest.approx(OMEGA)
    assert load(path, frequency_unit="rad/s").omega[0] == 40
    assert load(path, fields={"freq_hz": axis}).omega[0] == pytest.approx(OMEGA)


@pytest.mark.parametrize("axis", ["frequency [1/s]", "frequency [mhz]", "f [rpm]", "omega [Hz]", "omega_hz", "f [-]"])
def test_units_that_are_unknown_or_contradict_the_name_are_refused(tmp_path, axis):
    path = write_frf(tmp_path / "frf.csv", axis, 40.0)
    with pytest.raises(InputError, match="isn't certain"):
        load(path)
    with pytest.raises(InputError, match=r"isn't certain: give `frequency_unit` .* and `fields"):
        load(path, frequency_unit="rad/s")


def test_column_and_unit_both_given_go_before_an_unknown_unit(tmp_path):
    path = write_frf(tmp_path / "frf.csv", "frequency [1/s]", 40.0)
    assert load(path, fields={"omega": "frequency"}, frequency_unit="Hz").omega[0] == pytest.approx(OMEGA)
    with pytest.raises(InputError, match="'1/s' is no certain unit of frequency; give `frequency_unit`"):
        load(path, fields={"omega": "frequency"})


@pytest.mark.parametrize(
    ("axis", "options", "sentence"),
    [
        (
            "frequency [Hz]",
            {"frequency_unit": "rad/s"},
            "`frequency_unit` says rad/s, and the name of 'frequency .Hz.'",
        ),
        ("omega [rad/s]", {"frequency_unit": "Hz"}, "`frequency_unit` says Hz, and the name of 'omega"),
        ("omega [rad/s]", {"fields": {"freq_hz": "omega"}}, "the role says Hz"),
        ("speed [V]", {"fields": {"omega": "speed"}}, "'V' is no certain unit of frequency"),
    ],
)
def test_contradictions_are_refused(tmp_path, axis, options, sentence):
    with pytest.raises(InputError, match=sentence.replace("[", r"\[")):
        load(write_frf(tmp_path / "frf.csv", axis, 40.0), **options)


@pytest.mark.parametrize(
    ("names", "numbers"),
    [
        ("magnitude [dB],phase [deg]", (20 * math.log10(abs(VALUE)), math.degrees(cmath.phase(VALUE)))),
        ("Mag (dB),Phase (°)", (20 * math.log10(abs(VALUE)), math.degrees(cmath.phase(VALUE)))),
        ("magnitude [m/N],phase [rad]", (abs(VALUE), cmath.phase(VALUE))),
        ("mag_db,phase_degrees", (20 * math.log10(abs(VALUE)), math.degrees(cmath.phase(VALUE)))),
        ("abs,phase (radians)", (abs(VALUE), cmath.phase(VALUE))),
    ],
)
def test_magnitude_and_phase(tmp_path, names, numbers):
    path = tmp_path / "frf.csv"
    path.write_text(f"f [Hz],{names}\n40,{numbers[0]!r},{numbers[1]!r}\n")
    np.testing.assert_allclose(load(path).values, [[[VALUE]]], rtol=1e-14)


@pytest.mark.parametrize(
    ("names", "sentence"),
    [
        ("magnitude,phase", "the unit of 'phase' isn't certain: give `fields={'phase_deg'"),
        ("magnitude [dBV],phase [deg]", "the unit of 'magnitude .dBV.' isn't certain"),
        ("magnitude,phase [deg]", "'magnitude' has negative values: is it in dB"),
        ("magnitude,phase [deg],imag,real", "'real' and 'imag' must be real; for complex numbers name one role"),
    ],
)
def test_magnitude_and_phase_without_a_certain_unit(tmp_path, names, sentence):
    path = tmp_path / "frf.csv"
    path.write_text(f"f [Hz],{names}\n40,-3,-10{',1+1j' * (names.count(',') - 1)}\n")
    with pytest.raises(InputError, match=sentence):
        load(path)


@pytest.mark.parametrize(
    ("axis", "step"),
    [("time [ms]", 1.0), ("t (ms)", 1.0), ("time_ms", 1.0), ("time [us]", 1e3), ("Time [µs]", 1e3), ("time", 1e-3),
     ("t [s]", 1e-3), ("time [sec]", 1e-3), ("time [ns]", 1e6), ("time [min]", 1e-3 / 60)],
)  # fmt: skip
def test_time_axes_and_channel_units(tmp_path, axis, step):
    path = tmp_path / "record.csv"
    rows = [f"{k * step!r},{k},{-k}" for k in range(5)]
    path.write_text("\n".join([f"{axis},u [A],y (mm)", *rows]))
    record = load(path)
    assert record.dt == pytest.approx(1e-3, rel=1e-12)
    assert (record.inputs, record.outputs) == ((("u", "A"),), (("y", "mm"),))


def test_names_may_be_given_without_their_units(tmp_path):
    path = tmp_path / "record.csv"
    path.write_text("clock [ms],current [A],angle [rad]\n0,1,2\n1,1,2\n")
    record = load(path, fields={"time": "clock", "u": "current", "y": ["angle"]})
    assert record.dt == pytest.approx(1e-3)
    assert (str(record.inputs[0]), str(record.outputs[0])) == ("current [A]", "angle [rad]")


def test_a_time_in_an_unknown_unit_is_refused(tmp_path):
    path = tmp_path / "record.csv"
    path.write_text("time [samples],u,y\n0,1,2\n1,1,2\n")
    with pytest.raises(
        InputError, match=r"'time \[samples\]': 'samples' is no unit of time that is known; give `dt` in s"
    ):
        load(path)
    assert load(path, dt=0.5).dt == 0.5


@pytest.mark.parametrize(
    ("header", "sentence"),
    [
        ("time,u,y [mm],bound [m]", "the bound is in m and what it bounds in mm; store both in one linear unit"),
        ("f [Hz],real [m/N],imag [m/N],bound [mm/N]", "the bound is in mm/N and what it bounds in m/N"),
        ("f [Hz],magnitude [dB],phase [deg],bound [dB]", "the bound is in dB"),
    ],
)
def test_a_bound_in_another_unit_is_refused(tmp_path, header, sentence):
    path = tmp_path / "data.csv"
    path.write_text(f"{header}\n0,1,2,3\n1,1,2,3\n")
    with pytest.raises(InputError, match=sentence):
        load(path)
    assert load(path, bound=0.1).bound is not None


def test_a_force_called_f_does_not_make_a_record_a_frequency_response(tmp_path):
    path = tmp_path / "record.csv"
    path.write_text("time,u,y,f\n0,1,2,3\n1,1,2,3\n")
    assert load(path).dt == 1


def test_a_letter_of_another_unit_is_no_axis(tmp_path):
    """A force F, a torque T: of a record with its time, the force is the input that is asked about."""
    assert [axis_role(name) for name in ("F [N]", "T [Nm]", "f (V)")] == [None] * 3
    assert [axis_role(name) for name in ("f [Hz]", "F [kHz]", "T [ms]", "w [rad/s]")] == [
        "freq_hz",
        "freq_hz",
        "time",
        "omega",
    ]
    path = tmp_path / "record.csv"
    np.savetxt(path, np.c_[np.arange(50) / 1e3, np.ones((50, 2))], delimiter=",", header="t,F [N],x [m]", comments="")
    found = look(path)
    assert found.kind == "time"
    assert dict(found.arguments) == {"fields": {"time": "t", "u": "F [N]", "y": "x [m]"}}


def test_only_whole_words_are_units():
    assert axis_role("times") == "time"
    assert axis_role("u [Hz]") is None
    assert axis_role("self") is None
    assert axis_role("status") is None


def test_hdf5_by_h5py_has_its_axes_as_stored_and_units_as_attributes(tmp_path):
    rng = np.random.default_rng(0)
    u, y = rng.standard_normal((50, 2)), rng.standard_normal((50, 3))
    with h5py.File(tmp_path / "record.h5", "w") as file:
        file.attrs["dt"] = 0.25
        file["u"], file["y"] = u, y
        file["u"].attrs["units"] = "N"
    record = load(tmp_path / "record.h5")
    np.testing.assert_array_equal(record.u, u)
    np.testing.assert_array_equal(record.y, y)
    assert record.dt == 0.25
    values = rng.standard_normal((4, 2, 3)) + 1j * rng.standard_normal((4, 2, 3))
    with h5py.File(tmp_path / "frf.h5", "w") as file:
        file["bench/frequency"], file["bench/values"] = np.arange(4.0), values
        file["bench/frequency"].attrs["units"] = "kHz"
    fields = {"omega": "bench.frequency", "values": "bench.values"}
    frf = load(tmp_path / "frf.h5", fields=fields)
    np.testing.assert_array_equal(frf.values, values)
    np.testing.assert_allclose(frf.freq_hz, 1e3 * np.arange(4))
    # by columns, as Fortran and h5write store: seen from the shapes
    with h5py.File(tmp_path / "turned.h5", "w") as file:
        file["omega"], file["values"] = np.arange(4.0), values.T
    with pytest.raises(InputError, match=r"with the frequency last, as MATLAB has it"):
        load(tmp_path / "turned.h5")
    with h5py.File(tmp_path / "turned.h5", "w") as file:
        file["u"], file["y"] = u.T, y.T
    with pytest.raises(InputError, match="fewer samples than signals"):
        load(tmp_path / "turned.h5", dt=1)
