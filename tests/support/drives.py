"""Drives: random sampled plants with controllers of PID, notch and low-pass, the loop in C, and the loop as `control` has it."""

import ctypes
import subprocess

import control
import numpy as np

from robustid.app.exports import write_controller_c
from robustid.controllers.structure import basis_of
from robustid.core import StateMatrices, points_of
from robustid.design import PID, LeadLag, LowPass, Notch

KINDS = ("PI, two lags", "PID, rigid body", "PID, low-pass", "PID, notch, low-pass", "slow lag, PD, low-pass")

_LOOP = """
#include "{name}.h"
#define N {order}
/* u = sat(C (r - y)), y = P u with P in double precision; what the drive sees of r and y is in its own precision. */
void loop(const double *a, const double *b, const double *c, const double *r, double lower, double upper, int limited,
          int n, double *y, double *u)
{{
  {name}_state s;
  {name}_real low = ({name}_real)lower, high = ({name}_real)upper, e, put;
  double x[N] = {{0}}, next[N];
  int i, j, k;
  {name}_reset(&s);
  for (k = 0; k < n; k++) {{
    y[k] = 0;
    for (i = 0; i < N; i++) y[k] += c[i] * x[i];
    e = ({name}_real)r[k] - ({name}_real)y[k];
    {name}_step(&s, &e, 0, limited ? &low : 0, limited ? &high : 0, &put);
    u[k] = put;
    for (i = 0; i < N; i++) {{
      next[i] = b[i] * u[k];
      for (j = 0; j < N; j++) next[i] += a[i * N + j] * x[j];
    }}
    for (i = 0; i < N; i++) x[i] = next[i];
  }}
}}
/* u of the controller alone for inputs e, with limits where they are given. */
void played({name}_state *s, const {name}_real *e, const {name}_real *ahead, const {name}_real *lower, const {name}_real *upper,
            int n, {name}_real *u)
{{
  int k;
  for (k = 0; k < n; k++)
    {name}_step(s, e + k * {inputs}, ahead, lower, upper, u + k * {outputs});
}}
"""


def drive(seed):
    """A plant, a controller that keeps |S| <= 2.5 with it, and the corner in rad/s; the first of random ones that does."""
    rng, kind = np.random.default_rng([61, seed]), KINDS[seed % len(KINDS)]
    for _ in range(100):
        dt = 10 ** rng.uniform(-4.7, -3)
        w = 10 ** rng.uniform(-3, -0.9) / dt
        P, C = _pair(kind, rng, dt, w)
        C = C / abs(P(np.exp(1j * w * dt)) * C(np.exp(1j * w * dt)))
        omega = np.geomspace(w / 300, np.pi / dt, 500)
        z = points_of(omega, dt)
        stable = np.abs(control.feedback(P * C, 1).poles()).max() < 1
        if stable and np.abs(1 / (1 + P(z) * C(z))).max() < 2.5:
            return P, C, w
    raise AssertionError(f"no drive of kind {kind}")


def _pair(kind, rng, dt, w):
    s = control.tf("s")
    top, fast, ring, slow = w * rng.uniform(6, 12), w * rng.uniform(10, 16), w * rng.uniform(2.5, 4), 1e-4 / dt
    pid = 1 + rng.uniform(0.1, 0.3) * w / s + rng.uniform(1, 2) * s / w / (1 + s / top)
    notch = (s**2 + 0.2 * ring * s + ring**2) / (s**2 + 1.2 * ring * s + ring**2)
    low, ringing = 1 / (1 + np.sqrt(2) * s / fast + s**2 / fast**2), ring**2 / (s**2 + 0.06 * ring * s + ring**2)
    lag = 1 / (1 + s / (w * rng.uniform(0.1, 0.5)))
    plant, ideal, factors = {
        "PI, two lags": (lag / (1 + s / (w * rng.uniform(4, 10))), 1 + rng.uniform(0.1, 0.4) * w / s, [PID()]),
        "PID, rigid body": (1 / s**2, pid, [PID(filter=top)]),
        "PID, low-pass": (1 / (s / w * (s / w + 0.3)), pid * low, [PID(filter=top), LowPass(fast, 2)]),
        "PID, notch, low-pass": (
            lag * ringing,
            (1 + rng.uniform(0.1, 0.3) * w / s) * notch * low,
            [PID(), Notch(ring, 0.6), LowPass(fast, 2)],
        ),
        "slow lag, PD, low-pass": (
            1 / (s / w + rng.uniform(0.1, 0.3)) / (1 + s / (w * rng.uniform(2, 4))),
            (s + rng.uniform(0.1, 0.3) * w) / (s + slow) * (1 + 0.3 * s / w / (1 + s / top)) * low,
            [PID(filter=top, integral=False), LeadLag(slow), LowPass(fast, 2)],
        ),
    }[kind]
    basis = basis_of(factors, [one.free[0][0] for one in factors if one.free], dt)
    omega = np.geomspace(slow / 10, 0.9 * np.pi / dt, 400)
    values = ideal(1j * omega)
    rows = basis.response(omega)[:, :, 0, 0] / values[:, None]
    left = np.concatenate([rows.real, rows.imag])
    found = np.linalg.lstsq(left, np.concatenate([np.ones(omega.size), np.zeros(omega.size)]))[0]
    return control.c2d(control.ss(plant), dt), basis.controller(found)


