"""Random plants of several channels with bounded errors, and a judge of the margin that shares no formula with the library."""

import control
import numpy as np
import scipy.linalg

import robustid as rid


def plant(seed, p, q, rho, *, symmetric=False):
    """A random plant of four states whose poles lie inside |z| < 0.8/rho, and its largest gain on |z| = 1/rho."""
    rng = np.random.default_rng([seed, p, q])
    A = rng.standard_normal((4, 4))
    B, C, D = (rng.standard_normal(shape) for shape in ((4, q), (p, 4), (p, q)))
    if symmetric:
        A, C, D = A + A.T, B.T, D + D.T
    A *= rng.uniform(0.4, 0.8) / rho / np.abs(np.linalg.eigvals(A)).max()
    system = control.ss(A, B, C, D, 1.0)
    return system, np.linalg.norm(response(system, np.linspace(0, np.pi, 2000), 1 / rho), 2, axis=(1, 2)).max()


def response(system, angles, radius=1.0):
    """(F, p, q) at radius * exp(j angle)."""
    resolvent = np.linalg.inv(radius * np.exp(1j * angles)[:, None, None] * np.eye(system.nstates) - system.A)
    return system.C @ resolvent @ system.B + system.D


def measured(seed, system, angles, bound, *, symmetric=False):
    """Its response with errors in discs of that radius."""
    rng = np.random.default_rng([seed, 7])
    values = response(system, angles)
    error = np.sqrt(rng.uniform(0, 1, values.shape)) * np.exp(2j * np.pi * rng.uniform(0, 1, values.shape))
    error = np.triu(error) + np.swapaxes(np.triu(error, 1), 1, 2) if symmetric else error
    return rid.FrequencyResponse(angles, values + bound * error, bound=bound, dt=1.0)


def random_matrix_problem(seed, p, q, lines=4, *, rho=1.1, bound=0.1, factor=1.2, symmetric=False, **options):
    """A problem that holds the truth inside for factor > 1, and the truth; lines so dense that the errors matter."""
    rng = np.random.default_rng([seed, lines])
    system, size = plant(seed, p, q, rho, symmetric=symmetric)
    angles = rng.uniform(0.3, 2.0) + 0.05 * np.cumsum(rng.uniform(0.5, 1.5, lines))
    frf = measured(seed, system, angles, bound * size, symmetric=symmetric)
    prior = rid.Prior(gain_bound=factor * size, decay_rate=rho)
    return rid.MixedProblem(**{"frequency": frf, "prior": prior, "symmetric": symmetric} | options), system


def judge_margin(problem, whitening=None):
    """The margin from Pick's matrix at the complex nodes (and delays from rest), with cvxpy's own norms, by Clarabel.

    M*: k_v u -> k_v G(v)* u and z^k u -> sum_j z^(k-j) g_j* u is a contraction of the span of the kernels and the delays, in
    their Gram matrix, for the functions of the unit ball and no other values. Conjugate kernels are added and subtracted.
    Ellipses of one entry are given by `whitening` (F, 2, 2): |W_k (Re e_k, Im e_k)| <= s.
    """
    import cvxpy as cp

    lines = np.unique(np.concatenate([np.zeros(0), *(f.omega * problem.dt for f in problem.frequency)]))
    delays = max((t.u.shape[0] for t in problem.time), default=0)
    contraction, F, f = unknowns_of(problem, lines, delays)
    p, q, size = f.shape[1:] if delays else F.shape[1:]
    n = 2 * lines.size + delays
    s, unknown = cp.Variable(), cp.Variable(size)
    limits = [cp.sigma_max(cp.reshape(contraction @ unknown, (n * q, n * p), order="C")) <= 1]
    if problem.symmetric:
        parts = [(part - part.swapaxes(1, 2)).reshape(-1, size) for part in (F.real, F.imag, f)]
        limits += [part @ unknown == 0 for part in parts if part.size]
    for experiment in problem.frequency:
        at = np.searchsorted(lines, experiment.omega * problem.dt)
        for k, (y, A) in enumerate(discs_of(experiment, F[at])):
            e = cp.hstack([part(y) - part(A) @ unknown for part in (np.real, np.imag)])
            limits.append(cp.norm(e if whitening is None else (whitening[k] * experiment.bound[k, 0, 0]) @ e) <= s)
    for record in problem.time:
        for k in range(record.u.shape[0]):
            rows = sum(np.tensordot(record.u[k - j], f[j], (0, 1)) for j in range(k + 1))
            limits.append(cp.abs(record.y[k] - rows @ unknown) <= s * record.bound[k])
    if problem.parameter_bounds is not None:
        low, high = problem.parameter_bounds.reshape(-1, 2).T
        p, held = unknown[size - low.size :], np.isfinite(low)
        limits += [p[held] >= low[held], p[held] <= high[held]] if held.any() else []
    program = cp.Problem(cp.Minimize(s), limits)
    program.solve(solver="CLARABEL", tol_gap_abs=1e-9, tol_gap_rel=1e-9, tol_feas=1e-9, accept_unknown=True)
    return float(s.value)


