"""Shared by the tests: files as the programs of measuring instruments write them, made from examples that these published."""

import base64

import numpy as np

HZ = np.array([1e4, 3162.2777, 1e3, 316.22777, 100.0, 31.622777, 10.0, 3.1622777, 1.0])  # downwards, as these sweep
W = 2j * np.pi * HZ
CELL = 0.0125 + 2e-7 * W + 0.02 / (1 + 0.05 * W) + 0.004 / (1 + 3e-4 * W)  # ohm
SPEAKER = 6.2 + 4e-4 * W + 30 * 20 * W / (W**2 + 20 * W + 350**2)  # ohm, resonance near 56 Hz
MATRIX = np.stack(
    [[0.4 + 1e-3 * W, -0.1 - 3e-4 * W], [0.12 + 3e-4 * W, 0.45 + 1.1e-3 * W]]
)  # (2, 2, F): Zdd, Zdq; Zqd, Zqq, ohm
HZ_RADIO = np.array([1e8, 5e8, 1e9, 2e9, 3e9])
S = np.stack([[0.2 * np.exp(-1j * HZ_RADIO / 1e9), 0.9 * np.exp(-2j * HZ_RADIO / 1e9)],
              [0.8 * np.exp(-2j * HZ_RADIO / 1e9), 0.1 * np.exp(-3j * HZ_RADIO / 1e9)]])  # fmt: skip
PORTS = [(0, 0), (0, 1), (1, 0), (1, 1)]


def decibels(values):
    """Magnitudes in dB."""
    return 20 * np.log10(np.abs(values))


def degrees(values):
    """Angles in degrees."""
    return np.rad2deg(np.angle(values))


def lines(*columns, separator="\t", number="{:.7E}", end="\r\n", first="", last="", comma=False):
    """Lines of numbers as a program writes them: what stands before and behind each, the decimal mark, the end of a line."""
    rows = (separator.join(number.format(value) for value in row) for row in zip(*columns, strict=True))
    text = "".join(f"{first}{row}{last}{end}" for row in rows)
    return text.replace(".", ",") if comma else text


def counted(values):
    """Numbers of the rows, from 0."""
    return np.arange(len(values))


_EC_LAB = """EC-Lab ASCII FILE
Nb header lines : {count}                          

Potentio Electrochemical Impedance Spectroscopy

Run on channel : 1 (SN 30924)
Ewe ctrl range : min = -2.50 V, max = 2.50 V
Electrode surface area : 0.001 cm²
Mode                Single sine         
E (V)               0.0000              
tE (h:m:s)          0:00:0.0000         
dt (s)              0.000               
fi                  10.000              
unit fi             kHz                 
Nd                  9                   
goto Ns'            0                   

"""  # noqa: W291


def ec_lab(comma=False):
    """EC-Lab (BioLogic), .mpt: a head whose length its second line says, Latin-1, a tab behind the last cell."""
    names = "freq/Hz\tRe(Z)/Ohm\t-Im(Z)/Ohm\t|Z|/Ohm\tPhase(Z)/deg"
    names += "\ttime/s\t<Ewe>/V\t<I>/mA\tCs/µF\tcycle number\tRe(Y)/Ohm-1\tIm(Y)/Ohm-1\t\n"
    Y = 1 / CELL
    body = lines(HZ, CELL.real, -CELL.imag, abs(CELL), degrees(CELL), counted(HZ) + 0.5, 3.3 + 0 * HZ, 1.5 + 0 * HZ, 1e3 + 0 * HZ,
                 1 + 0 * HZ, Y.real, Y.imag, last="\t", comma=comma)  # fmt: skip
    head = _EC_LAB.format(count=_EC_LAB.count("\n") + 1)
    return (head + names).replace("\n", "\r\n").encode("latin-1") + body.encode("latin-1")


