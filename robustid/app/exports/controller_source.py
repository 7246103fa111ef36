"""A discrete controller as C that a drive runs: sections, output limits that are given at run time, and anti-windup."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.linalg

from robustid.app.exports.c_header import rows
from robustid.app.exports.matlab import identifier
from robustid.app.exports.sections import FLOOR, Comparison, Sections, sections
from robustid.controllers import ControllerDesign, DesignStatus
from robustid.core import Real, atomic_write
from robustid.errors import InputError, InputTypeError
from robustid.identification import as_system

if TYPE_CHECKING:
    import control

_WORST = 1e-6  # of the response, that the sections may lose in double precision
_TRUST = 0.1  # of the median gain: what the observer takes as error of the output that was realised

_HEAD = """\
/* {name}: a controller of {inputs} input(s), {outputs} output(s), {states} states, sampled at {dt!r} s. Written by robustid.

   Once: {name}_reset(&state). Every {dt!r} s: {name}_step(&state, e, ahead, lower, upper, u), with
     e      the input: reference minus measurement. (Of u = r - C y: minus the measurement, and `ahead` is r.)
     ahead  is added to the output before it is limited; 0: nothing
     lower, upper  limits of the output, which may change at any time; 0: none. Both equal to what is put out by hand: it follows.
     u      the output, limited. If the actuator does less, give what it does as limits.

   Anti-windup: u = sat(C x + D e) and x+ = A x + B e + L (u - C x - D e), an observer of the output that was realised.
   While nothing is limited the last term is zero, and the loop is the linear one. A - L C has its poles within
   |z| <= 1 - {inside:.1e}: a limited controller is stable, integrators too. L is the stationary Kalman gain for e as white
   noise and an error of the output of {trust:g} of the median gain. Where all zeros of the controller are well inside the
   unit circle it is close to B D^-1, the conditioned controller (Hanus, Kinnaert, Henrotte, Automatica 23(6), 1987).

   Numbers: v = x - T e, x+ = x + F v + H e + L w, u = C v + D e + w. F is A - I, v what the states lag behind their values
   at standstill, w what the limits change; integrators and what works as such have rows in H. `rest` holds what
   a sum rounded off: a slow state loses nothing in single precision. The response differs from that of the controller by at
   most {double:.1e} of it in double and {single:.1e} in single precision (at {points} frequencies; where it is below
   {floor:g} of its median, in part of that).
   C99, no library. Compile with -D{upper}_SINGLE for single precision, and never with -ffast-math, which drops `rest`. */
#ifndef {upper}_H
#define {upper}_H
#ifdef __FAST_MATH__
#error "{name} needs sums as they are written: compile without -ffast-math"
#endif
#ifdef {upper}_SINGLE
typedef float {name}_real;
#else
typedef double {name}_real;
#endif
#define {upper}_STATES {states}
#define {upper}_INPUTS {inputs}
#define {upper}_OUTPUTS {outputs}
typedef struct {{ {name}_real x[{room}], rest[{room}]; }} {name}_state;
"""

_DECLARED = """
{inline}void {name}_reset({name}_state *s);
{inline}void {name}_step({name}_state *s, const {name}_real *e, const {name}_real *ahead, const {name}_real *lower,
  const {name}_real *upper, {name}_real *u);
"""

_DEFINED = """
/* Zero initial conditions. */
{inline}void {name}_reset({name}_state *s)
{{
  int k;
  for (k = 0; k < {room}; k++) s->x[k] = s->rest[k] = 0;
}}