def unknowns_of(problem, angles, delays):
    """Linear maps of all unknowns: the contraction (n^2 p q, size), F at the lines (F, p, q, size), and its impulse response."""
    p, q = len(problem.outputs), len(problem.inputs)
    basis, rho, N = problem.parametric, problem.prior.decay_rate, angles.size
    m = 0 if basis is None else basis.size
    count, entry = (2 * N + delays) * p * q, np.eye(p * q).reshape(p, q, p * q)
    v = np.exp(-1j * angles) / rho
    v = np.concatenate([v, v.conj()])
    cross = v[:, None] ** np.arange(delays)
    gram = np.block([[1 / (1 - np.outer(v, v.conj())), cross], [cross.conj().T, np.eye(delays)]])
    turn = np.kron([[1, -1j], [1, 1j]], np.eye(N)) / np.sqrt(2)
    turn = scipy.linalg.block_diag(turn, np.eye(delays))
    root = np.linalg.cholesky((turn.conj().T @ gram @ turn).real).T
    # Values of the function of the unit ball: (node, p, q, unknown), delays after the nodes.
    node = np.zeros((2 * N, p, q, count + m * p * q), complex)
    delay = np.zeros((delays, p, q, count + m * p * q))
    for i in range(N):
        both = np.concatenate([entry, 1j * entry], axis=2)
        place = slice(2 * i * p * q, 2 * (i + 1) * p * q)
        node[i, ..., place], node[i + N, ..., place] = both, both.conj()
    for k in range(delays):
        place = 2 * N + k
        delay[k, ..., place * p * q : (place + 1) * p * q] = entry
    adjoint = np.zeros((2 * N + delays, q, 2 * N + delays, p, node.shape[-1]), complex)
    for i in range(2 * N):
        adjoint[i, :, i] = node[i].conj().swapaxes(0, 1)
    for k in range(delays):
        for j in range(k + 1):
            adjoint[2 * N + k - j, :, 2 * N + k] = delay[j].swapaxes(0, 1)
    left, right = root @ turn.conj().T, turn @ np.linalg.inv(root)
    contraction = np.einsum("ij,jakbu,kl->ialbu", left, adjoint, right, optimize=True)
    gain = problem.prior.gain_bound * problem.prior.scales(p, q)[..., None]
    F = gain * node[:N]
    f = gain * delay * rho ** -np.arange(delays, dtype=float)[:, None, None, None]
    if basis is not None:
        residues = np.eye(m * p * q).reshape(m, p, q, m * p * q)
        F[..., count:] = np.tensordot(basis.response(angles), residues, 1)
        f[..., count:] = np.tensordot(basis.impulse(delays), residues, 1)
    return contraction.real.reshape(-1, node.shape[-1]), F, f


def discs_of(experiment, F):
    """What is in one bound, divided by it: pairs y (k,) and A (k, size)."""
    if isinstance(experiment, rid.TangentialResponse):
        for k, i, j in np.argwhere(np.isfinite(experiment.bound)):
            row = np.einsum("a,abu,b->u", experiment.left[k, i], F[k], experiment.right[k, :, j])
            yield (part[None] / experiment.bound[k, i, j] for part in (experiment.values[k, i, j], row))
        return
    for k, values in enumerate(experiment.values):
        if experiment.bound.joint == "matrix":
            whiten = scipy.linalg.inv(scipy.linalg.sqrtm(experiment.bound.ellipsoid[k]))
            yield whiten @ values.T.ravel(), whiten @ F[k].swapaxes(0, 1).reshape(values.size, -1)
            continue
        bound = experiment.bound[k]
        for j in range(bound.shape[1]):
            used = np.flatnonzero(np.isfinite(bound[:, j]))
            groups = [used] if experiment.bound.joint == "column" else used[:, None]
            for rows in groups:
                yield values[rows, j] / bound[rows, j], F[k, rows, j] / bound[rows, j][:, None]