def ec_lab_text():
    """EC-Lab, export as text of three columns."""
    return ("freq/Hz\tRe(Z)/Ohm\t-Im(Z)/Ohm\t\r\n" + lines(HZ, CELL.real, -CELL.imag, last="\t")).encode()


def gamry(comma=False, rest=True):
    """Gamry Framework, .DTA: tables that begin with a tab, one of the potential at rest before that of the impedance."""
    at_rest = "\tPt\tT\tVf\tVm\tAch\tOver\tTemp\r\n\t#\ts\tV vs. Ref.\tV\tV\tbits\tdeg C\r\n"
    at_rest += lines(
        counted(HZ), 0.25 * counted(HZ), -0.3 + 0 * HZ, first="\t", last="\t0.1\t0.1\t..........a\t-327.67"
    )
    head = "EXPLAIN\r\nTAG\tEISPOT\r\nTITLE\tLABEL\tPotentiostatic EIS\tTest &Identifier\r\n"
    head += "NOTES\tNOTES\t1\t&Notes...\r\n\tcell 8\r\n"
    head += "FREQINIT\tQUANT\t1.00000E+004\tInitial Fre&q. (Hz)\r\nZGUESS\tQUANT\t1.00000E+002\tE&stimated Z (ohms)\r\n"
    names = "\tPt\tTime\tFreq\tZreal\tZimag\tZsig\tZmod\tZphz\tIdc\tVdc\tIERange\r\n\t#\ts\tHz\tohm\tohm\tV\tohm\t°\tA\tV\t#\r\n"
    body = lines(counted(HZ), counted(HZ) + 1, HZ, CELL.real, CELL.imag, 1 + 0 * HZ, abs(CELL), degrees(CELL), -3e-6 + 0 * HZ,
                 -0.34 + 0 * HZ, 7 + 0 * HZ, first="\t", number="{:.9g}")  # fmt: skip
    rests = f"OCVCURVE\tTABLE\t9\r\n{at_rest}EOC\tQUANT\t-0.29\tOpen Circuit (V)\r\n" * rest
    text = f"{head}{rests}ZCURVE\tTABLE\r\n{names}{body}"
    return (text.replace(".", ",") if comma else text).encode("latin-1")


def zplot():
    """ZPlot (Scribner, with Solartron analysers), .z: names, then a line "End Comments"."""
    head = "ZPLOT2 ASCII\r\n  Measured Data, ZPlot:       3.2c\r\n  Date:                       10-12-2018\r\n"
    head += (
        "  Begin Experiment:           0\r\n    Potential-DC:             0\r\n    vs Freq-Initial:          300000\r\n"
    )
    names = "  Data Points:                9\r\n"
    names += "  Freq(Hz)\tAmpl\tBias\tTime(Sec)\tZ'(a)\tZ''(b)\tGD\tErr\tRange\r\nEnd Comments\r\n"
    zero = 0 * HZ
    body = lines(HZ, 0.01 + zero, zero, counted(HZ), CELL.real, CELL.imag, zero, zero, 3 + zero, number="{:.6E}")
    return (head + names + body).encode()


def zplot_windows():
    """ZPlot for Windows: quoted lines, the names one text with spaces, numbers with commas and spaces."""
    head = '"ZPlotW Data File: Version 3.2c"\r\n"Raw Data"\r\n"Sweep Frequency: Control Voltage"\r\n'
    head += "Date: 12-17-2019    Time: 16:24:35\r\n"
    head += '1.7 sccm CO, 1.50 sccm CO2, 800 C\r\n"Open Circuit Potential (V):  0 "\r\n"Frequency"\r\n0,3,0,1,300000,0.005\r\n9\r\n'
    names = "\"  Freq(Hz)    Ampl     Bias   Time(Sec)   Z'(a)    Z''(b)    GD   Err   Range\"\r\n"
    zero = 0 * HZ
    body = lines(
        HZ, 0.01 + zero, zero, counted(HZ), CELL.real, CELL.imag, zero, zero, 5 + zero, separator=", ", number="{:.6E}"
    )
    return (head + names + body).encode()


