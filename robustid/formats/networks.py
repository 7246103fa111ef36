"""Files of network analysis: Touchstone (scattering parameters), read through scikit-rf, and SPICE subcircuits of models."""

from __future__ import annotations

import io
import os
import re
import warnings
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np

from robustid.core import Complex, Real, StateMatrices, atomic_write, scaled_states
from robustid.errors import FileFormatError, InputError
from robustid.formats.table import Table, missing, said

TOUCHSTONE = re.compile(r"\.s(\d+)p", re.IGNORECASE)
SPICE = (".cir", ".sp", ".lib", ".sub")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eEdD][-+]?\d+)?")
_PAIRS = 4  # complex numbers a line of Touchstone holds at most


def is_network(path: str | os.PathLike[str]) -> bool:
    """Say whether the ending of a path is one of network analysis."""
    suffix = Path(path).suffix
    return bool(TOUCHSTONE.fullmatch(suffix)) or suffix.lower() in SPICE


def scattering_of(values: Complex, parameter: str, reference: float) -> Complex:
    """Scattering parameters (F, m, m), of themselves or of impedances or admittances, at a reference resistance."""
    if parameter == "s":
        return values
    eye = np.eye(values.shape[1])
    scaled = values / reference if parameter == "z" else values * reference
    flipped = np.linalg.solve((scaled + eye).transpose(0, 2, 1), (scaled - eye).transpose(0, 2, 1)).transpose(0, 2, 1)
    return np.asarray(flipped if parameter == "z" else -flipped, dtype=complex)


def scattering_model(system: StateMatrices, parameter: str, reference: float) -> StateMatrices:
    """A model of scattering parameters, of itself or of a model of impedances or admittances, at a reference resistance."""
    if parameter == "s":
        return system
    A, B, C, D = system
    scale = 1 / reference if parameter == "z" else reference
    eye = np.eye(len(D))
    inverse = np.linalg.inv(scale * D + eye)
    sign = 1.0 if parameter == "z" else -1.0
    back = np.asarray(B @ inverse, dtype=float)
    out = np.asarray(inverse @ C, dtype=float)
    # Z/R + I = V: (V - 2 I) V^{-1} = I - 2 V^{-1}
    return StateMatrices(A - scale * back @ C, back, sign * 2 * scale * out, sign * (eye - 2 * inverse))


def read_touchstone(path: Path) -> Table:
    """S-parameters: outgoing waves b from incoming waves a."""
    try:
        from skrf.io.touchstone import Touchstone
    except ImportError:
        raise missing(path, "scikit-rf", "touchstone") from None
    counts = _touchstone_lines(path)
    try:
        with warnings.catch_warnings(), redirect_stdout(io.StringIO()), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            file = Touchstone(str(path))
    except Exception as error:  # scikit-rf raises whatever the broken bytes lead it to
        raise FileFormatError(
            f"{path.name} can't be read as Touchstone ({_text_in(path) or said(error)}); is it cut off, or the number of"
            " ports in its ending wrong?"
        ) from None
    if file.parameter != "s":
        raise FileFormatError(
            f"{path.name} holds {str(file.parameter).upper()}-parameters; convert them to S-parameters (scikit-rf does) first"
        )
    lines, ports = len(file.f), int(file.rank or 0)
    rows = 0 if file.noise is None else len(file.noise)
    if not lines or counts != lines + rows:
        raise FileFormatError(
            f"{path.name}: {counts} lines begin a frequency where {lines} frequencies of {ports} x {ports} parameters were"
            " read; is the file cut off, or the number of ports in its ending wrong?"
        )
    table = Table(path, {"freq_hz": np.asarray(file.f), "values": np.asarray(file.s)}, how="Touchstone, S-parameters")
    waves = {"inputs": "a", "outputs": "b"}
    table.facts["frequency"] = {"dt": None} | {s: [f"{w}{k + 1}" for k in range(ports)] for s, w in waves.items()}
    return table


def _text_in(path: Path) -> str:
    """The first line that begins with a number and holds a word, in words; empty where there is none."""
    with path.open(encoding="latin-1") as file:
        for row, line in enumerate(file, start=1):
            words = line.partition("!")[0].split()
            numbers = [_NUMBER.fullmatch(word) for word in words]
            if numbers and numbers[0] and not all(numbers):
                return f"line {row}: {words[numbers.index(None)][:40]!r} is not a number"
    return ""


