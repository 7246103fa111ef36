"""Shared by the tests: files as other programs write them, made from the descriptions of their formats."""

import json
import struct
from typing import NamedTuple

import numpy as np
import pytest

from robustid import load
from robustid.errors import RobustIdError
from support.matlab_objects import matrix


class Function(NamedTuple):
    """One function of a universal file (58)."""

    kind: int  # 1 time response, 4 frequency response
    response: tuple[int, int]
    reference: tuple[int, int]
    start: float
    step: float  # 0: uneven
    data: np.ndarray
    quantity: int = 12
    x: np.ndarray | None = None
    double: bool = True


def uff58(path, functions, *, binary=False):
    """Universal file, data set 58, records 1 to 12 as "Universal File Datasets Summary" of SDRC describes them."""
    parts = []
    for f in functions:
        is_complex = np.iscomplexobj(f.data)
        code = (6 if is_complex else 4) if f.double else (5 if is_complex else 2)
        flat = np.column_stack([f.data.real, f.data.imag]) if is_complex else f.data[:, None]
        if f.step == 0:
            flat = np.column_stack([f.x, flat])
        axis, label, unit = (18, "Frequency", "Hz") if f.kind == 4 else (17, "Time", "s")
        lines = [
            "Rig 3, run 7", "NONE", "23-NOV-26 08:00:00", "NONE", "NONE",
            f"{f.kind:5d}{0:10d}{0:5d}{0:10d} {'NONE':10s}{f.response[0]:10d}{f.response[1]:4d}"
            f" {'NONE':10s}{f.reference[0]:10d}{f.reference[1]:4d}",
            f"{code:10d}{len(f.data):10d}{int(f.step != 0):10d}{f.start:13.5e}{f.step:13.5e}{0.0:13.5e}",
            f"{axis:10d}{0:5d}{0:5d}{0:5d} {label:20s} {unit:20s}",
            f"{f.quantity:10d}{0:5d}{0:5d}{0:5d} {'Answer':20s} {'N' if f.quantity == 13 else 'm/s^2':20s}",
            f"{13 if f.kind == 4 else 0:10d}{0:5d}{0:5d}{0:5d} {'Force':20s} {'N':20s}",
            f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':20s} {'NONE':20s}",
        ]  # fmt: skip
        flat = flat.reshape(-1)
        if binary:
            raw = flat.astype("<f8" if f.double else "<f4").tobytes()
            head = f"{58:6d}b{1:6d}{2:6d}{11:12d}{len(raw):12d}{0:6d}{0:6d}{0:12d}{0:12d}"
            body = raw + b"\n"
        else:
            head = f"{58:6d}"
            width, count = ("20.11e", 4) if f.double else ("13.5e", 6)
            rows = ["".join(f"{v:{width}}" for v in flat[k : k + count]) for k in range(0, len(flat), count)]
            body = ("\n".join(rows) + "\n").encode()
        parts.append("\n".join(["    -1", head, *lines]).encode() + b"\n" + body + b"    -1\n")
    path.write_bytes(b"".join(parts))
    return path


def matlab5(path, variables):
    """MATLAB v5 file, uncompressed: full double matrices, texts and 1 x 1 structures, from the MAT-file format description."""

    def numeric(value):
        """Lists are arrays here, not cells."""
        if isinstance(value, dict):
            return {name: numeric(item) for name, item in value.items()}
        return np.asarray(value) if isinstance(value, list) else value

    header = b"MATLAB 5.0 MAT-file, Platform: GLNXA64".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    path.write_bytes(header + b"".join(matrix(numeric(value), name) for name, value in variables.items()))
    return path


def matlab4(path, variables):
    """MATLAB v4 file: full double matrices."""
    parts = []
    for name, value in variables.items():
        array = np.atleast_2d(np.asarray(value))
        imaginary = int(np.iscomplexobj(array))
        parts.append(struct.pack("<5i", 0, *array.shape, imaginary, len(name) + 1) + name.encode() + b"\0")
        parts.append(array.real.astype("<f8").tobytes(order="F"))
        if imaginary:
            parts.append(array.imag.astype("<f8").tobytes(order="F"))
    path.write_bytes(b"".join(parts))
    return path


def npy(path, array, *, fortran=False):
    """NumPy array, version 1.0, from the description of the format."""
    array = np.asarray(array)
    header = f"{{'descr': '{array.dtype.str}', 'fortran_order': {fortran}, 'shape': {array.shape}, }}"
    header = header.ljust(-(len(header) + 11) % 64 + len(header)) + "\n"
    data = array.tobytes(order="F" if fortran else "C")
    path.write_bytes(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode() + data)
    return path


HZ = np.array([1.0, 2.0, 4.0, 5.0, 8.0, 10.0, 12.5, 16.0])
G = np.array([2 - 1j, 1.5 - 1.25j, 0.5 - 2j, -0.25 - 1j, -0.5 - 0.5j, -0.25 - 0.125j, -0.125 + 0.0625j, 0.5 + 0.25j])
U = np.array([0.0, 1.0, 1.0, -0.5, 0.25, 2.0, -1.0, 0.5])
Y = np.array([0.0, 0.0, 0.5, 0.75, 0.125, 0.25, 1.5, -0.25])
DT = 0.01


def same_response(frf, tolerance=1e-12):
    """The response above, to rounding of what a text holds."""
    np.testing.assert_allclose(frf.freq_hz, HZ, rtol=max(tolerance, 1e-14))
    np.testing.assert_allclose(frf.values[:, 0, 0], G, rtol=tolerance, atol=tolerance)


def same_record(record, tolerance=1e-12, dt=DT):
    """The record above."""
    np.testing.assert_allclose(record.u[:, 0], U, rtol=tolerance, atol=tolerance)
    np.testing.assert_allclose(record.y[:, 0], Y, rtol=tolerance, atol=tolerance)
    assert abs(record.dt - dt) <= 1e-9 * dt


def rows(*columns, separator=",", digits="{:.17g}", comma=False):
    """Lines of numbers."""
    lines = [separator.join(digits.format(value) for value in row) for row in zip(*columns, strict=True)]
    text = "\n".join(lines) + "\n"
    return text.replace(".", ",") if comma else text


def quoted(name, value):
    """An argument as the sentences write it."""
    if name == "fields":
        return f"fields={json.dumps(value)}"
    return f"{name}='{value}" if name in ("axes", "decimal") else f"{name}="


def followed(path, options):
    """What a file holds, loaded with only those arguments that the sentences name one after the other."""
    given = {}
    while set(given) != set(options):
        with pytest.raises(RobustIdError) as refused:
            load(path, **given)
        told = str(refused.value)
        named = {
            name: value
            for name, value in options.items()
            if quoted(name, value) in told.replace('="', "='") or quoted(name, value) in told or f"`{name}`" in told
        }
        assert not set(named) <= set(given), f"after {given}: {told}"
        given |= named
    return load(path, **options)