def z60():
    """Z60 files as Autolab exports them for ZView: as of ZPlot, the lines above the names empty texts."""
    head = '"Z60W Data File: Version 1.1"\r\n' + '""\r\n' * 7 + "0,2,0,1,0.1,10000\r\n9\r\n"
    names = "\"  Freq (Hz)    Ampl     Bias   Time(Sec)   Z'(a)    Z''(b)    GD   Err   Range\"\r\n"
    zero = counted(HZ) * 0
    body = lines(HZ, zero, zero, zero, CELL.real, CELL.imag, zero, zero, zero, separator=",", number="{:.15g}")
    return (head + names + body).encode()


def nova(separator="\t", comma=False):
    """NOVA (Autolab): minus signs in the names of imaginary part and phase, ohm as a letter, a mark of the byte order."""
    names = separator.join(["Index", "Frequency (Hz)", "Z' (Ω)", "-Z'' (Ω)", "Z (Ω)", "-Phase (°)", "Time (s)"])
    body = lines(counted(HZ) + 1, HZ, CELL.real, -CELL.imag, abs(CELL), -degrees(CELL), counted(HZ), separator=separator,
                 number="{:.14g}", comma=comma)  # fmt: skip
    return (names + "\r\n" + body).encode("utf-8-sig")


def ch_instruments():
    """CH Instruments: a stroke before the units, one quotation mark in a name, magnitude without bars."""
    head = "Feb. 20, 2020   15:55:08\r\nA.C. Impedance\r\nFile: c:\\eis.bin\r\n"
    head += "Instrument Model:  CHI660E\r\nHeader: \r\nNote: \r\n\r\n"
    head += "Init E (V) = 0\r\nHigh Frequency (Hz) = 1e+4\r\nAmplitude (V) = 0.025\r\nCycles (.1-1Hz) = 1\r\n\r\n"
    names = "Freq/Hz, Z'/ohm, Z\"/ohm, Z/ohm, Phase/deg\r\n\r\n"
    body = lines(HZ, CELL.real, CELL.imag, abs(CELL), degrees(CELL), separator=", ", number="{:.7e}")
    return (head + names + body).encode()


def versastudio():
    """VersaStudio (Princeton), .par: sections in angle brackets, names behind "Definition=" with a zero at their end."""
    names = "Segment #, Point #, E(V), I(A), Elapsed Time(s), Frequency(Hz), "
    names += "E Real, E Imag, I Real, I Imag, Z Real, Z Imag, ActionId, 0"
    zero = 0 * HZ
    body = lines(zero, counted(HZ), zero, zero, counted(HZ), HZ, 0.02 * CELL.real, 0.02 * CELL.imag, 0.02 + zero, zero, CELL.real,
                 CELL.imag, 21 + zero, separator=",", number="{:.9g}")  # fmt: skip
    head = "<Application>\r\nName=VersaStudio\r\n</Application>\r\n\r\n"
    head += "<Action1>\r\nAmplitude (mV RMS)=20\r\nSegments=1\r\n</Action1>\r\n\r\n"
    graph = "</Segment1>\r\n\r\n<Graph1>\r\nHeight=291\r\nWidth=1023\r\nXAxisName=Frequency (Hz)\r\n</Graph1>\r\n"
    return f"{head}<Segment1>\r\nType=2\r\nVersion=3\r\nDefinition={names}\r\n{body}{graph}".encode()


