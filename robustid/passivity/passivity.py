"""Passivity of a continuous model on the whole frequency axis: proved by a matrix, or refuted by the frequencies where it fails."""

from __future__ import annotations

import dataclasses
import enum
from typing import TYPE_CHECKING

import numpy as np

from robustid.core import Frozen, Real, StateMatrices, as_float, counted, hz_words, scaled_states, threads_for
from robustid.errors import InputError
from robustid.identification import check_model, describe_poles
from robustid.passivity.passivity_certificate import (
    BOUNDED,
    KINDS,
    NEGATIVE,
    POSITIVE,
    PassivityCertificate,
    equation_of,
    face_of,
    matrices_of,
)
from robustid.passivity.passivity_refined import refined_proofs
from robustid.passivity.passivity_search import Band, Popov, inequality
from robustid.reduction import is_stable

if TYPE_CHECKING:
    import control

# Of the size of the response: an excess below the first is rounding, and no violation; the others are tried for a proof.
_ROUNDING = 1e-10
_REFINED = 1e-8  # gap up to which P is refined beyond double precision
_GAPS = (1e-9, 1e-8, 3e-8, 1e-7, 3e-7, 1e-6, 3e-6, 1e-5, 3e-5, 1e-4, 1e-3, 1e-2, 0.1)


class PassivityStatus(enum.Enum):
    """Status of a proof; the value is the user's sentence."""

    PASSIVE = "passive, proved on the whole frequency axis"
    EDGE = (
        "not proved passive: at the limit, with no violation found beyond rounding; how far it can be beyond is proved"
    )
    VIOLATED = "not passive: it is beyond the limit in bands of frequency"
    UNPROVED = "no violation was found, and no proof either: rounding in the numbers of the model hides both"


@dataclasses.dataclass(frozen=True, eq=False)
class Passivity(Frozen):
    """Say whether a model is passive at all frequencies, by how much, and why.

    Attributes
    ----------
    kind : {"bounded real", "positive real", "negative imaginary"}
    holds : bool
        True only with a proof.
    status : PassivityStatus
    margin : float
        Proved: the largest singular value is at most ``1 - margin`` ("bounded real"); the smallest eigenvalue of the Hermitian
        part of the response ("positive real"), or of s (F - D) ("negative imaginary"), is at least `margin`. Negative where the
        limit was not proved: then it says how far beyond it the model can be. -inf without any proof.
    peak, omega : float
        The largest singular value found, or minus the smallest such eigenvalue, and its frequency in rad/s (infinity included).
    bands : tuple of Band
        Of a model that is not passive: `low`, `high`, the frequency `omega` of the largest violation between them, all in rad/s,
        and its `amount`, in the units of `margin`.
    certificate : PassivityCertificate or None
        The proof of `margin`; ``certificate.verify(model)`` goes through it again, in exact numbers.
    decay : float, 1/s
        All is said of the line Re s = -decay, and the half-plane right of it.
    """

    kind: str
    _: dataclasses.KW_ONLY
    holds: bool
    status: PassivityStatus
    margin: float
    peak: float
    omega: float
    bands: tuple[Band, ...]
    certificate: PassivityCertificate | None
    decay: float = 0.0

    def summary(self) -> str:
        """All of it in a few sentences."""
        lines = [f"{self.kind}: {self.status.value}"]
        if np.isfinite(self.margin):
            lines.append(f"proved at all frequencies: {_claim(self.kind, self.margin)}")
        lines += [
            f"beyond the limit by at most {band.amount:.4g}, at {_hz(band.omega)}, from {_hz(band.low)} to {_hz(band.high)}"
            for band in self.bands
        ]
        if self.bands and self.kind == BOUNDED and self.peak > 2:
            lines.append(
                f"waves {self.peak:.3g} times as large as those that come in are more than a port can amplify by mistake: if the"
                ' model is an impedance or admittance, ask for kind="positive real"'
            )
        if self.bands and self.kind == POSITIVE and len(self.bands) == 1 and self.bands[0][:2] == (0.0, np.inf):
            lines.append("it is violated at every frequency: is the sign of a current or force the other way round?")
        return "\n".join(lines)