def compiled(controller, order, folder, *flags, name="drive", changed=None):
    """An exported controller with its loop with a plant of so many states, compiled with gcc -O2."""
    folder.mkdir(exist_ok=True)
    write_controller_c(folder / f"{name}.c", controller)
    if changed is not None:
        source = (folder / f"{name}.c").read_text()
        assert changed[0] in source
        (folder / f"{name}.c").write_text(source.replace(*changed))
    sizes = {"inputs": controller.ninputs, "outputs": controller.noutputs}
    (folder / "loop.c").write_text(_LOOP.format(name=name, order=order, **sizes))
    return built(folder, f"{name}.c", "loop.c", flags=flags)


def built(folder, *sources, flags=()):
    """A library of C files, without one warning."""
    library = folder / f"lib{'_'.join(flags)}.so"
    strict = ["-O2", "-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC"]
    ended = subprocess.run(
        ["gcc", *strict, *flags, *sources, "-o", str(library)], cwd=folder, capture_output=True, text=True
    )
    assert ended.returncode == 0, ended.stderr
    return ctypes.CDLL(str(library))


class Played:
    """A compiled controller that is played inputs; its state goes on from call to call."""

    def __init__(self, library, controller, kind=float, name="drive"):
        self.library, self.kind, self.outputs = library, np.dtype(kind), controller.noutputs
        self.reset_ = getattr(library, f"{name}_reset")
        self.state = np.full(1000, np.nan, self.kind)
        self.reset()

    def reset(self):
        """Zero initial conditions, whatever was in memory."""
        self.reset_(self.state.ctypes.data_as(ctypes.c_void_p))

    def __call__(self, e, ahead=None, lower=None, upper=None):
        e = np.ascontiguousarray(e, self.kind)
        u = np.full((len(e), self.outputs), np.nan, self.kind)
        given = [None if one is None else np.atleast_1d(np.asarray(one, self.kind)) for one in (ahead, lower, upper)]
        pointers = [None if one is None else one.ctypes.data_as(ctypes.c_void_p) for one in (self.state, e, *given, u)]
        self.library.played(*pointers[:5], ctypes.c_int(len(e)), pointers[5])
        return u


def closed(library, plant, r, limit=None):
    """y and u (T,) of a compiled loop for a reference r (T,), with u within +- limit."""
    loop = library.loop
    pointer = np.ctypeslib.ndpointer(float, flags="C")
    loop.argtypes = [pointer] * 4 + [ctypes.c_double] * 2 + [ctypes.c_int] * 2 + [pointer] * 2
    A, B, C, D = StateMatrices.of(plant)
    assert not D.any()
    y, u = np.zeros(len(r)), np.zeros(len(r))
    parts = [np.ascontiguousarray(part) for part in (A, B, C)]
    loop(*parts, np.ascontiguousarray(r, float), -(limit or 0), limit or 0, limit is not None, len(r), y, u)
    return y, u


def linear(plant, controller, r):
    """y and u (T,) of the loop as `control` simulates it."""
    plant, controller = (
        control.ss(one, inputs=i, outputs=o) for one, i, o in ((plant, "u", "y"), (controller, "e", "u"))
    )
    error = control.summing_junction(["r", "-y"], "e", dt=plant.dt)
    whole = control.interconnect([plant, controller, error], inputs=["r"], outputs=["y", "u"])
    found = control.forced_response(whole, inputs=r[None]).outputs
    return found[0].ravel(), found[1].ravel()
