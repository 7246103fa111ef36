"""Texts as instruments and programs write them: read right, or refused with the arguments that then read them right."""

import numpy as np
import pytest

from robustid.data import TimeRecord
from support.foreign_files import DT, HZ, G, U, Y, followed, rows, same_record, same_response

pytestmark = pytest.mark.quick

T = DT * np.arange(8)
DB, DEG, RAD = 20 * np.log10(np.abs(G)), np.rad2deg(np.angle(G)), np.angle(G)
CARTESIAN = {"freq_hz": "[:,0]", "real": "[:,1]", "imag": "[:,2]"}
COLUMNS = {"fields": {"u": "[:,0]", "y": "[:,1]"}, "dt": 1.0}
SPICE = {"frequency_unit": "Hz", "fields": {"freq_hz": "Freq.", "values": "V(out)"}}
SIGNALS = {"time": "[:,0]", "u": "[:,1]", "y": "[:,2]"}


def cells(*columns, separator=","):
    return "".join(separator.join(map(str, row)) + "\n" for row in zip(*columns, strict=True))


# name: text or bytes, the arguments of the sentence ({} where it is read without), a check where the data are not G, or U and Y
CASES = {
    "german.csv": (
        ("Frequenz [Hz];Betrag [dB];Phase [°]\n" + rows(HZ, DB, DEG, separator=";", comma=True)).encode("latin-1"),
        {},
    ),
    "analyser.txt": (rows(HZ, G.real, G.imag, separator=" "), {"fields": CARTESIAN}),
    "analyser.csv": (
        "Instrument,FFT 35670\nDate,2026-11-23\nPoints,8\n\nFrequency,H1 Magnitude,H1 Phase\nHz,dB,deg\n"
        + rows(HZ, DB, DEG),
        {},
    ),
    "two channels.csv": (
        "Frequency,Ch1,,Ch2,\n,Re,Im,Re,Im\nHz,,,,\n" + rows(HZ, G.real, G.imag, U, Y),
        {"fields": {"omega": "Frequency [Hz]", "real": "Ch1 Re", "imag": "Ch1 Im"}},
    ),
    "labview.lvm": (
        "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t,\n***End_of_Header***\t\nX_Value\tdrive\tsensor\tComment\n"
        + rows(T, U, Y, separator="\t", comma=True).replace("\n", "\t\n"),
        {"fields": {"time": "X_Value", "u": "drive", "y": "sensor"}},
    ),
    "save_ascii.dat": (rows(T, U, Y, separator="  ", digits="{:16.9e}"), {"fields": SIGNALS}),
    "savetxt.txt": ("# time u y\n" + rows(T, U, Y, separator=" ", digits="{:.18e}"), {}),
    "index.csv": (",time [ms],u,y\n" + rows(np.arange(8), 1e3 * T, U, Y), {}),
    "excel.csv": ("time (s);u;y\n" + rows(T, U, Y, separator=";", comma=True), {}),
    "octave.txt": (
        "# Created by Octave 8.4\n# name: x\n# type: matrix\n# rows: 8\n# columns: 3\n" + rows(T, U, Y, separator=" "),
        {"fields": SIGNALS},
    ),
    "blocks.dat": ("% t u y\n" + rows(T, U, Y, separator="\t").replace("1\n", "1\n\n% more\n"), {}),
    "kilohertz.txt": ("f (kHz)\tRe\tIm\n" + rows(HZ / 1e3, G.real, G.imag, separator="\t"), {}),
    "radians.txt": (
        "omega [rad/s] | abs [m/N] | arg G [rad]\n" + rows(2 * np.pi * HZ, np.abs(G), RAD, separator=" | "),
        {},
    ),
    "writematrix.csv": (
        cells(HZ, [f"{z.real}{z.imag:+}i" for z in G]),
        {"fields": {"freq_hz": "[:,0]", "values": "[:,1]"}},
    ),
    "fortran.out": (
        rows(HZ, G.real, G.imag, separator="  ", digits="{:.10e}").replace("e", "D"),
        {"fields": CARTESIAN},
        lambda frf: same_response(frf, 1e-9),
    ),
    "unicode.txt": (("t [s]\tu [V]\ty [m]\n" + rows(T, U, Y, separator="\t", comma=True)).encode("utf-16"), {}),
    "quoted.csv": ('"t (s)","u (V)","y (m)"\n' + cells(*([f'"{v}"' for v in column] for column in (T, U, Y))), {}),
    "stamps.csv": ("stamp,u,y\n" + cells([f"2026-11-23 08:00:00.{k:02d}" for k in range(8)], U, Y), {"dt": DT}),
    "decimals.txt": (
        "0,5\n0,6\n0,7\n",
        {"decimal": ",", "fields": {"u": "[:,0]", "y": "[:,0]"}, "dt": DT},
        lambda record: np.testing.assert_array_equal(record.u[:, 0], [0.5, 0.6, 0.7]),
    ),
    "no axis.txt": (
        "Real Imag\n" + rows(G.real, G.imag, separator=" "),
        {"fields": {"real": "Real", "imag": "Imag"}, "start": 1.0, "step": 1.0, "frequency_unit": "Hz"},
        lambda frf: np.testing.assert_array_equal((frf.values[:, 0, 0], frf.freq_hz.round(9)), (G, np.arange(1.0, 9))),
    ),
    "no unit.csv": ("frequency,real,imag\n" + rows(HZ, G.real, G.imag), {"frequency_unit": "Hz"}),
    "same names.csv": ("x,x,x\n" + rows(T, U, Y), {"fields": SIGNALS}),
    "twice.csv": (
        "Time (s),Force (N),Time (s),Position (m)\n" + rows(T, U, T, Y),
        {"fields": {"time": "Time (s)", "u": "Force (N)", "y": "Position (m)"}},
    ),
    "amplitudes.csv": (
        "Time,Amplitude,Time,Amplitude\n" + rows(T, U, T, Y),
        {"fields": {"time": "Time", "u": "Amplitude", "y": "Amplitude 2"}},
    ),
    "numbered already.csv": ("x,x,x 2\n" + rows(T, U, Y), {"fields": SIGNALS}),
    "two clocks.csv": (
        "Time,u,Time,y\n" + rows(T, U, T + DT / 3, Y),
        {"fields": {"time": "[:,0]", "u": "[:,1]", "y": "[:,3]"}},
    ),
    "multi.lvm": (
        "X_Value\tdrive\tX_Value\tsensor\tComment\n" + rows(T, U, T, Y, separator="\t"),
        {"fields": {"time": "X_Value", "u": "drive", "y": "sensor"}},
    ),
    "scope.csv": (
        "Record Length,Analog:8\nSource,CH1,CH2\nSecond,Volt,Volt\n" + rows(T, U, Y),
        {"fields": {"time": "Source [Second]", "u": "CH1 [Volt]", "y": "CH2 [Volt]"}},
    ),
    "slow sensor.csv": (
        "t,u,y\n" + cells([k / 8 for k in range(4 * U.size)], np.repeat(U, 4), [y for v in Y for y in (v, "", "", "")]),
        {"fields": {role: f"{name}[0:{4 * U.size}:4]" for role, name in zip(("time", "u", "y"), "tuy", strict=True)}},
        lambda record: same_record(record, dt=0.5),
    ),
    "two signals.prn": (rows(U, Y, separator="   "), COLUMNS, lambda record: same_record(record, dt=1.0)),
    "ltspice.txt": (
        "Freq.\tV(out)\n" + "".join(f"{f:.15e}\t{z.real:.15e},{z.imag:.15e}\n" for f, z in zip(HZ, G, strict=True)),
        SPICE,
    ),
    "ltspice_polar.txt": (
        "Freq.\tV(out)\n" + "".join(f"{f:.15e}\t({a:.15e}dB,{b:.15e}°)\n" for f, a, b in zip(HZ, DB, DEG, strict=True)),
        SPICE,
    ),
    "minus one first.txt": (
        rows(-1 - U, Y, separator=" "),
        COLUMNS,
        lambda record: np.testing.assert_array_equal(record.u[:, 0], -1 - U),
    ),
    "entries.csv": (
        "frequency_hz,H11,H21\n" + cells(HZ, [f"{z:.17g}" for z in G], [f"{2 * z:.17g}" for z in G]),
        {},
        lambda frf: np.testing.assert_array_equal(frf.values[:, :, 0], np.stack([G, 2 * G], axis=1)),
    ),
    "estimate.csv": (
        "f,txy\n" + cells(HZ, [f"{z:.17g}" for z in G]),
        {"frequency_unit": "Hz", "fields": {"freq_hz": "f", "values": "txy"}},
    ),
    "short.csv": (
        "f_Hz;amp_dB;phi_deg\n" + rows(HZ, DB, DEG, separator=";", comma=True),
        {"fields": {"omega": "f_Hz", "magnitude_db": "amp_dB", "phase_deg": "phi_deg"}},
    ),
    "footer.csv": ("freq_hz,real,imag\n" + rows(HZ, G.real, G.imag) + "\nTotal points: 8\nOperator, Smith, x\n", {}),
    "empty cells.csv": ("freq_hz,real,imag\n" + rows(HZ, G.real, G.imag) + "\n9,,\n", {}),
    "touchstone.s1p": ("! analyser\n# kHz S MA R 50\n" + rows(HZ / 1e3, np.abs(G), DEG, separator=" "), {}),
}


@pytest.mark.parametrize("name", CASES)
def test_foreign_texts(tmp_path, name):
    content, options, *check = CASES[name]
    path = tmp_path / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    if name.endswith(".s1p"):
        pytest.importorskip("skrf")
    data = followed(path, options)
    (check or [same_record if isinstance(data, TimeRecord) else same_response])[0](data)
