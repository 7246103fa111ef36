"""The structure of a designed controller in words: its factors, loop by loop, and the constant matrices around them."""

from __future__ import annotations

from collections.abc import Sequence

from robustid.controllers import FIR, PID, ControllerDesign, Factor, Fixed, LowPass, Matrix, Notch, entries_of
from robustid.identification import as_system
from robustid.report.words import HZ, in_hz, in_hz_span, number

SINGLE = "|P C|"  # size of the open loop of one input and one output


def loop_size(design: ControllerDesign) -> str:
    """Words for the least size of the open loop: at the outputs, or at the inputs where these are fewer."""
    nu, ny = _shape(design)
    loop = "P C" if ny <= nu else "C P"
    return f"|{loop}|" if 1 in (nu, ny) else f"σmin({loop})"


def _shape(design: ControllerDesign) -> tuple[int, int]:
    """Inputs and outputs of the plant; of a design without proofs those of its structure."""
    if isinstance(design.structure, Matrix):
        return design.structure.shape
    return design.proofs[0].loop.shape if design.proofs else (1, 1)


def structure_rows(design: ControllerDesign) -> list[tuple[str, str]]:
    """Factors of the structure, with what was searched, and the matrices around them."""
    rows: list[tuple[str, str]] = []
    place, structure = 0, design.structure
    nu, ny = _shape(design)
    entries, (inputs, outputs) = entries_of(structure, (ny, nu)), _ends(design)
    for i, j, factors in entries:
        words: list[str] = []
        for one in factors:
            count = len(one.free)
            words.append(factor_words(one, design.searched[place : place + count]))
            place += count
        name = "Structure" if len(entries) == 1 else f"Structure, {outputs[j]} to {inputs[i]}"
        rows.append((name, " × ".join(words)))
    if isinstance(structure, Matrix):
        around = (
            ("From the axes to the inputs", structure.actuators),
            ("From the outputs to the axes", structure.sensors),
        )
        rows += [
            (name, "; ".join(", ".join(map(number, row)) for row in matrix.tolist()))
            for name, matrix in around
            if matrix is not None
        ]
    return rows


def _signal_names(design: ControllerDesign) -> tuple[list[str], list[str]]:
    """Names of the inputs and outputs of the plant; of a design without proofs their numbers."""
    if design.proofs:
        problem = design.proofs[0].band.problem
        return [one.name for one in problem.inputs], [one.name for one in problem.outputs]
    nu, ny = _shape(design)
    return [f"input {k + 1}" for k in range(nu)], [f"output {k + 1}" for k in range(ny)]


def _ends(design: ControllerDesign) -> tuple[list[str], list[str]]:
    """Names of what the loops of a structure stand between: axes, where constant matrices are around them."""
    (inputs, outputs), structure = _signal_names(design), design.structure
    if isinstance(structure, Matrix):
        if structure.actuators is not None:
            inputs = [f"axis {k + 1}" for k in range(len(structure.rows))]
        if structure.sensors is not None:
            outputs = [f"axis {k + 1}" for k in range(len(structure.rows[0]))]
    return inputs, outputs


def factor_words(factor: Factor, at: Sequence[float]) -> str:
    """A factor in words, with the numbers that were found of those that were searched; of none that was found its intervals."""
    place = " and ".join(
        in_hz(low / HZ) if low == high else f"{in_hz_span(low / HZ, high / HZ, 4)}, searched"
        for low, high in factor.free
    )
    if at:
        place = " and ".join(
            in_hz(one / HZ) + f" (searched from {in_hz_span(low / HZ, high / HZ, 4)})" * (low < high)
            for one, (low, high) in zip(at, factor.free, strict=True)
        )
    if isinstance(factor, PID):
        letters = "P" + "I" * factor.integral + "D" * (factor.filter is not None)
        return letters + (f", the derivative up to {place}" if place else "")
    if isinstance(factor, Notch):
        return f"Notch with its poles at {place}, damping {number(factor.damping)}"
    if isinstance(factor, LowPass):
        return f"Low-pass of order {factor.order} at {place}"
    if isinstance(factor, FIR):
        return f"{factor.length} past samples"
    if isinstance(factor, Fixed):
        return f"A known model of order {len(as_system('model', factor.model)[0].A)}"
    return f"Lead or lag with its pole at {place}"
