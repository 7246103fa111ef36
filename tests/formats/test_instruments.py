"""Files as the programs of measuring instruments write them: read without options, with their signs and units."""

import time

import numpy as np
import pytest

import robustid as rid
from robustid import load
from robustid.errors import FileFormatError, InputError
from robustid.formats.headings import heading
from support import instrument_files as files
from support.instrument_files import CELL, HZ, HZ_RADIO, MATRIX, SPEAKER, S

pytestmark = pytest.mark.quick

OHM = ([("voltage", "V")], [("current", "A")])
NO_UNITS = ([("voltage", "")], [("current", "")])
GRID = ([("v_d", "V"), ("v_q", "V")], [("i_d", "A"), ("i_q", "A")])
LEVEL = ([("SPL", "")], [("u", "")])
GAIN = ([("y", "")], [("u", "")])
ONE_PORT, THROUGH = ([("b1", "")], [("a1", "")]), ([("b2", "")], [("a1", "")])
TWO_PORTS = ([("b1", ""), ("b2", "")], [("a1", ""), ("a2", "")])
EVEN = 20 + 0.5 * np.arange(HZ.size)
FIGURES, FEWER = 3e-7, 1e-5  # part of a value: eight digits; six in the text of universal files

# name: contents, frequencies in Hz, values (outputs, inputs, F), names and units of outputs and inputs, part in which they agree
READ = {
    "peis.mpt": (files.ec_lab(), HZ, CELL, OHM),
    "peis_de.mpt": (files.ec_lab(comma=True), HZ, CELL, OHM),
    "eclab.txt": (files.ec_lab_text(), HZ, CELL, OHM),
    "EISPOT.DTA": (files.gamry(), HZ, CELL, OHM),
    "EISPOT_de.DTA": (files.gamry(comma=True, rest=False), HZ, CELL, OHM),
    "cell.z": (files.zplot(), HZ, CELL, OHM),
    "cell_windows.z": (files.zplot_windows(), HZ, CELL, OHM),
    "z60.txt": (files.z60(), HZ, CELL, OHM),
    "nova.txt": (files.nova(), HZ, CELL, OHM),
    "nova.csv": (files.nova(";", comma=True), HZ, CELL, OHM),
    "chi.txt": (files.ch_instruments(), HZ, CELL, OHM),
    "cell.par": (files.versastudio(), HZ, CELL, NO_UNITS),
    "parstat.txt": (files.parstat(), HZ, CELL, OHM),
    "zahner.csv": (files.zahner(), HZ, CELL, OHM),
    "thales.txt": (files.thales(), HZ, CELL, OHM),
    "pstrace.csv": (files.pstrace(), HZ, CELL, OHM),
    "smart.csv": (files.smart(), HZ, CELL, OHM),
    "rew_impedance.txt": (files.rew(), HZ, SPEAKER, OHM),
    "rew_de.txt": (files.rew(comma=True), HZ, SPEAKER, OHM),
    "rew.txt": (files.rew(names="Freq(Hz) SPL(dB) Phase(degrees)", size=files.decibels), HZ, SPEAKER, LEVEL),
    "woofer.frd": (files.frd(), HZ, SPEAKER, LEVEL),
    "woofer.zma": (files.zma(), HZ, SPEAKER, OHM),
    "titled.zma": (files.zma_titled(), HZ, SPEAKER, OHM),
    "plate.csv": (files.accelerance(HZ, SPEAKER, HZ / HZ), HZ, SPEAKER, ([("y", "g")], [("u", "N")])),
    "plate_polar.csv": (files.polar("g/N"), HZ, SPEAKER, ([("y", "g")], [("u", "N")])),
    "plate.uff": (files.hammer_test(EVEN, np.stack([SPEAKER, CELL], axis=1), np.ones((9, 2))), EVEN, np.stack([[SPEAKER], [CELL]]),
                  ([("1Z+", "m/s^2"), ("2Z+", "m/s^2")], [("2Z+", "N")])),
    "grid.csv": (files.dq_parts(), HZ, MATRIX, GRID),
    "grid_polar.csv": (files.dq_magnitudes(), HZ, MATRIX, GRID),
    "grid_db.txt": (files.dq_decibels(), HZ, MATRIX, GRID),
    "pna.csv": (files.keysight(), HZ_RADIO, S, TWO_PORTS),
    "ena.csv": (files.keysight_decibels(), HZ_RADIO, S[0, 0], ONE_PORT),
    "znb.csv": (files.rohde_schwarz(), HZ_RADIO, S[1, 0], THROUGH),
    "analyser.txt": (files.impedance_analyser()[0], HZ_RADIO, files.impedance_analyser()[1], OHM),
    "bode100.csv": (files.bode_100(), HZ, SPEAKER, GAIN),
    "shaker.csv": (files.vibration_controller(), HZ, MATRIX[:, :1], ([("y1", "m/s²"), ("y2", "m/s²")], [("u1", "N")])),
    "sweep.xml": (files.diagnostics(), HZ, MATRIX[:, :1],
                  ([("H1:LSC-DARM1_IN1", ""), ("H1:LSC-DARM1_IN2", "")], [("H1:LSC-DARM1_EXC", "")])),
}  # fmt: skip
TURNED = {"peis.mpt", "peis_de.mpt", "eclab.txt", "nova.txt", "nova.csv", "pstrace.csv"}