def parstat():
    """PARSTAT: rows of the potential at rest, with a frequency of zero, before those of the impedance."""
    names = "Potential (V)\tCurrent (A)\tElapsed Time (s)\tFrequency (Hz)\tZre (ohms)\tZim (ohms)\t|Vac| (V)\t|Iac| (A)\t\r\n"
    rest = lines(3.49 + 0 * HZ, -0.15 + 0 * HZ, 10 * counted(HZ), *[0 * HZ] * 5, number="{:.9g}", last="\t")
    body = lines(3.49 + 0 * HZ, -0.15 + 0 * HZ, 90 + counted(HZ), HZ, CELL.real, CELL.imag, abs(CELL), 1 + 0 * HZ, number="{:.9g}",
                 last="\t")  # fmt: skip
    return (names + rest + body).encode()


def powersuite():
    """PowerSuite: no units at all, spaces behind the tabs."""
    return ("Frequency\t Zre\t Zimg\r\n" + lines(HZ, CELL.real, CELL.imag, separator="\t ", number="{:.9g}")).encode()


def zahner():
    """Zahner, comma-separated: four lines of the experiment above the names; modulus and phase."""
    head = "File Name: cell.ism\r\nPotential: 3.3 V\r\nCurrent: 0.1 A\r\nAmpl: 5 mV\r\n"
    names = "Number,Frequency/Hz,Impedance/Ohm,Phase/deg,Significance,Time/s\r\n"
    body = lines(counted(HZ), HZ, abs(CELL), degrees(CELL), 1 + 0 * HZ, counted(HZ), separator=",", number="{:.9g}")
    return (head + names + body).encode()


def thales():
    """Thales (Zahner), list as text: columns of spaces, the phase in radians."""
    names = "    Number           Frequency/Hz      Impedance/Ohm         Phase/rad       Significance\r\n"
    body = lines(counted(HZ), HZ, abs(CELL), np.angle(CELL), 1 + 0 * HZ, separator="  ", number="{:17.9e}")
    return (names + body).encode()


def pstrace():
    """PSTrace (PalmSens): UTF-16, the phase negated."""
    head = "Date and time:,2025-01-01 00:00:00\r\nNotes:\r\nMeasurement:,Impedance Spectroscopy\r\nCH 3: Fixed at 9 freqs\r\n"
    names = "freq / Hz,neg. Phase / °,Idc / uA,Z / Ohm,Z' / Ohm,-Z'' / Ohm,Cs / F\r\n"
    body = lines(
        HZ, -degrees(CELL), 1 + 0 * HZ, abs(CELL), CELL.real, -CELL.imag, 1e-3 + 0 * HZ, separator=",", number="{:.9g}"
    )
    return (head + names + body).encode("utf-16")


def smart():
    """SMaRT (Solartron), comma-separated: magnitude and phase in words."""
    names = "Time (s),Frequency (Hz),Impedance Magnitude (Ohms),Impedance Phase (Degrees),"
    names += "Admittance Magnitude (S),Admittance Phase (Degrees)\r\n"
    body = lines(
        counted(HZ), HZ, abs(CELL), degrees(CELL), 1 / abs(CELL), -degrees(CELL), separator=",", number="{:.9g}"
    )
    return (names + body).encode()


_REW = "* Measurement data measured by REW V5.20\r\n* Source: USB, volume: no control\r\n"
_REW += "* Format: 1M Log Swept Sine\r\n* Smoothing: None\r\n*\r\n"


def rew(values=SPEAKER, names="Freq(Hz) Z(Ohms) Phase(degrees)", size=np.abs, comma=False):
    """Room EQ Wizard: remarks with asterisks, the last of them the names; impedances, or levels in dB."""
    body = lines(HZ[::-1], size(values[::-1]), degrees(values[::-1]), separator=" ", number="{:.9f}", comma=comma)
    return (_REW + f"* {names}\r\n" + body).encode()


def frd():
    """FRD: frequency in Hz, level in dB, phase in degrees, without names."""
    return lines(HZ[::-1], decibels(SPEAKER[::-1]), degrees(SPEAKER[::-1]), number="{:.9f}").encode()