/* Output u of this sample for the input e, then the state of the next one. */
{inline}void {name}_step({name}_state *s, const {name}_real *e, const {name}_real *ahead, const {name}_real *lower,
  const {name}_real *upper, {name}_real *u)
{{
  static const {name}_real f[{room}][{room}] = {{{f}}};
  static const short from[{room}] = {{{first}}}, to[{room}] = {{{last}}};  /* columns of f that are not zero */
  static const {name}_real t[{room}][{inputs}] = {{{t}}};
  static const {name}_real h[{room}][{inputs}] = {{{h}}};
  static const {name}_real c[{outputs}][{room}] = {{{c}}};
  static const {name}_real d[{outputs}][{inputs}] = {{{d}}};
  static const {name}_real l[{room}][{outputs}] = {{{l}}};
  {name}_real v[{room}], w[{outputs}];
  int i, j, k;
  for (k = 0; k < {states}; k++) {{
    {name}_real still = 0;
    for (j = 0; j < {inputs}; j++) still += t[k][j] * e[j];
    v[k] = (s->x[k] - still) + s->rest[k];
  }}
  for (i = 0; i < {outputs}; i++) {{
    {name}_real wanted = ahead ? ahead[i] : 0, put;
    for (k = 0; k < {states}; k++) wanted += c[i][k] * v[k];
    for (j = 0; j < {inputs}; j++) wanted += d[i][j] * e[j];
    put = wanted;
    if (lower && put < lower[i]) put = lower[i];
    if (upper && put > upper[i]) put = upper[i];
    u[i] = put;
    w[i] = put - wanted;
  }}
  for (k = 0; k < {states}; k++) {{
    {name}_real change = s->rest[k], before = s->x[k], after, added;
    for (j = from[k]; j < to[k]; j++) change += f[k][j] * v[j];
    for (j = 0; j < {inputs}; j++) change += h[k][j] * e[j];
    for (i = 0; i < {outputs}; i++) change += l[k][i] * w[i];
    after = before + change;
    added = after - before;
    s->rest[k] = (before - (after - added)) + (change - added);
    s->x[k] = after;
  }}
}}
"""


def write_controller_c(path: str | os.PathLike[str], controller: object) -> None:
    r"""Write a discrete controller as C: limits of its output at run time, anti-windup, double or single precision.

    .. math:: u = \operatorname{sat}(C x + D e), \qquad x^+ = A x + B e + L (u - C x - D e)

    with A - L C stable. While nothing is limited this is the controller itself. L is the stationary gain of a Kalman filter
    that takes e for white noise and an error of the output of a tenth of the median gain. Where all zeros of the controller
    are well inside the unit circle it is close to :math:`B D^{-1}`, the conditioned controller; it is stable where that is not
    (zeros on the circle or outside, D = 0), and slow poles beside the integrators do not wind up either.

    Parameters
    ----------
    path : str or path
        ``NAME.h``: one header, all of whose functions are inline; or ``NAME.c``, with its declarations in ``NAME.h`` beside it.
    controller : ControllerDesign, control.StateSpace or control.TransferFunction
        From the control error to the output of the controller, with its sample time in s.

    Raises
    ------
    InputError
        Another ending; a controller in continuous time; one that does not show a state that is not stable in its output;
        one whose numbers would not keep their digits.
    InputTypeError
        Another object.

    References
    ----------
    `hanus1987` for the conditioned controller; `astrom2006`, chapter 3, for windup and back-calculation.

    Examples
    --------
    >>> import control, pathlib, tempfile
    >>> pi = control.ss(control.tf([2.0, -1.99], [1.0, -1.0], 0.001))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_controller_c(pathlib.Path(folder) / "pi.c", pi)
    ...     sorted(one.name for one in pathlib.Path(folder).iterdir())
    ['pi.c', 'pi.h']
    """
    path = Path(path)
    written = controller_files(path, controller)
    for one, text in written.items():
        with atomic_write(one) as file:
            file.write(text)


def controller_files(path: Path, controller: object) -> dict[Path, str]:
    """Texts of the files of a controller; see `write_controller_c`."""
    if path.suffix.lower() not in (".c", ".h"):
        raise InputError(f"`path` must end in .c or .h for a controller in C; got {path.name}")
    words = _words(controller, identifier(path.stem))
    if path.suffix.lower() == ".h":
        return {path: _HEAD.format_map(words) + _DEFINED.format_map(words | {"inline": "static inline "}) + "#endif\n"}
    words["inline"] = ""
    header = path.with_suffix(".h")
    included = f'/* See {header.name}. Written by robustid. */\n#include "{header.name}"\n'
    return {
        header: _HEAD.format_map(words) + _DECLARED.format_map(words) + "#endif\n",
        path: included + _DEFINED.format_map(words),
    }


def designed_controller(design: ControllerDesign) -> control.StateSpace:
    """The controller of a design; refused where it is only the closest one to limits that it breaks."""
    if design.controller is None:
        raise InputError("`controller` is a design that found none; there is nothing to write")
    if design.status is DesignStatus.NONE:
        raise InputError(
            "`controller` is a design that found none that keeps the limits; the closest one breaks them. To write it all the"
            " same, give its `controller`"
        )
    return design.controller


def _words(controller: Any, name: str) -> dict[str, object]:
    """Numbers and words of the templates."""
    import control

    if isinstance(controller, ControllerDesign):
        controller = designed_controller(controller)
    if not isinstance(controller, control.StateSpace | control.TransferFunction):
        raise InputTypeError(
            "`controller` must be a ControllerDesign, a control.StateSpace or a control.TransferFunction; got"
            f" {type(controller).__name__}"
        )
    system, _ = as_system("controller", controller)
    dt = controller.dt
    if not dt or dt is True:
        raise InputError(
            f"`controller` must be discrete, with its sample time in s; got dt = {dt}. Sample it: control.sample_system"
        )
    found, compared = sections(system, float(dt))
    if not compared.lost(found) <= _WORST:
        raise InputError(
            f"`controller` would differ by {compared.lost(found):.1e} of its response: its numbers lose too many digits in"
            " double precision. Build it in state space, as a series of its filters, and not from one transfer function"
        )
    gain, radius = anti_windup(found, compared)
    single = Sections(*(part.astype(np.float32).astype(float) for part in found))
    n, (outputs, inputs) = len(found.F), found.D.shape
    room = max(n, 1)
    F = np.zeros((room, room))
    F[:n, :n] = found.F
    first = [int(np.flatnonzero(one)[0]) if one.any() else 0 for one in F]
    last = [int(np.flatnonzero(one)[-1]) + 1 if one.any() else 0 for one in F]
    return {
        "name": name, "upper": name.upper(), "dt": float(dt), "states": n, "room": room, "inputs": inputs, "outputs": outputs,
        "inside": 1 - radius, "trust": _TRUST, "floor": FLOOR, "points": compared.omega.size,
        "double": compared.lost(found), "single": compared.lost(single),
        "f": rows(F), "first": ", ".join(map(str, first)), "last": ", ".join(map(str, last)),
        "t": rows(_filled(found.T, room)), "h": rows(_filled(found.H, room)), "c": rows(_filled(found.C.T, room).T),
        "d": rows(found.D), "l": rows(_filled(gain, room)),
    }  # fmt: skip


def anti_windup(found: Sections, compared: Comparison) -> tuple[Real, float]:
    """L of the observer of the realised output, (n, ny), and the largest size of a pole of A - L C."""
    A, B, C, D = found.matrices
    if not len(A):
        return np.zeros((0, len(D))), 0.0
    size = np.median(np.linalg.norm(compared.values, axis=2), axis=0)
    error = np.diag((_TRUST * np.where(size > 0, size, 1.0)) ** 2) + D @ D.T
    gain, radius = np.zeros((len(A), len(D))), np.inf
    with contextlib.suppress(np.linalg.LinAlgError):
        X: Real = np.asarray(scipy.linalg.solve_discrete_are(A.T, C.T, B @ B.T, error, s=B @ D.T), dtype=float)
        gain = np.asarray(np.linalg.solve(C @ X @ C.T + error, C @ X @ A.T + D @ B.T), dtype=float).T
        radius = float(np.abs(np.linalg.eigvals(A - gain @ C)).max())
    if not radius < 1:
        raise InputError(
            "`controller` has an integrator, or another state that is not stable, that its output does not show: it would"
            " wind up whatever is put out. Remove it: control.minimal_realization"
        )
    return gain, radius


def _filled(values: Real, room: int) -> Real:
    """Rows of a matrix, with one of zeros where it has none: C knows no empty arrays."""
    return values if len(values) == room else np.zeros((room, values.shape[1]))