def write(folder, name, content):
    path = folder / name
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("name", READ)
def test_files_of_instruments(tmp_path, name):
    content, hz, values, (outputs, inputs) = READ[name]
    path = write(tmp_path, name, content)
    before = time.perf_counter()
    found = rid.look(path)
    assert time.perf_counter() - before < 3
    frf, order = load(path), np.argsort(hz)
    np.testing.assert_allclose(frf.freq_hz, hz[order], rtol=FIGURES)
    wanted = np.moveaxis(values.reshape(len(outputs), len(inputs), -1), -1, 0)
    np.testing.assert_allclose(frf.values, wanted[order], rtol=FEWER if name.endswith(".uff") else FIGURES)
    assert (list(frf.outputs), list(frf.inputs)) == (outputs, inputs)
    assert frf.dt is None
    # `look` and `new` go on with exactly this
    assert (found.kind, found.refusal, found.arguments, found.faulty) == ("frequency", "", {}, False)
    np.testing.assert_array_equal(found.data.values, frf.values)
    assert ("is turned, as the minus in the name says" in found.how) == (name in TURNED)


@pytest.mark.parametrize(("unit", "sides"), [("mm/s/V", ("mm/s", "V")), ("m/s", ("", "")), ("mm", ("", ""))])
def test_a_unit_is_of_output_and_input_only_where_it_names_both(tmp_path, unit, sides):
    frf = load(write(tmp_path, "x.csv", files.polar(unit)))
    assert (frf.outputs[0].unit, frf.inputs[0].unit) == sides


def test_a_minus_in_a_name_is_a_sign_where_the_column_is_named_too(tmp_path):
    path = write(tmp_path, "peis.mpt", files.ec_lab())
    fields = {"freq_hz": "freq/Hz", "real": "Re(Z)/Ohm", "imag": "-Im(Z)/Ohm"}
    found = rid.look(path, fields=fields)
    np.testing.assert_allclose(found.data.values[:, 0, 0], CELL[::-1], rtol=FIGURES)
    assert found.how.endswith("the sign of '-Im(Z)/Ohm' is turned, as the minus in the name says")


def test_tables_in_memory_and_arrays_of_other_lengths(tmp_path):
    """Single numbers and other vectors beside the response, and a row of the state at rest."""
    table = {"freq_hz": np.append(0.0, HZ), "Zreal [mOhm]": 1e3 * np.append(0.0, CELL.real), "dt": np.array(0.0),
             "-Zimag [mOhm]": -1e3 * np.append(0.0, CELL.imag), "S11 real": np.ones(3), "Y": np.ones((2, 2))}  # fmt: skip
    np.savez(tmp_path / "cell.npz", **table)
    for source in (table, tmp_path / "cell.npz"):
        frf = load(source)
        np.testing.assert_allclose(frf.values[:, 0, 0], CELL[::-1], rtol=1e-14)
        np.testing.assert_allclose(frf.freq_hz, HZ[::-1], rtol=1e-14)


def test_a_list_of_diagnostics_at_even_frequencies(tmp_path):
    frf = load(write(tmp_path, "fft.xml", files.diagnostics(subtype=0)))
    np.testing.assert_allclose(frf.freq_hz, 1 + 0.5 * np.arange(9), rtol=1e-14)
    np.testing.assert_allclose(frf.values[:, 1, 0], MATRIX[1, 0][::-1], rtol=FIGURES)


