"""Shared by the tests: exchange files."""

import cmath
import math

import numpy as np
import pytest

pyuff = pytest.importorskip("pyuff")
RNG = np.random.default_rng(5)
HZ = np.arange(1, 9) * 0.5
G = RNG.standard_normal((8, 2, 2)) + 1j * RNG.standard_normal((8, 2, 2))
OUTPUTS, INPUTS = [(12, 3), (7, -1)], [(12, 3), (3, 2)]


def function(kind, response, reference, x, data, **changes):
    abscissa = {4: (18, "Hz"), 1: (17, "s"), 6: (18, "Hz")}[kind]
    return pyuff.prepare_58(
        **{
            "binary": 0, "func_type": kind, "rsp_node": response[0], "rsp_dir": response[1], "ref_node": reference[0],
            "ref_dir": reference[1], "data": data, "x": x, "abscissa_spacing": 0, "abscissa_spec_data_type": abscissa[0],
            "abscissa_axis_units_lab": abscissa[1], "ordinate_spec_data_type": 12, "ordinate_axis_units_lab": "m/s^2",
            "orddenom_spec_data_type": 13, "orddenom_axis_units_lab": "N", "id1": "test", "id2": "", "id3": "", "id4": "",
            "id5": "", "rsp_ent_name": "NONE", "ref_ent_name": "NONE", **changes,
        }
    )  # fmt: skip


def matrix(**changes):
    return [
        function(4, response, reference, HZ, G[:, i, j], **changes)
        for j, reference in enumerate(INPUTS)
        for i, response in enumerate(OUTPUTS)
    ]


def write(path, sets):
    pyuff.UFF(str(path)).write_sets(sets, mode="add")  # "overwrite" loses the headers of binary sets
    return path


TIME = np.arange(40) * 0.25


def signal(node, kind, **changes):
    data = RNG.standard_normal(40)
    return function(1, (node, 1), (0, 0), TIME, data, ordinate_spec_data_type=kind, abscissa_spacing=1, **changes)


S = 0.3 * (RNG.standard_normal((6, 2, 2)) + 1j * RNG.standard_normal((6, 2, 2)))


def touchstone(path, values, unit="Hz", style="ri", option=True):
    """By hand: of two ports the order is S11 S21 S12 S22; of more, by rows, a new line each."""
    ports = values.shape[1]
    rows = [f"# {unit} S {style.upper()} R 50"] if option else []
    for k, value in enumerate(values):
        entries = value.T.ravel() if ports == 2 else value.ravel()
        pairs = [
            f"{z.real!r} {z.imag!r}"
            if style == "ri"
            else f"{20 * math.log10(abs(z))!r} {math.degrees(cmath.phase(z))!r}"
            for z in entries.tolist()
        ]
        size = ports if ports > 2 else len(pairs)
        lines = [" ".join(pairs[i : i + size]) for i in range(0, len(pairs), size)]
        rows += [f"{k + 1} {lines[0]}", *lines[1:]]
    path.write_text("\n".join(["! by hand", *rows]) + "\n")
    return path