def zma():
    """ZMA: frequency in Hz, magnitude in ohm, phase in degrees, remarks with asterisks above."""
    body = lines(HZ[::-1], abs(SPEAKER[::-1]), degrees(SPEAKER[::-1]), separator="  ", number="{:.9f}", end="\n")
    return ("* DATS impedance, woofer 8\n*\n" + body).encode()


def zma_titled():
    """The same with names, below a remark of as many words as there are columns."""
    body = lines(HZ, abs(SPEAKER), degrees(SPEAKER), separator=" ", number="{:.9f}", end="\n")
    return ("* Impedance of woofer\n* Freq(Hz) Imp(ohms) Phase(degrees)\n" + body).encode()


_AXES = ("dd", "dq", "qd", "qq")


def dq_parts():
    """Impedances of a grid in dq: real and imaginary parts, semicolons with decimal commas, as a German spreadsheet writes."""
    names = ";".join(["f [Hz]", *(f"{part}{{Z{axes}}} [Ohm]" for axes in _AXES for part in ("Re", "Im"))])
    columns = [part for i, j in PORTS for part in (MATRIX[i, j].real, MATRIX[i, j].imag)]
    return ("﻿" + names + "\r\n" + lines(HZ, *columns, separator=";", number="{:.9g}", comma=True)).encode()


def dq_magnitudes():
    """The same as magnitudes in milliohm and phases, underscores in the names."""
    names = ",".join(["freq_Hz", *(f"Z{axes}_{part}" for axes in _AXES for part in ("mag [mOhm]", "phase_deg"))])
    columns = [part for i, j in PORTS for part in (1e3 * abs(MATRIX[i, j]), degrees(MATRIX[i, j]))]
    return (names + "\n" + lines(HZ, *columns, separator=",", number="{:.9g}", end="\n")).encode()


def dq_decibels():
    """The same in dB of an ohm and degrees, a line of units below the names."""
    names = "\t".join(["Frequency", *(f"{sign}Z{axes}" for axes in _AXES for sign in ("abs ", "arg "))])
    units = "\t".join(["Hz", *["dBOhm", "deg"] * 4])
    columns = [part for i, j in PORTS for part in (decibels(MATRIX[i, j]), degrees(MATRIX[i, j]))]
    return (names + "\n" + units + "\n" + lines(HZ, *columns, number="{:.9g}", end="\n")).encode()


def keysight():
    """Keysight network analysers (PNA), two ports between the lines BEGIN and END; order of the columns as there."""
    names = "Freq(Hz)," + ",".join(f"S{port}({part})" for port in ("21", "11", "22", "12") for part in ("REAL", "IMAG"))
    columns = [part for i, j in ((1, 0), (0, 0), (1, 1), (0, 1)) for part in (S[i, j].real, S[i, j].imag)]
    head = "!CSV A.01.01\r\n!Keysight Technologies,N5247B,US56070639,A.17.30.08\r\n"
    head += "!Date: Friday, September 11, 2026 14:48:21\r\n!Source: Standard\r\n\r\n"
    body = lines(HZ_RADIO, *columns, separator=",", number="{:.9g}")
    return f"{head}BEGIN CH1_DATA\r\n{names}\r\n{body}END\r\n\r\n".encode()


def keysight_decibels():
    """The same of one port, in dB and degrees."""
    body = lines(HZ_RADIO, decibels(S[0, 0]), degrees(S[0, 0]), separator=",", number="{:.9g}")
    head = "!CSV A.01.01\r\n!Agilent Technologies,E5071C,MY46100000,A.09.30\r\n\r\n"
    head += "BEGIN CH1_DATA\r\nFreq(Hz),S11 Log Mag(dB),S11 Phase(deg)\r\n"
    return f"{head}{body}END\r\n".encode()


def rohde_schwarz():
    """Rohde & Schwarz (ZNB): semicolons, also behind the last cell; one trace."""
    body = lines(HZ_RADIO, S[1, 0].real, S[1, 0].imag, separator=";", number="{:.15E}", last=";")
    return ("freq[Hz];re:Trc1_S21;im:Trc1_S21;\r\n" + body).encode()


