"""common_modes(): the modes of one machine from several setups, or the proof that these contradict each other."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple, cast

import numpy as np

from robustid.advice.kautz import suggest_kautz
from robustid.advice.setups_result import CommonModes
from robustid.core import Real
from robustid.data import FrequencyResponse, as_frequency_response, as_probability, variances
from robustid.errors import InputError, InputTypeError

Setups = Mapping[str, FrequencyResponse] | Sequence[FrequencyResponse]
_FAR = 1.2  # ratio of two natural frequencies, above which they are of two modes
_BETWEEN = 1 / 3  # part of the distance to the next mode of a setup, up to which two setups show one mode


class _Box(NamedTuple):
    """Pole box of a mode in one setup; logarithms of its estimate and of the ends of its natural frequency; may it be used, and
    the probability at most that it does not hold the pole, NaN where nothing says it; estimates with half-widths, (2, 2).
    """

    setup: int
    place: float
    low: float
    high: float
    ends: Real
    sure: bool
    level: float
    fails: float
    estimate: Real


def common_modes(setups: Setups, *, probability: float = 0.95) -> CommonModes:
    r"""Modes of one machine from several setups: roving hammers or sensors, several shakers, several days.

    Each setup leaves a box of each pole that it shows, in natural frequency and damping (`suggest_kautz`). The pole of the machine
    is in all of them, and around the mean of their estimates, weighted by the squares of their half-widths h,

    .. math:: (\omega_m, \zeta_m) \in \bigcap_s B_{ms}, \qquad
        \Bigl|\log\omega_m - \sum_s \frac{H^2}{h_s^2} \log\hat\omega_{ms}\Bigr| \le H, \quad H^{-2} = \sum_s h_s^{-2},

    the damping likewise, together with probability

    .. math:: P \ge 1 - \sum_s \alpha_{ms} - \max_s \alpha_{ms}, \qquad \alpha_{ms} = (1 - p_s)\, \frac{n_{ms}}{N_s}

    with the joint bounds of all N values of each setup, at p, of which the box uses n around the mode. Boxes are rectangles: an
    empty intersection is always that of two of them, so that two disjoint intervals are its proof, and nothing is averaged.

    Parameters
    ----------
    setups : sequence of FrequencyResponse, or mapping of names to them
        Two or more, each with its own inputs and outputs; modes that a setup does not show are no contradiction. Of a response with
        a covariance the bound is taken anew, from that; hard bounds and others stay as they are.
    probability : float
        p of each bound that is taken from a covariance, for all values of its setup at once.

    Returns
    -------
    CommonModes
        ``.freq_hz_interval``, ``.damping_interval`` (what all leave), ``.probability`` (of each mode), ``.disagreements``, ``.odd``
        (the setup that the others agree against), ``.summary()``, ``.save(path)``.

    Raises
    ------
    InputError, InputTypeError
        Fewer than two setups, one without a bound, something that isn't a response.

    Notes
    -----
    Two setups show one mode where their boxes overlap in frequency, or their estimates are nearest to each other, at most a fifth
    apart, and at most a third as far as the next mode of either setup. A box takes no part that reaches an end of its search, or
    overlaps two modes of another setup: of it is not known to which it belongs. A box that needs bounds times a factor (`level`)
    takes part without a probability: what it contradicts is evidence, no proof. The boxes
    are those of bounds that hold for all values at once: they are wider than confidence intervals of a pole alone, and need
    no estimate of its distribution. Half-widths are those of the estimate by local least squares, of normal errors that at
    different points of a setup may depend on each other in any way (standard deviations add up), at the box's own alpha; errors of
    different setups are taken to be independent. Estimates take part in a mean where the box keeps to the bounds and has an alpha
    above 0, of known covariance, and where each is within its half-width of the mean: what scatters more is not independent error
    alone, and the boxes are left. A bound with a probability and no covariance is not known to fail equally rarely everywhere:
    it counts in whole. Source: Bonferroni; Aitken 1935 (inverse variances); minimax by reweighting, `lawson1961`.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> omega, rng = np.linspace(40.0, 90.0, 51), np.random.default_rng(0)
    >>> def setup(gains, first=50.0):
    ...     values = sum(g / (w**2 - omega**2 + 0.02j * w * omega) for g, w in zip(gains, (first, 70.0)))
    ...     noise = 2e-5 * (rng.standard_normal(51) + 1j * rng.standard_normal(51))
    ...     return rid.FrequencyResponse(omega, values + noise, covariance=np.full((51, 1, 1), 8e-10))
    >>> same = rid.advise.common_modes([setup((1.0, 0.5)), setup((0.5, -1.0)), setup((0.0, 1.0))])
    >>> same.disagreements, same.used.sum(axis=1).tolist()
    ((), [2, 3])
    >>> other = rid.advise.common_modes({"a": setup((1.0, 0.5)), "b": setup((0.5, 1.0)), "c": setup((1.0, 1.0), first=49.0)})
    >>> other.odd, [one.mode for one in other.disagreements]
    ('c', [0])
    """
    names, responses = _named(setups)
    probability = as_probability(probability)
    bounded = [_bounded(name, one, probability) for name, one in zip(names, responses, strict=True)]
    boxes = [box for s, one in enumerate(bounded) for box in _boxes(s, one)]
    groups = _matched(boxes)
    groups.sort(key=lambda group: np.mean([boxes[k].place for k in group]))
    ends = np.full((len(groups), len(names), 2, 2), np.nan)
    used = np.zeros((len(groups), len(names)), bool)
    level, fails, estimates = np.ones(used.shape), np.zeros(used.shape), np.full(ends.shape, np.nan)
    for mode, group in enumerate(groups):
        for box in (boxes[k] for k in group):
            ends[mode, box.setup], level[mode, box.setup], fails[mode, box.setup] = box.ends, box.level, box.fails
            estimates[mode, box.setup] = box.estimate
            used[mode, box.setup] = box.sure and not _between(box, boxes)
    return CommonModes(
        names=names,
        omega_intervals=ends[:, :, 0],
        damping_intervals=ends[:, :, 1],
        used=used,
        level=level,
        fails=fails,
        estimates=estimates,
    )


def _named(setups: object) -> tuple[tuple[str, ...], list[FrequencyResponse]]:
    if isinstance(setups, Mapping):
        given = cast("Mapping[object, object]", setups)
        names, items = [str(name) for name in given], list(given.values())
    elif isinstance(setups, Sequence) and not isinstance(setups, str):
        items = list(cast("Sequence[object]", setups))
        names = [f"setup {k + 1}" for k in range(len(items))]
    else:
        raise InputTypeError(
            f"`setups` must be a sequence of FrequencyResponse, or a mapping of names to them; got {type(setups).__name__}"
        )
    if len(items) < 2:
        raise InputError(f"`setups` has {len(items)}: two at least can agree; of one, suggest_kautz finds the modes")
    return tuple(names), [as_frequency_response("setups", one) for one in items]


def _bounded(name: str, frf: FrequencyResponse, probability: float) -> FrequencyResponse:
    """The response with its bound; without the modes that its records show, which have no probability."""
    frf = dataclasses.replace(frf, modes=())
    if frf.bound is not None and frf.bound.kind == "hard":
        return frf
    if frf.covariance is not None:
        return frf.with_joint_bound(probability)
    if frf.bound is None:
        raise InputError(
            f"`setups`: {name} has neither a bound nor a covariance, so that nothing says how far its modes are known; take"
            " estimate_bound(frf), or give the bound that you know",
            argument="setups",
        )
    return frf


def _fails(frf: FrequencyResponse) -> tuple[float, bool]:
    """Probability at most that a bound fails somewhere, NaN where nothing says it; is it as rare everywhere."""
    if frf.bound.kind == "hard":
        return 0.0, True
    probability = frf.bound.probability
    return np.nan if probability is None else 1 - probability, frf.covariance is not None


def _boxes(setup: int, frf: FrequencyResponse) -> Iterator[_Box]:
    """Boxes of the light modes that a setup shows; of real poles, and of what lies far above the points, there are none."""
    found, (chance, even) = suggest_kautz(frf), _fails(frf)
    for k, omega in enumerate(found.omega.tolist()):
        ends = np.array([found.omega_interval[k], found.damping_interval[k]])
        if found.damping[k] < 1 and ends[0, 0] < ends[0, 1]:
            low, high = np.log(ends[0]).tolist()
            level = float(found.level[k])
            fails = np.nan if level > 1 else chance * (float(found.share[k]) if even else 1.0)
            estimate = found.linear[k] * [1.0, _part(frf, fails)]
            yield _Box(setup, float(np.log(omega)), low, high, ends, not found.reached[k], level, fails, estimate)


def _part(frf: FrequencyResponse, fails: float) -> float:
    """Half-width of the interval of a linear estimate over the most that errors as large as the bounds move it by.

    Of normal errors, frequency and damping together; NaN where there is no covariance, or nothing fails. The bounds are the same
    multiple of all standard deviations, those of real values alone apart, and standard deviations of a sum at most add up.
    """
    from scipy.special import stdtrit

    if frf.covariance is None or frf.bound.kind == "hard" or not fails > 0:
        return np.nan
    deviations = np.sqrt(variances(frf.covariance, frf.values.shape))
    parts = np.where(frf.all_real, 1.0, np.sqrt(0.5))[:, None, None] * deviations / frf.bound.outer_radius
    return float(stdtrit(np.inf if frf.dof is None else frf.dof, 1 - fails / 4) * np.max(parts[~frf.missing]))


def _overlap(one: _Box, other: _Box) -> bool:
    return one.low <= other.high and other.low <= one.high


def _between(box: _Box, boxes: Sequence[_Box]) -> bool:
    """Tell whether a box overlaps two modes of another setup, of which it is either, or both as one."""
    touched = [other.setup for other in boxes if other.setup != box.setup and _overlap(box, other)]
    return len(set(touched)) < len(touched)


def _matched(boxes: Sequence[_Box]) -> list[list[int]]:
    """Boxes of one mode together, by their numbers: nearest pairs first, one of each setup."""
    place = np.array([box.place for box in boxes])
    setup = np.array([box.setup for box in boxes])
    far = np.abs(place[:, None] - place)
    room = np.where((setup[:, None] == setup) & ~np.eye(len(boxes), dtype=bool), far, np.inf).min(
        axis=1, initial=np.inf
    )
    alone = [_between(box, boxes) for box in boxes]
    group: list[list[int]] = [[k] for k in range(len(boxes))]
    others = [(i, j) for j in range(len(boxes)) for i in range(j) if boxes[i].setup != boxes[j].setup]
    for i, j in sorted(others, key=lambda pair: float(far[pair])):
        near = far[i, j] <= min(np.log(_FAR), _BETWEEN * room[i], _BETWEEN * room[j])
        apart = bool({boxes[k].setup for k in group[i]} & {boxes[k].setup for k in group[j]})
        if not apart and not alone[i] and not alone[j] and (near or _overlap(boxes[i], boxes[j])):
            group[i] += group[j]
            for k in group[i]:
                group[k] = group[i]
    return [one for k, one in enumerate(group) if min(one) == k]
