"""A discrete model as a C header: blocks of one or two states, each a damped rotation, in double or single precision."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from robustid.app.exports.matlab import identifier
from robustid.app.exports.roots import compared_at
from robustid.core import Complex, Real, StateMatrices, points_of, response_at
from robustid.errors import InputError

if TYPE_CHECKING:
    import control

_WORST_CONDITION = 1e8  # of the modes, beyond which they are not taken apart

_TEXT = """\
/* {name}: {outputs} output(s), {inputs} input(s), {states} states, sampled at {dt!r} s. Written by robustid.
   Every state belongs to a mode of its own, or to one damped rotation of two: short loops, little lost to rounding of coefficients.
   Coefficients in double precision move the response by at most {double:.1e} of it, in single precision by {single:.1e}
   (at {points} frequencies; of what is below a millionth of its largest value, in part of that).
   Compile with -D{upper}_SINGLE for single precision. A state starts as {{0}}. */
#ifndef {upper}_H
#define {upper}_H
#ifdef {upper}_SINGLE
typedef float {name}_real;
#else
typedef double {name}_real;
#endif
#define {upper}_STATES {states}
#define {upper}_INPUTS {inputs}
#define {upper}_OUTPUTS {outputs}
typedef struct {{ {name}_real x[{room}]; }} {name}_state;

/* Output y of this sample for input u, then the state of the next one. */
static inline void {name}_step({name}_state *s, const {name}_real *u, {name}_real *y)
{{
  static const {name}_real a[{room}] = {{{a}}};       /* of a state on itself */
  static const {name}_real w[{room}] = {{{w}}};       /* on its partner: + from the first to the second, - back */
  static const unsigned char pair[{room}] = {{{pair}}};  /* 1: first of two */
  static const {name}_real b[{room}][{inputs}] = {{{b}}};
  static const {name}_real c[{outputs}][{room}] = {{{c}}};
  static const {name}_real d[{outputs}][{inputs}] = {{{d}}};
  int i, j, k;
  for (i = 0; i < {outputs}; i++) {{
    {name}_real sum = 0;
    for (k = 0; k < {states}; k++) sum += c[i][k] * s->x[k];
    for (j = 0; j < {inputs}; j++) sum += d[i][j] * u[j];
    y[i] = sum;
  }}
  for (k = 0; k < {states}; k += pair[k] ? 2 : 1) {{
    {name}_real p = a[k] * s->x[k], q = 0;
    if (pair[k]) {{
      p -= w[k] * s->x[k + 1];
      q = w[k] * s->x[k] + a[k] * s->x[k + 1];
    }}
    for (j = 0; j < {inputs}; j++) p += b[k][j] * u[j];
    s->x[k] = p;
    if (pair[k]) {{
      for (j = 0; j < {inputs}; j++) q += b[k + 1][j] * u[j];
      s->x[k + 1] = q;
    }}
  }}
}}
#endif
"""


def header(model: control.StateSpace, name: str) -> str:
    """Return the header; see the comment at its head."""
    if not model.dt or model.dt is True:
        raise InputError(
            "a C header is of a discrete model with its sample time; sample this one: control.sample_system"
        )
    name = identifier(name)
    A, B, C, pair = _rotations(model)
    D, states = np.asarray(model.D, dtype=float), len(A)
    omega = compared_at(model)
    values = response_at(StateMatrices.of(model), points_of(omega, model.dt))
    size = np.maximum(np.abs(values), 1e-6 * float(np.abs(values).max(initial=0.0)))
    lost: list[float] = []
    for kind in (np.float64, np.float32):
        parts = [np.asarray(part, dtype=kind).astype(float) for part in (A, B, C, D)]
        found = response_at(StateMatrices(*parts), points_of(omega, model.dt))
        lost.append(float(np.max(np.abs(found - values) / np.maximum(size, 1e-300))))
    room = max(states, 1)
    w = np.zeros(room)
    first = np.flatnonzero(pair)
    w[first] = A[first + 1, first]
    pairs = ", ".join(str(int(one)) for one in (pair if states else [0]))
    return _TEXT.format(
        name=name, upper=name.upper(), dt=float(model.dt), states=states, room=room, double=lost[0], single=lost[1],
        inputs=D.shape[1], outputs=D.shape[0], points=omega.size,
        a=row(np.diag(A) if states else np.zeros(1)), w=row(w), pair=pairs,
        b=rows(B if states else np.zeros((1, D.shape[1]))), c=rows(C if states else np.zeros((D.shape[0], 1))), d=rows(D),
    )  # fmt: skip


def row(values: Real) -> str:
    """Numbers with all their digits."""
    return ", ".join(f"{value:.17g}" for value in values)


def rows(values: Real) -> str:
    """A matrix as C writes it, without the outer braces."""
    return ", ".join("{" + row(one) + "}" for one in values)


def _rotations(model: control.StateSpace) -> tuple[Real, Real, Real, NDArray[np.bool_]]:
    """A as blocks [p] and [[p, -w], [w, p]], with B and C; and which states are the first of two."""
    A, B, C = (np.asarray(getattr(model, part), dtype=float) for part in "ABC")
    if not len(A):
        return A, B, C, np.zeros(0, dtype=bool)
    values, vectors = np.linalg.eig(A)
    poles: Complex = np.array(values, dtype=complex)
    modes: Complex = np.array(vectors, dtype=complex)
    kept = np.flatnonzero(poles.imag >= 0)
    columns: list[Real] = []
    pair: list[bool] = []
    for k in kept:
        columns += [modes[:, k].real] if poles[k].imag == 0 else [modes[:, k].real, -modes[:, k].imag]
        pair += [False] if poles[k].imag == 0 else [True, False]
    T = np.stack(columns, axis=1)
    condition = np.linalg.cond(T)
    if condition > _WORST_CONDITION:
        raise InputError(
            f"modes of this model lie so close together (condition number {condition:.1e}) that a C header of single modes would"
            " lose its digits; take fewer states, or save it as .m or .json"
        )
    inputs, outputs = np.asarray(np.linalg.solve(T, B), dtype=float), C @ T
    blocks = np.zeros_like(A)
    row = 0
    for k in kept:
        p = poles[k]
        if p.imag == 0:
            blocks[row, row] = p.real
            row += 1
        else:
            blocks[row : row + 2, row : row + 2] = [[p.real, -p.imag], [p.imag, p.real]]
            row += 2
    first = np.array(pair)
    # Each block is scaled so that its inputs and its outputs are equally large: no state is out of the range of a float.
    starts = [k for k in range(len(A)) if k == 0 or not first[k - 1]]
    for k in starts:
        own = slice(k, k + 1 + bool(first[k]))
        big, small = np.abs(outputs[:, own]).max(), np.abs(inputs[own]).max()
        scale = np.sqrt(big / small) if big and small else 1.0
        inputs[own], outputs[:, own] = inputs[own] * scale, outputs[:, own] / scale
    return blocks, inputs, outputs, first