def impedance_analyser():
    """An impedance analyser: frequencies in MHz, kiloohm, an angle theta."""
    values = 1e3 / (1 + 1j * HZ_RADIO / 1e9)
    names = "Frequency (MHz)\t|Z| (kOhm)\ttheta (deg)\r\n"
    return (names + lines(HZ_RADIO / 1e6, abs(values) / 1e3, degrees(values), number="{:.9g}")).encode(), values


def bode_100():
    """Bode 100 (Omicron): traces with their numbers and quantities in the names, semicolons."""
    names = 'Frequency (Hz);"Trace 1: Gain: Real ";"Trace 1: Gain: Imaginary ";'
    names += 'Trace 1: Gain: Magnitude (dB);"Trace 2: Gain: Real ";'
    names += '"Trace 2: Gain: Imaginary ";Trace 2: Gain: Phase (°)\r\n'
    G = SPEAKER
    body = lines(HZ, G.real, G.imag, decibels(G), G.real, G.imag, degrees(G), separator=";", number="{:.12g}")
    return (names + body).encode()


def vibration_controller():
    """A vibration controller: one column of a matrix of accelerances, its coherence beside it."""
    names = "Frequency [Hz];H11 Re [(m/s²)/N];H11 Im [(m/s²)/N];H21 Re [(m/s²)/N];H21 Im [(m/s²)/N]\r\n"
    columns = [part for one in MATRIX[:, 0, ::-1] for part in (one.real, one.imag)]
    body = lines(HZ[::-1], *columns, separator=";", number="{:.9g}")
    return (names + body).encode("latin-1")


def sr785():
    """SR785, read out by its network programs: remarks, numbers without names."""
    body = lines(HZ[::-1], decibels(SPEAKER[::-1]), degrees(SPEAKER[::-1]), separator="    ", number="{:.9g}", end="\n")
    return ("# SR785 Measurement - Timestamp: Nov 26 2026 - 10:00:00\n# Parameter File: TFSR785.yml\n" + body).encode()


def diagnostics(stimulus="H1:LSC-DARM1_EXC", subtype=3):
    """Diagnostics test tools of LIGO (diaggui), XML: two channels of a swept sine, single precision in base 64.

    Subtype 3: frequencies stand before the values; 0: a first one and a step do.
    """
    channels = ["H1:LSC-DARM1_EXC", "H1:LSC-DARM1_IN1", "H1:LSC-DARM1_IN2"]
    first, second = MATRIX[0, 0][::-1], MATRIX[1, 0][::-1]
    hz = HZ[::-1] if subtype == 3 else 1 + 0.5 * counted(HZ)
    rows = {channels[0]: [1 + 0 * first, first, second], channels[1]: [1 / first, 1 + 0 * first, second / first]}
    results = ""
    for k, (channel, values) in enumerate(rows.items()):
        numbers = np.concatenate([hz] * (subtype == 3) + values).astype("<c8").tobytes()
        text = base64.encodebytes(numbers).decode()
        params = "".join(
            f'<Param Name="ChannelB[{n}]" Type="string" Unit="channel">{name}</Param>\n'
            for n, name in enumerate(channels)
        )
        results += f"""  <LIGO_LW Name="Result[{k}]" Type="TransferFunction">
    <Param Name="Flag" Type="string">Result</Param>
    <Param Name="Subtype" Type="int">{subtype}</Param>
    <Param Name="f0" Type="double" Unit="Hz">1</Param>
    <Param Name="df" Type="double" Unit="Hz">0.5</Param>
    <Param Name="N" Type="int">{len(hz)}</Param>
    <Param Name="M" Type="int">3</Param>
    <Param Name="ChannelA" Type="string" Unit="channel">{channel}</Param>
    {params}<Array Type="floatComplex">
      <Dim>{len(numbers) // 8}</Dim>
      <Stream Encoding="LittleEndian,base64">
{text}      </Stream>
    </Array>
  </LIGO_LW>
"""
    head = '<?xml version="1.0"?>\n<!DOCTYPE LIGO_LW [\n<!ELEMENT LIGO_LW ((LIGO_LW|Comment|Param|Time|Table|Array|Stream)*)>\n]>\n'
    test = '  <LIGO_LW Name="Test" Type="TestParameter">\n'
    test += f'    <Param Name="StimulusChannel" Type="string">{stimulus}</Param>\n  </LIGO_LW>\n'
    return f'{head}<LIGO_LW Name="Diagnostics Test">\n{test}{results}</LIGO_LW>\n'.encode()