def prove_passive(model: control.StateSpace, *, kind: str = BOUNDED, decay: float = 0.0) -> Passivity:
    r"""Prove that a continuous model is passive at all frequencies, infinity included, or find where it is not.

    .. math:: \bar\sigma(S(j\omega)) \le 1, \qquad Z(j\omega) + Z(j\omega)^H \succeq 0, \qquad
        j(F(j\omega) - F(j\omega)^H) \succeq 0 \ (\omega > 0)

    Parameters
    ----------
    model : control.StateSpace
        Continuous and stable, with as many outputs as inputs.
    kind : {"bounded real", "positive real", "negative imaginary"}, optional
        "bounded real": scattering matrices, whose waves carry power. "positive real": impedances and admittances, mobilities
        (velocity per force at the same places). "negative imaginary": compliances (displacement per force at the same places).
    decay : float, 1/s, optional
        Ask it of the half-plane Re s > -decay: more than passivity.

    Returns
    -------
    Passivity
        `holds` is True only with a proof: a matrix whose linear matrix inequality is evaluated in exact numbers (integers of any
        length), which no rounding and no solver can make wrong.

    Raises
    ------
    InputError, InputTypeError
        A discrete or unstable model, one that is not square, or another kind.

    Notes
    -----
    The largest excess over the frequencies comes from eigenvalues of a Hamiltonian matrix on the axis, not from a grid
    (`boyd1989`); where the limit is exceeded they are the ends of the bands. The matrix solves a Riccati equation a little above
    that excess, in balanced coordinates (bounded-real and positive-real lemma, `anderson1973`). Next to the limit it is refined
    beyond double precision.

    A model that touches the limit at a frequency, exactly 1 or 0, allows no strict inequality, and rounded numbers can't tell it
    from one that is beyond: then `holds` is False and `margin` says by how much at most it is beyond, commonly 1e-9. Only where a
    positive-real response vanishes at infinity (D + D' = 0), or a negative imaginary one there and at zero, as all of them do, is
    the limit itself proved; this takes C B (C A^{-1} B, C A B) symmetric to the last digit, as it is of one port,
    and ports that don't depend on each other.

    Examples
    --------
    >>> import control, robustid as rid
    >>> ladder = control.ss([[-2.0, 1.0], [1.0, -1.0]], [[1.0], [0.0]], [[1.0, 0.0]], 0.5)
    >>> proof = rid.prove_passive(ladder, kind="positive real")
    >>> proof.holds, bool(0.499999 < proof.margin < 0.5), proof.certificate.verify(ladder)
    (True, True, True)
    >>> active = rid.prove_passive(control.ss(-1.0, 1.0, 1.5, 0.0))
    >>> active.holds, [round(band.high, 6) for band in active.bands]  # 1.5/|1 + j omega| = 1
    (False, [1.118034])
    """
    given = check_passive_input(model, kind, decay)
    with threads_for(given.nstates):
        return _judged(given, kind, float(decay))


def check_passive_input(model: control.StateSpace, kind: str, decay: float = 0.0) -> control.StateSpace:
    """The model itself, if it is one whose passivity of this kind can be asked for."""
    given = check_model("model", model)
    if kind not in KINDS:
        raise InputError(f"`kind` must be one of {', '.join(map(repr, KINDS))}; got {kind!r}")
    if as_float("decay", decay) < 0:
        raise InputError(f"`decay` must be >= 0, in 1/s; got {decay:g}")
    if given.nstates and given.dt != 0:
        raise InputError(
            f"`model` must be continuous: passivity is asked of all frequencies up to infinity; got dt = {given.dt}."
            " Fit it in continuous time (data without dt), or convert it (to_continuous)"
        )
    if given.noutputs != given.ninputs:
        raise InputError(
            f"`model` must have as many outputs as inputs, one pair a port; got {counted(given.noutputs, 'output')} and"
            f" {counted(given.ninputs, 'input')}"
        )
    A, _, _ = scaled_states(np.asarray(given.A, dtype=float), given.B, given.C)
    poles, stable = is_stable(A + decay * np.eye(given.nstates), 0)
    if not np.all(stable):
        beyond = f"beyond Re s = -{decay:g}" if decay else "on or beyond the imaginary axis"
        raise InputError(
            f"`model` must be stable; it has {describe_poles(poles[~stable] - decay, 0)} {beyond}. No passive model has"
            " poles beyond the axis; those on it, of lossless parts, have to be taken off first"
        )
    return given


