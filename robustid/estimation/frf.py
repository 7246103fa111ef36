"""estimate_frf(): frequency responses from records, with a statistical bound that holds for all spectral lines jointly."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import as_count, counted, one_thread
from robustid.data import FrequencyResponse, TimeRecord, as_probability, as_records
from robustid.errors import InputError, Remedy
from robustid.estimation.blows import are_blows, with_ringing
from robustid.estimation.estimate import ABOUT, Estimate, bound
from robustid.estimation.excited_lines import silent_lines
from robustid.estimation.periodic import periodic
from robustid.estimation.record_faults import record_faults
from robustid.estimation.steps import is_step, local_from_rest
from robustid.estimation.welch import welch

_log = logging.getLogger("robustid")
_METHODS = ("periodic", "local", "welch")


@one_thread()
def estimate_frf(
    record: TimeRecord | Sequence[TimeRecord],
    *,
    method: str | None = None,
    period: int | None = None,
    lines: ArrayLike | None = None,
    probability: float = 0.95,
    about: str = "mean",
) -> FrequencyResponse:
    """Frequency response of any number of inputs and outputs from measured records, with covariance and a joint bound.

    Periodic excitation: ``G = Y U^{-1}`` at every spectral line, Y (ny, nu) and U (nu, nu) the DFT of nu experiments side by
    side, averaged over the periods. Any other excitation: ``Y(k+r) = G(k+r) U(k+r) + T(k+r)``, G and the transient T rational
    with one denominator of order 2 over a few neighbouring lines r, so that neither leakage nor a resonance is smeared; beside
    poles of all lines, which are found first. So of the mean period where there are fewer periodic experiments than inputs, or
    inputs that are excited at lines of their own.

    Parameters
    ----------
    record : TimeRecord or sequence of TimeRecord
        One experiment, or several with the same `dt`, signals and length. Periodic with nu inputs: each nu records in
        a row make a block (independent inputs, such as an orthogonal multisine); further blocks are further
        realisations. One experiment may do, with random phases or lines in turn for the inputs. Where every record has a
        `reference` (as many signals as inputs), it is taken as the excitation, and the response is that from u to y in closed
        loop: the quotient of the responses to the reference.
    method : {"periodic", "local", "welch"}, optional
        Default: "periodic" where `period` is given, the records say ``initial="periodic"`` or each is of a blow that rings out,
        else "local". "welch" (Hann windows)
        smears what changes within its resolution, which it states; a fallback for a first look.
    period : int, optional
        Period in samples; every record must be a whole number of periods. Default: each record is one period,
        and then several blocks are needed.
    lines : sequence of int, optional
        Spectral lines k of the DFT, at frequency ``k/(N*dt)`` Hz, N the period (periodic) or the length of the record (local,
        welch: of a segment). Default: those, 0 and Nyquist left out (offsets are no response), where every signal of the
        excitation reaches a fifth of its largest line in one of the experiments; of more than 5000 lines every so manieth (local).
        Of these those whose bounds are far larger than every response are left out: see the notes.
    probability : float
        Probability of the bound, jointly for all spectral lines and entries; between 0 and 1.
    about : {"mean", "next record"}
        What the bound holds for: the mean response over all realisations of the excitation (a confidence bound), or the response
        without noise in the next record, or block of records, of the same kind (a tolerance bound), with what a nonlinear or
        varying plant changes from one to the next. The latter needs several blocks, or unexcited lines in or beside the band.

    Returns
    -------
    FrequencyResponse
        With a confidence or tolerance `bound` (F, ny, nu) that knows from how many independent excitations it was taken (its
        `excitations`), `covariance` (F, ny*nu, ny*nu) of the estimate itself with its
        `dof`, `coherence` (F, ny), the levels of `noise` and of stochastic nonlinear `distortion` where they show, what halves of
        the measurement that differ add (`changed`), what is wrong with the records (`faults`, see `record_faults`), and a note
        that says what the scatter was taken over.

    Raises
    ------
    InputError
        No whole number of periods, fewer than two periods (or blocks) in total, experiments that are not
        independent at a spectral line, too few samples, another method.
    InputTypeError
        Something that isn't a TimeRecord.

    Notes
    -----
    Periodic. Leading periods of a record that isn't ``initial="periodic"`` are left out while they differ from the later ones
    more than these among themselves (at most half of them). Then drifts, polynomials in time of degree 3 at most, are estimated
    jointly with the periodic signals and removed.

    One block of P periods: the errors are the scatter of ``(Y_p - G U_p) U^{-1}`` over the periods, input and output noise
    together to first order. That is noise; what the plant changes with the realisation it can't show. Unexcited lines show
    it from below: nonlinear distortion there, noise subtracted, interpolated to the excited lines, times 1.5 (2 where they all lie
    beside the band), is then part of the bound. B > 1 blocks: the scatter from block to block, which holds noise and what
    differs between realisations; where that is no more than the scatter over periods explains, both are taken together. Of
    experiments that drive the inputs alike, all nu of a block count, ``nu (B - 1)`` degrees of freedom at a line.

    With fewer than 10, neighbouring lines share their variance: its logarithm, linear in that of the response and in the frequency,
    is fitted to the lines around every one. The mean of this and the line's own, by their degrees of freedom, is taken; a fit has
    fewer of them as lines scatter about it beyond chance, vary together, or all do from record to record (`smyth2004`). The
    variance of the next record is ``S (1 + 1/B)`` less that of the noise.

    Local. Lines beyond 0 are conjugates (records are real), so windows at the first lines are centred too. Residuals at -k
    repeat those at k: the noise there is not stated below that of the first window with positive lines alone, and errors that
    lie along one direction of the complex plane are given their largest variance in all. In a short record the lines of a
    window reach beyond a resonance, or to two, and no function of low order fits there. So G and T of all lines first, by
    common poles, as many as shorten the description of the spectra; windows are about what these leave, and the covariance of
    both is added, which counts the same noise twice rather than leakage not at all. The noise around a line is what the poles leave
    there over the degrees of freedom that they leave there (`mackinnon1985`). The light poles, four standard deviations
    on either side, are the `modes` of the response; where halves of the measurement differ, those of both.

    Lines that next to nothing excites, far from a sweep, have bounds that may be 1e9 times the response. Those whose bounds exceed
    3 times every response that is larger than its own bound are left out, and the note says so; `lines` that are given stay.
    So are lines that have no more than what others leak to them, as smooth over the lines as a transient: in short parts of sweeps.

    Fewer periodic experiments than inputs, or inputs that no line excites together (1, 3, 5, ... and 2, 4, 6, ..., say). The mean
    period of every experiment has the spectrum ``G U + T`` at the lines of the period, T being what its first state leaves, and
    no period is left out; G is found by local models of these lines. So lines beside each other must show the resonances: modes
    that lie between the same two lines may pass for one.

    Blows. The spectrum of a short input is as smooth over the lines as a transient: no window tells one from the other. Records
    that begin at rest and ring out are periods instead, one each. What still rings at the end is the same in all of them: with the
    part rho that is left from the third quarter of a record to the last, whose spectrum is Y, at most ``|Y| rho/(1 - rho)`` is cut
    off; a quarter of its square, over that of the input, is added to the variance.

    Steps, and blows that are no periods: inputs that move a few times, from rest, and first within the first quarter of a record.
    The rest before them is known, and is put before each record; after it a step turns from line to line as no transient does.
    Their lines are those of the longer record, up to the last one at which the response is seen above the noise. Where records
    begin elsewhere than at zero, they are counted from what they are before anything moves; its error is in the bound.

    Halves of the periods are compared. Where they differ by D, beyond their noise at a level of 1e-3 for a whole entry,
    ``|D|^2/4`` is added to the variance: a plant that warms up. The note says so. Of any other excitation halves of the time, and
    halves of the records, are compared: what they have unlike in a window shows that they differ, at a level of 1e-5. Then each
    half is estimated alone, by its own poles, and the mean square distance of both from the response is added where it is more.

    With s^2 the estimated variance, |e|^2/s^2 is F(2, 2 dof) distributed, ``P(|e|^2 > x s^2) = (1 + x/dof)^(-dof)``,
    so that

        ``bound = s sqrt(dof (alpha^(-1/dof) - 1))``,  ``alpha = (1 - probability)/(lines ny nu)``
        (Bonferroni)

    (at the real lines 0 and Nyquist Student's t instead). The bound is never below the rounding errors of the
    DFT.

    Assumes noise that is independent from period to period (periodic) or of a spectrum that is smooth over the window (local) with
    normal DFT values, small against the input at the lines used; a linear plant within a realisation. Sources: `pintelon2012`,
    chapters 2, 4 and 7; `mckelvey2012` (local rational method); `chen2008` (how many poles).

    Examples
    --------
    >>> import numpy as np
    >>> from robustid import TimeRecord, estimate_frf
    >>> rng = np.random.default_rng(0)
    >>> u = np.tile(np.cos(2 * np.pi * 3 * np.arange(50) / 50), 10)
    >>> y = 2 * u + 0.1 * rng.standard_normal(u.size)
    >>> frf = estimate_frf(TimeRecord(u, y, dt=0.01, initial="periodic"), period=50)
    >>> frf.freq_hz, bool(abs(frf.values[0, 0, 0] - 2) < frf.bound[0, 0, 0])
    (array([6.]), True)
    """
    records, method, probability = _checked(record, period, method, probability, about)
    faults = record_faults(records, period=_period(records, method, period))
    for fault in faults:
        _log.warning("%s", fault)
    found = _finished(
        records[0], _estimated(records, method, period, lines), probability, about, asked=lines is not None
    )
    return dataclasses.replace(found, faults=faults)


def response_alone(
    record: TimeRecord | Sequence[TimeRecord],
    *,
    period: int | None = None,
    method: str | None = None,
    lines: ArrayLike | None = None,
    probability: float = 0.95,
    about: str = "mean",
) -> FrequencyResponse:
    """The same as `estimate_frf`, of records that are made of others: nothing is said of their faults."""
    records, method, probability = _checked(record, period, method, probability, about)
    return _finished(
        records[0], _estimated(records, method, period, lines), probability, about, asked=lines is not None
    )


def _checked(
    record: TimeRecord | Sequence[TimeRecord], period: int | None, method: str | None, probability: float, about: str
) -> tuple[list[TimeRecord], str, float]:
    """Records, the method, the probability."""
    if method not in (None, *_METHODS):
        raise InputError(f"`method` must be one of {_METHODS}; got {method!r}")
    if about not in ABOUT:
        raise InputError(f"`about` must be one of {tuple(ABOUT)}; got {about!r}")
    probability = as_probability(probability)
    records = checked_records(record)
    method = method or _usual(records, period)
    _refuse_dead(records, method)
    if method != "periodic" and period is not None:
        raise InputError(f'`period` belongs to method="periodic"; leave it out with method={method!r}')
    return records, method, probability


def _usual(records: Sequence[TimeRecord], period: int | None) -> str:
    """The method where none is stated."""
    repeats = period is not None or all(r.initial == "periodic" for r in records) or are_blows(records, period)
    return "periodic" if repeats else "local"


def _estimated(records: list[TimeRecord], method: str, period: int | None, lines: ArrayLike | None) -> Estimate:
    if method == "periodic" and are_blows(records, period):
        steady = [dataclasses.replace(one, initial="periodic", bound=None) for one in records]
        return with_ringing(periodic(steady, period, lines), records)
    if method == "periodic":
        return periodic(records, period, lines)
    return (local_from_rest if method == "local" else welch)(records, lines)


def _finished(
    first: TimeRecord, estimate: Estimate, probability: float, about: str, *, asked: bool
) -> FrequencyResponse:
    """The response of an estimate with its bound, at lines that were asked for or say something: joint with those left out."""
    found = bound(estimate, probability, about)
    silent = np.zeros(len(estimate.index), bool)
    if not asked:
        silent = silent_lines(estimate.values, found.radius)
        if estimate.driven is not None:
            silent |= ~estimate.driven
    if np.all(silent):
        raise InputError(
            "`record`: what moves the inputs passes for a transient at every spectral line, and nothing tells the response; let the"
            " machine come to rest, and record that before it is moved, or move it longer; or give the record as samples"
        )
    gone = int(silent.sum())
    left_out = f"; {gone} more {'is' if gone == 1 else 'are'} left out, which next to nothing excites"
    response = FrequencyResponse(
        estimate.step * estimate.index,
        estimate.values,
        bound=found,
        covariance=estimate.covariance,
        dt=first.dt,
        inputs=first.inputs,
        outputs=first.outputs,
        note=f"{counted(int(np.sum(~silent)), 'frequency point')}, {estimate.source}{left_out if np.any(silent) else ''}",
        dof=found.dof,
        coherence=estimate.coherence,
        noise=estimate.noise,
        distortion=estimate.distortion,
        changed=estimate.changed,
        doubt=estimate.doubt,
        modes=tuple((a / first.dt, b / first.dt, c, d) for a, b, c, d in estimate.modes),
    )
    return response.select(~silent) if np.any(silent) else response


def _period(records: list[TimeRecord], method: str, period: int | None) -> int | None:
    """Period that is stated: without a number, each record is one."""
    if method != "periodic":
        return None
    return len(records[0].u) if period is None else as_count("period", period, least=2)


def _refuse_dead(records: list[TimeRecord], method: str) -> None:
    """Inputs that excite nothing, and outputs that say nothing, in any experiment are refused; local models take steps."""
    for k, channel in enumerate(records[0].inputs if records[0].reference is None else ()):
        stepped = method == "local" and any(is_step(one) and one.u[0, k] != 0 for one in records)
        if not stepped and all(np.all(r.u[:, k] == r.u[0, k]) for r in records):
            raise InputError(
                f"`record`: input {channel.name} is constant ({records[0].u[0, k] + 0.0:.6g}): it excites nothing, and no"
                " response to it can be estimated; leave that signal out, or take a part of the record in which it moves"
            )
    for k, channel in enumerate(records[0].outputs):
        if all(np.all(r.y[:, k] == r.y[0, k]) for r in records):
            raise InputError(
                f"`record`: output {channel.name} is constant ({records[0].y[0, k]:.6g}): a sensor that is not connected, or"
                " saturated; leave that signal out"
            )


def checked_records(record: TimeRecord | Sequence[TimeRecord]) -> list[TimeRecord]:
    """Experiments with the same signals, sample time and length."""
    records = as_records("record", record)
    first = records[0]
    for k, other in enumerate(records):
        for what, a, b in (
            ("sample time", first.dt, other.dt),
            ("shape of u", first.u.shape, other.u.shape),
            ("shape of y", first.y.shape, other.y.shape),
            ("reference (in all or none)", _reference(first), _reference(other)),
        ):
            if a != b:
                words = f"`record`: all experiments must have the same {what}; got {a} and {b} (number {k})"
                raise InputError(words, *_cut(records))
    return records


def _cut(records: list[TimeRecord]) -> list[str | Remedy]:
    """End of a sentence for records that differ in their length alone."""
    if len({(one.dt, one.u.shape[1:], one.y.shape[1:], one.reference is None) for one in records}) > 1:
        return []
    least = min(len(one.u) for one in records)
    return ["; cut them to ", Remedy({"samples": least}, f"{least} samples")]


def _reference(record: TimeRecord) -> tuple[int, ...] | None:
    return None if record.reference is None else record.reference.shape