def hammer_test(hz, values, coherence):
    """Accelerances (F, 3) of a vibration analyser, universal file 58 as text: each with its coherence, single precision."""
    zero, parts = f"{0:5d}{0:5d}{0:5d}", []
    for k in range(2 * values.shape[1]):
        column, response = k // 2, k % 2 == 0
        numbers = values[:, column] if response else coherence[:, column]
        numbers = np.column_stack([numbers.real, numbers.imag]).ravel() if response else numbers
        sides = [(12, "Acceleration", "m/s^2"), (13, "Force", "N")] if response else [(0, "NONE", "NONE")] * 2
        parts += [
            "    -1",
            "    58",
            *(f"{text:<80}" for text in ("Frequency response", "NONE", "26-Nov-26", "NONE", "NONE")),
        ]
        place = f"{'plate':<10}{column + 1:10d}{3:4d} {'plate':<10}{2:10d}{3:4d}"
        parts += [f"{4 if response else 6:5d}{k:10d}{0:5d}{0:10d} {place}"]
        parts += [f"{5 if response else 2:10d}{len(hz):10d}{1:10d}{hz[0]:13.5e}{hz[1] - hz[0]:13.5e}{0.0:13.5e}"]
        axes = [(18, "Frequency", "Hz"), *sides, (0, "NONE", "NONE")]
        parts += [f"{kind:10d}{zero} {name:<20} {unit:<20}" for kind, name, unit in axes]
        parts += ["".join(f"{one:13.5e}" for one in numbers[at : at + 6]) for at in range(0, len(numbers), 6)]
        parts += ["    -1"]
    return "\r\n".join([*parts, ""]).encode()


def accelerance(hz, values, coherence):
    """One accelerance of a vibration analyser, in g/N, the points of response and hammer in the names, its coherence beside it."""
    names = "Frequency [Hz],H1(2Z+/2Z+) Real [g/N],H1(2Z+/2Z+) Imag [g/N],Coherence\r\n"
    return (names + lines(hz, values.real, values.imag, coherence, separator=",", number="{:.6e}")).encode()


def polar(unit):
    """Magnitude and phase whose titles say no quantity, but a unit."""
    names = f"Frequency [Hz],Magnitude [{unit}],Phase [deg]\r\n"
    return (names + lines(HZ, np.abs(SPEAKER), degrees(SPEAKER), separator=",")).encode()


def gain_and_phase(hz, values):
    """A trace of a Bode 100 in dB and degrees."""
    names = "Frequency (Hz);Trace 1: Gain: Magnitude (dB);Trace 1: Gain: Phase (°)\r\n"
    return (names + lines(hz, decibels(values), degrees(values), separator=";", number="{:.12g}")).encode()


def motion_record(dt, excitation, force, position):
    """A record of a motion controller in loop: what was added to the force, force and position; semicolons, decimal commas."""
    names = "time [s];excitation [N];force [N];position [um]\r\n"
    columns = dt * counted(force), excitation, force, position
    return (names + lines(*columns, separator=";", number="{:.7g}", comma=True)).encode()
