"""Modes that moved: of a watched machine, the last record beside what was before the watch."""

from __future__ import annotations

from robustid.advice.setups import common_modes
from robustid.advice.setups_result import Moved
from robustid.core import as_kind
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.guarantees import Family, Watch

_MOST = 6  # responses from before that are looked at


def moved_modes(watch: Watch) -> tuple[Moved, ...]:
    """Modes of the last record of a watch beside those that the band was made from and the usual records show.

    Parameters
    ----------
    watch : Watch
        With a record. Of what was before, the data of the band are taken, of all members of a family, and then the latest usual
        records, six in all.

    Returns
    -------
    tuple of Moved
        Two of every mode that both show, its frequency and its damping: ``.before``, ``.after``, ``.change`` and ``.shown``, see
        `common_modes`. Where those from before contradict each other, as members of a family may, a mode has moved only where it is
        outside the range of all of them.

    Raises
    ------
    InputError, InputTypeError
        Nothing watched yet; nothing from before that has a bound; something that isn't a Watch.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> omega = np.linspace(40.0, 60.0, 61)
    >>> def record(mode, bound=1e-4):
    ...     return rid.FrequencyResponse(omega, 1 / (mode**2 - omega**2 + 0.02j * mode * omega), bound=bound)
    >>> watched = rid.watch(record(50.0), usual=[record(50.0)]).update(record(49.0))
    >>> [one.quantity for one in rid.advise.moved_modes(watched) if one.shown]
    ['frequency']
    """
    watch = as_kind("watch", watch, Watch, "a Watch")
    if not watch.records:
        raise InputError("`watch` has no record yet; give it one with update(record)", argument="watch")
    new = watch.records[-1]
    before = [one for one in [*_of_band(watch), *reversed(watch.usual)] if one.bound is not None][:_MOST]
    if not before or new.bound is None:
        raise InputError(
            "`watch` has no response with a bound from before, or its last record has none: nothing says how far modes are known",
            argument="watch",
        )
    found = common_modes({**{f"before {k + 1}": one for k, one in enumerate(before)}, "now": new})
    return found.moved("now")


def _of_band(watch: Watch) -> list[FrequencyResponse]:
    """Responses that the band was made from."""
    band = watch.band
    if isinstance(band, FrequencyResponse):
        return [band]
    problems = [m.identification.problem for m in band.members] if isinstance(band, Family) else [band.problem]
    return [one for problem in problems for one in problem.frequency if isinstance(one, FrequencyResponse)]
