"""watch(): records of a machine against the band that was proved for it, one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from robustid.core import StateMatrices, as_kind, counted
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.guarantees.coverage import coverage, on_lines
from robustid.guarantees.drift import check_rate
from robustid.guarantees.response_discs import Discs, ResponseDiscs
from robustid.guarantees.watch_result import Watch
from robustid.identification import as_system

if TYPE_CHECKING:
    import control

RATE = 0.002  # false alarms of a drift in a record


def watch(
    band: Discs,
    *,
    usual: FrequencyResponse | Sequence[FrequencyResponse] = (),
    rate: float | None = None,
    controller: control.StateSpace | None = None,
) -> Watch:
    r"""Watch over a machine: every new record is held against the band that was proved for it.

    The score of a record is the smallest factor on the half-widths r of the band and on its own bound e, together, that holds it:

    .. math:: s = \max_{\omega, i, j} \frac{|y_{ij}(\omega) - c_{ij}(\omega)|}{r_{ij}(\omega) + e_{ij}(\omega)},

    so that lines where the record itself says little don't hide those where it says much. Two alarms:

    * *refuted*: at a frequency the record, with a bound that is hard or fails once in a million records, has no point in common
      with the disc that holds every consistent plant: no plant of the class explains the old data and the new. A proof, by the
      certificate of the band there.
    * *drifted*: the scores are larger than those before them, see `guarantees.drift`: with e-values of the ranks
      :math:`M_n = e_n(1 + M_{n-1}) \ge 1/\alpha`, on average at most one false alarm in :math:`1/\alpha` records.

    Parameters
    ----------
    band : Band, WorstCaseError, WorstCaseOverPoles, Family or FrequencyResponse
        What is promised; of a response its values with their bounds. Conditions that are known to change the plant are members
        of a family: the score of a record is then the smallest one of all members, and it is refuted where no member explains it,
        or not the one whose condition `update` states. Plants between two members are none of the family.
    usual : FrequencyResponse or sequence of them, optional
        Records that the band was not made from, of the machine as it should be. The more, the sooner a drift is seen.
    rate : float, optional
        alpha, default 0.002.
    controller : control.StateSpace, optional
        C of the loop ``u = -C y``: the peak of the sensitivity ``(I + P C)^-1`` of every record is compared with what the band
        allows at the same frequencies.

    Returns
    -------
    Watch
        `update(record)` gives a new one; `save` and `robustid.load` keep it between records.

    Raises
    ------
    InputError, InputTypeError
        Responses or a controller of other signals or another sample time; a rate that is none.

    Notes
    -----
    Assumed for the rate: the records are exchangeable while the machine is as it was, that is measured in the same way and
    independent; nothing is assumed of their distribution. For *refuted*: the assumptions of the band. Source: `shin2024`.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> omega, rng = np.array([1.0, 2.0]), np.random.default_rng(0)
    >>> band = rid.FrequencyResponse(omega, [1.0, 0.5], bound=0.1, dt=1.0)
    >>> def record(change=0.0):
    ...     return rid.FrequencyResponse(omega, [1.0, 0.5 + change + 0.05 * rng.uniform(-1, 1)], bound=0.02, dt=1.0)
    >>> watched = rid.watch(band, usual=[record() for _ in range(20)])
    >>> for change in (0.0, 0.0, 0.3):
    ...     watched = watched.update(record(change))
    >>> [one.name for one in watched.refuted], watched.history[-1].score > 2
    (['record 3'], True)
    """
    before = (usual,) if isinstance(usual, FrequencyResponse) else tuple(usual)
    for one in before:
        as_kind("usual", one, FrequencyResponse, "a FrequencyResponse or a sequence of them")
    rate = RATE if rate is None else check_rate(rate)
    discs = ResponseDiscs.of(band)
    if before:
        coverage(on_lines(band, before), before)  # refuses what does not belong to the band
    return Watch(band=band, usual=before, records=(), names=(), rate=rate, controller=_controller(controller, discs))


def _controller(controller: control.StateSpace | None, discs: ResponseDiscs) -> StateMatrices | None:
    if controller is None:
        return None
    matrices, dt = as_system("controller", controller)
    outputs, inputs = discs.radius.shape[1:]
    if matrices.D.shape != (inputs, outputs):
        size = "{} x {}".format(*matrices.D.shape)
        raise InputError(
            f"`controller` is {size}; for a band of {counted(outputs, 'output')} and {counted(inputs, 'input')} it is"
            f" {inputs} x {outputs}",
            argument="controller",
        )
    if dt is not None and abs(float(dt) - discs.dt) > 1e-9 * discs.dt:
        raise InputError(
            f"`controller` has the sample time {float(dt):.6g} s, the band {discs.dt:.6g} s; give it as it runs",
            argument="controller",
        )
    return matrices