def _touchstone_lines(path: Path) -> int:
    """Count the lines that begin a frequency: those with an odd number of numbers. Refuses what would allocate without end."""
    size, odd, options = os.path.getsize(path), 0, 0
    ports = re.fullmatch(r"\.[sgyzh](\d+)p", path.suffix.lower())
    stated = [int(ports[1][:9])] if ports else []
    with path.open(encoding="latin-1") as file:
        for line in file:
            words = line.partition("!")[0].split()
            options += line.lstrip().startswith("#")
            if words[:3] and line.lstrip().lower().startswith(("[number of ports]", "[number of noise")):
                stated += [int(word[:9]) for word in words[-1:] if word.isdigit()]
            elif words and words[0][0] not in "#[":
                odd += len(words) % 2
    if not options:
        raise FileFormatError(
            f"{path.name} has no option line such as '# Hz S RI R 50', which says the unit of its frequencies"
        )
    if any(4 * n * n > size for n in stated[:1]) or any(n > size for n in stated):
        raise FileFormatError(f"{path.name} declares {max(stated)} ports and has {size} bytes only; is it cut off?")
    return odd


def write_touchstone(
    path: str | os.PathLike[str], omega: Real, values: Complex, reference: float, note: str = ""
) -> None:
    """Write scattering parameters (F, m, m) at frequencies in rad/s: version 1, real and imaginary parts, 17 digits."""
    ports = values.shape[1]
    found = TOUCHSTONE.fullmatch(Path(path).suffix)
    if found is None or int(found[1][:9]) != ports:
        raise InputError(f"`path` must end in .s{ports}p, for {ports} ports; got {str(path)!r}")
    # The standard writes two ports by columns, and any other number by rows.
    ordered = values.transpose(0, 2, 1) if ports == 2 else values
    with atomic_write(path) as file:
        for line in note.splitlines():
            file.write(f"! {line}\n")
        file.write(f"# Hz S RI R {reference:.17g}\n")
        for hz, matrix in zip((omega / (2 * np.pi)).tolist(), ordered, strict=True):
            rows = [matrix.ravel()] if ports <= 2 else list(matrix)
            lines = [row[k : k + _PAIRS] for row in rows for k in range(0, len(row), _PAIRS)]
            words = [" ".join(f"{x.real:.17g} {x.imag:.17g}" for x in line.tolist()) for line in lines]
            file.write(f"{hz:.17g} " + "\n".join(words) + "\n")


def write_spice(path: str | os.PathLike[str], system: StateMatrices, reference: float, note: str = "") -> None:
    r"""Write a subcircuit whose ports have the scattering parameters of a model.

    .. math:: \dot x = A x + B w, \quad y = C x + D w, \quad w = 2 v - y, \quad i = (v - y)/R

    with port voltages v and port currents i, since ``w = v + R i`` and ``y = v - R i`` are the waves, both times 2 sqrt(R). States
    are voltages of capacitors; all else are resistors and voltage-controlled current sources.
    """
    name = re.sub(r"\W", "_", Path(path).stem) or "network"
    with atomic_write(path) as file:
        for line in note.splitlines():
            file.write(f"* {line}\n")
        ports = " ".join(f"p{k + 1}" for k in range(len(system.D)))
        file.write(f".subckt {name} {ports} ref\n")
        file.writelines(f"{line}\n" for line in _elements(system, reference))
        file.write(f".ends {name}\n")


def _elements(system: StateMatrices, reference: float) -> Iterator[str]:
    """The lines of the subcircuit; frequencies in units of the fastest pole, so that no element is extreme."""
    A, B, C = scaled_states(system.A, system.B, system.C)
    unit = float(np.max(np.abs(np.linalg.eigvals(A)), initial=0.0)) or 1.0
    for k in range(len(A)):
        yield f"Cx{k + 1} x{k + 1} 0 {1 / unit:.17g}"
        yield from _sources(f"x{k + 1}", "x", A[k] / unit)
        yield from _sources(f"x{k + 1}", "w", B[k] / unit)
    for k in range(len(system.D)):
        port = k + 1
        yield f"Ry{port} y{port} 0 1"
        yield from _sources(f"y{port}", "x", C[k])
        yield from _sources(f"y{port}", "w", system.D[k])
        yield f"Rw{port} w{port} 0 1"
        yield f"Gw{port}_v 0 w{port} p{port} ref 2"
        yield f"Gw{port}_y 0 w{port} y{port} 0 -1"
        yield f"Rp{port} p{port} ref {reference:.17g}"
        yield f"Gp{port} ref p{port} y{port} 0 {1 / reference:.17g}"


def _sources(node: str, kind: str, gains: Real) -> Iterator[str]:
    """Currents into a node, each a gain times the voltage of a node of one kind."""
    for k, gain in enumerate(gains.tolist()):
        if gain:
            yield f"G{node}_{kind}{k + 1} 0 {node} {kind}{k + 1} 0 {gain:.17g}"
