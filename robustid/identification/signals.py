"""Checks that all experiments speak of the same plant, and of all of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robustid.core import Real, Signal
from robustid.data import FrequencyResponse, TangentialResponse, TimeRecord
from robustid.errors import InputError

Experiment = FrequencyResponse | TangentialResponse | TimeRecord

_RANK = 1e-10  # directions that carry less of the excitation than this, relatively, are rounding


def check_signals(experiments: Sequence[Experiment]) -> None:
    """Require the same inputs and outputs in all experiments; signals without a name of their own go with any."""
    first = experiments[0]
    for item in experiments[1:]:
        for role in ("inputs", "outputs"):
            ours, theirs = getattr(first, role), getattr(item, role)
            if len(ours) != len(theirs):
                raise InputError(
                    f"`{role}` differ between experiments: {_names(ours)} and {_names(theirs)}. All must have all signals, in one"
                    " order; mark what was not measured by an infinite bound, and what was not moved by zeros in u"
                )
            for one, two in zip(ours, theirs, strict=True):
                named = not (_is_default(one.name) or _is_default(two.name))
                units = one.unit and two.unit and one.unit != two.unit
                if (named and one.name != two.name) or units:
                    raise InputError(
                        f"`{role}` differ between experiments: {_names(ours)} and {_names(theirs)}. Give all the same signals, in"
                        " the same order and units"
                    )


def check_excitation(experiments: Sequence[Experiment]) -> None:
    """Require that every output is seen, and that the inputs move in independent ways."""
    first = experiments[0]
    p, q = len(first.outputs), len(first.inputs)
    if p == q == 1:
        return
    seen = np.zeros(p)
    for item in experiments:
        seen += _seen(item)
    if np.any(seen == 0):
        name = first.outputs[int(np.argmin(seen))].name
        raise InputError(f"`outputs`: no experiment has a sample of {name!r}; leave that signal out, or measure it")
    drive = np.vstack([_excitation(item) for item in experiments])
    size = np.linalg.norm(drive, axis=0)
    if np.any(size == 0):
        name = first.inputs[int(np.argmin(size))].name
        raise InputError(
            f"`inputs`: no experiment excites {name!r}; leave that signal out, or add an experiment that does"
        )
    _, singular, directions = np.linalg.svd(drive / size, full_matrices=False)
    rank = int(np.sum(singular > _RANK * singular[0]))
    if rank < q:
        still = directions[-1] / size
        still = still / np.abs(still).max()
        terms = [f"{w:+.3g} {c.name}" for w, c in zip(still, first.inputs, strict=True) if abs(w) > 1e-6]
        raise InputError(
            f"`inputs`: the {q} inputs move in {rank} independent ways only (rank-deficient excitation); the response to"
            f" {' '.join(terms)} is never seen. Add an experiment with other amplitudes or signs"
        )


def _seen(item: Experiment) -> Real:
    """Number of samples of every output, (p,)."""
    used = item.bound.used
    if isinstance(item, TimeRecord):
        return used.sum(axis=0)
    if isinstance(item, TangentialResponse):
        return np.sum(np.abs(item.left) * used.any(axis=2)[:, :, None], axis=(0, 1))
    return used.sum(axis=(0, 2))


def _excitation(item: Experiment) -> Real:
    """Rows that span the input directions of an experiment, (k, q)."""
    used = item.bound.used
    if isinstance(item, TimeRecord):
        last = np.flatnonzero(used.any(axis=1))[-1] + 1
        u = item.u if item.initial == "periodic" else item.u[:last]
        return np.asarray(np.linalg.qr(u, mode="r")) if u.shape[0] > u.shape[1] else u
    if isinstance(item, TangentialResponse):
        rows = (item.right * used.any(axis=1)[:, None, :]).transpose(0, 2, 1).reshape(-1, item.right.shape[1])
        return np.concatenate([np.real(rows), np.imag(rows)])
    return np.diag(used.any(axis=(0, 1)).astype(float))


def _is_default(name: str) -> bool:
    """Say whether a name is one that the program gave."""
    return name[:1] in ("u", "y") and (name[1:] == "" or name[1:].isdigit())


def _names(signals: Sequence[Signal]) -> str:
    return str([str(c) for c in signals])
