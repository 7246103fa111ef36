"""Nodal analysis of a subcircuit of resistors, capacitors and voltage-controlled current sources: a judge of netlists."""

import numpy as np


def port_impedances(text, omega):
    """Open-circuit impedance matrices (F, m, m) of the ports of the first subcircuit in a netlist."""
    lines = [line.split() for line in text.splitlines() if line.strip() and not line.startswith("*")]
    assert lines[0][0] == ".subckt"
    assert lines[-1][0] == ".ends"
    ports, elements = lines[0][2:-1], lines[1:-1]
    assert lines[0][-1] == "ref"
    names = sorted({node for words in elements for node in words[1 : 5 if words[0][0] == "G" else 3]} - {"0", "ref"})
    place = {name: k for k, name in enumerate(names)}
    conductance, capacitance = np.zeros((2, len(names), len(names)))

    def stamp(matrix, out, into, plus, minus, value):
        for row, row_sign in ((out, 1), (into, -1)):
            for column, sign in ((plus, 1), (minus, -1)):
                if row in place and column in place:
                    matrix[place[row], place[column]] += row_sign * sign * value

    for name, *nodes, value in elements:
        if name[0] == "G":
            stamp(conductance, *nodes, float(value))
        elif name[0] == "R":
            stamp(conductance, *nodes, *nodes, 1 / float(value))
        else:
            assert name[0] == "C"
            stamp(capacitance, *nodes, *nodes, float(value))
    drive = np.zeros((len(names), len(ports)))
    for k, port in enumerate(ports):
        drive[place[port], k] = 1
    rows = [place[port] for port in ports]
    return np.array([np.linalg.solve(conductance + 1j * w * capacitance, drive)[rows] for w in omega])