def _judged(model: control.StateSpace, kind: str, decay: float) -> Passivity:
    A, B, C, D = StateMatrices.of(model)
    popov = Popov(kind, StateMatrices(A + decay * np.eye(len(A)), B, C, D))
    skew = float(np.linalg.norm(D - D.T, 2)) / 2 if kind == NEGATIVE else 0.0
    peak, omega = popov.peak()
    if skew > 0:  # a static gain that is not symmetric acts at all frequencies alike
        return Passivity(
            kind,
            holds=False,
            status=PassivityStatus.VIOLATED,
            margin=-np.inf,
            peak=np.inf,
            omega=np.inf,
            bands=(Band(0.0, np.inf, np.inf, np.inf),),
            certificate=None,
            decay=decay,
        )
    beyond = peak > popov.limit + _ROUNDING * popov.size
    certificate = None if beyond else _proved_limit(model, popov, kind, decay)
    certificate = certificate or _proved_bound(model, popov, peak, kind, decay)
    margin = -np.inf if certificate is None else popov.limit - certificate.bound
    if beyond:
        status = PassivityStatus.VIOLATED
    elif margin >= 0:
        status = PassivityStatus.PASSIVE
    else:
        status = PassivityStatus.EDGE if np.isfinite(margin) else PassivityStatus.UNPROVED
    return Passivity(
        kind,
        holds=status is PassivityStatus.PASSIVE,
        status=status,
        margin=margin,
        peak=peak,
        omega=omega,
        bands=popov.bands(_ROUNDING * popov.size) if beyond else (),
        certificate=certificate,
        decay=decay,
    )


def _proved_limit(model: control.StateSpace, popov: Popov, kind: str, decay: float) -> PassivityCertificate | None:
    """The proof of bound 0 of a response that falls to zero."""
    face = None if kind == BOUNDED or not model.nstates else face_of(kind, matrices_of(model, decay))
    if face is None:
        return None
    vanishing = 0 if face.null is None else face.null.digits.shape[1]
    F, K = face.F.directions(face.K)
    for P in popov.proofs_in_the_limit(F, K, vanishing):
        claim = PassivityCertificate(kind, decay=decay, bound=0.0, coordinates=popov.S, P=P, exact_limit=True)
        if claim.verify(model):
            return claim
    return None


def _proved_bound(
    model: control.StateSpace, popov: Popov, peak: float, kind: str, decay: float
) -> PassivityCertificate | None:
    """The proof of a bound of the excess as little above its peak as there is one."""
    for part in _GAPS:
        gap = part * popov.size
        # The limit itself goes before what is beyond it.
        bounds = [popov.limit] if peak < popov.limit < peak + gap else []
        for bound in (*bounds, peak + gap):
            if not model.nstates:
                found = iter([np.zeros((0, 0))])
            else:
                found = popov.proofs(bound, bound - peak)
            for P in found:
                claim = PassivityCertificate(kind, decay=decay, bound=bound, coordinates=popov.S, P=P)
                if claim.verify(model):
                    return claim
            if (
                part <= _REFINED
                and model.nstates
                and (claim := _refined(model, popov, bound, bound - peak, kind, decay))
            ):
                return claim
    return None


def _refined(
    model: control.StateSpace, popov: Popov, bound: float, gap: float, kind: str, decay: float
) -> PassivityCertificate | None:
    """The proof of a bound next to the largest excess, with P beyond double precision."""
    zero = np.zeros(popov.S.shape)
    posed = PassivityCertificate(kind, decay=decay, bound=bound, coordinates=popov.S, P=zero)

    def form(system: StateMatrices) -> tuple[Real, Real, Real]:
        return inequality(system, bound, bounded=popov.bounded)

    exact = equation_of(posed, model)
    for P, rest in refined_proofs(popov.system, form, popov.slack, gap, exact, popov.S, popov.unit):
        claim = dataclasses.replace(posed, P=P, P_rest=rest)
        if claim.verify(model):
            return claim
    return None


def _claim(kind: str, margin: float) -> str:
    if kind == BOUNDED:
        sign = "-" if margin >= 0 else "+"
        return f"largest singular value <= 1 {sign} {abs(margin):.4g}"
    of = "the response" if kind == POSITIVE else "s (F - D)"
    return f"smallest eigenvalue of the Hermitian part of {of} >= {margin:.4g}"


def _hz(omega: float) -> str:
    return "infinity" if np.isinf(omega) else hz_words(omega / (2 * np.pi), 6)