ASKED = {
    "powersuite.txt": (files.powersuite(), {"frequency_unit": "Hz"}, CELL),
    "sr785.txt": (
        files.sr785(),
        {"fields": {"freq_hz": "[:,0]", "magnitude_db": "[:,1]", "phase_deg": "[:,2]"}},
        SPEAKER,
    ),
    "undriven.xml": (
        files.diagnostics(stimulus=""),
        {"fields": {"freq_hz": "H1:LSC-DARM1_EXC f [Hz]", "values": "H1:LSC-DARM1_IN1 / H1:LSC-DARM1_EXC"}},
        MATRIX[0, 0],
    ),
}


@pytest.mark.parametrize("name", ASKED)
def test_headings_that_are_not_understood_are_asked_about(tmp_path, name):
    """Never taken for a record, neither by `look` nor in the run file."""
    content, options, values = ASKED[name]
    path = write(tmp_path, name, content)
    found = rid.look(path)
    assert found.data is None
    assert all(word in found.refusal for word in options | options.get("fields", {}))
    assert "time" not in found.arguments.get("fields", {})
    frf = load(path, **options)
    np.testing.assert_allclose(frf.values[:, 0, 0], values[np.argsort(HZ)], rtol=FIGURES)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("Freq(Hz),SPL(dB)\n20,70\n40,71\n", r"'SPL\(dB\)' is magnitude of SPL in dB, and what makes a response with it"),
        (
            "Freq(Hz),S11(REAL),S11(IMAG),S21(REAL),S21(IMAG),S12(REAL),S12(IMAG)\n1,1,2,3,4,5,6\n2,1,2,3,4,5,6\n",
            r"entries of a matrix S, of which S22 is missing: export all, or name one entry by `fields`; S11 is in 'S11\(REAL\)'",
        ),
        ("freq/Hz,Re(Z)/Ohm,Im(Z)/mOhm\n1,2,3\n2,2,3\n", r"'Re\(Z\)/Ohm' is in Ohm and 'Im\(Z\)/mOhm' in mOhm: export one"),
        ("freq/Hz,|Z|/Ohm,Phase/deg\n1,-2,3\n2,2,3\n", r"'\|Z\|/Ohm' is a magnitude and has negative values: is it in dB"),
        (
            "freq/Hz,Z'/Ohm,Z''/Ohm,Phase/deg\n1,1,1,-45\n2,1,2,-63.4\n",
            "\"Z''/Ohm\" and 'Phase/deg' contradict each other: one of them is the negative of what its name says",
        ),
        (
            "Frequency (Hz);Foo;Bar\n1;2;3\n2;3;4\n",
            "As a frequency response: say by `fields` which columns are 'values' .complex., 'real'",
        ),
    ],
)  # fmt: skip
def test_what_is_missing_or_contradicts_is_said(tmp_path, text, sentence):
    with pytest.raises(InputError, match=sentence):
        load(write(tmp_path, "x.csv", text.encode()))


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (files.gamry().replace(b"ZCURVE", b"CURVE"), "has no table ZCURVE, which holds the impedance"),
        (files.keysight() + files.keysight().partition(b"\r\n\r\n")[2], "holds several tables, from lines 6 and 15 on"),
        (files.diagnostics()[:-900], "can't be read as XML of LIGO's tools"),
        (files.diagnostics().replace(b">9<", b">10<"), "an array of 36 numbers for 3 channels and 10 frequencies"),
        (files.diagnostics().replace(b"TransferFunction", b"Spectrum"), "has no transfer functions: spectra don't say"),
        (files.diagnostics().replace(b"<!ELEMENT", b"<!ENTITY a 'b'>\n<!ELEMENT"), "declares entities"),
    ],
)
def test_files_that_are_cut_off_or_hold_something_else(tmp_path, content, sentence):
    with pytest.raises(FileFormatError, match=sentence):
        load(write(tmp_path, "x.txt", content))


@pytest.mark.parametrize(
    ("name", "known"),
    [
        ("-Im(Z)/Ohm", ("Z", "", "imag", "Ohm", -1)),
        ("−Z'' (Ω)", ("Z", "", "imag", "Ω", -1)),
        ("neg. Phase / °", ("", "", "phase", "°", -1)),
        ("S21(DEG)", ("S", "21", "phase", "DEG", 1)),
        ("reTrc1_S21", ("S", "21", "real", "", 1)),
        ("Zdq_phase_deg", ("Z", "dq", "phase", "deg", 1)),
        ("Re/Ohm", ("", "", "real", "Ohm", 1)),
        # of signals, counters and axes
        ("y", None),
        ("y1", None),
        ("s", None),
        ("time/s", None),
        ("<I>/mA", None),
        ("E Real", None),
        ("position [mm]", None),
    ],
)
def test_headings(name, known):
    assert heading(name) == known
