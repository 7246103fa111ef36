"""Value sets and certificates as a few arrays: stacked, with the ranks of their factors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from robustid.core import Arrays, Complex, Real, part
from robustid.guarantees.consistent_set import independent_entries
from robustid.guarantees.value_set import FINE, ValueSet, closes, directions_at
from robustid.identification import SupportCertificate
from robustid.identification.formulation import SINGLE, Entries

_MASKS = "used_samples", "used_left", "used_right"

Mask = NDArray[np.bool_]
Counts = NDArray[np.intp]


def pack_certificates(certificates: Iterable[SupportCertificate]) -> Arrays:
    """Stacked multipliers of the samples, and the factors of Y behind each other; Y itself where that is smaller.

    Of those of a part of a problem without the zeros of the others: which rows are not zero is kept beside.
    """
    certificates = list(certificates)
    used = [(c.samples != 0, c.left.any(axis=1), c.right.any(axis=1)) for c in certificates]
    masks: Arrays = {}
    if not all(one.all() for each in used for one in each):
        flat = (np.concatenate(each) for each in zip(*used, strict=True))
        masks = dict(zip(_MASKS, flat, strict=True))
    else:
        used = [(slice(None),) * 3] * len(certificates)
    parts = [
        (c.samples[at], *_smaller(c.left[high], c.right[wide]))
        for c, (at, high, wide) in zip(certificates, used, strict=True)
    ]
    join = np.concatenate if masks else np.stack
    return masks | {
        "samples": join([samples for samples, *_ in parts]) if parts else np.zeros((0, 0), complex),
        "order": np.array([c.left.shape[0] for c in certificates], int),
        "width": np.array([c.right.shape[0] for c in certificates], int),
        "rank": np.array([-1 if len(f) == 1 else f[0].shape[1] for _, *f in parts], int),
        "factors": np.concatenate([np.zeros(0), *(part.ravel() for _, *f in parts for part in f)]),
        "level": np.array([c.level for c in certificates], float),
        "value": np.array([c.value for c in certificates], float),
    }


def _smaller(left: Real, right: Real) -> tuple[Real, ...]:
    (high, rank), wide = left.shape, right.shape[0]
    return (left @ right.T,) if (high + wide) * rank > high * wide else (left, right)


def unpack_certificates(arrays: Arrays) -> tuple[SupportCertificate, ...]:
    """Certificates from the arrays that `pack_certificates` made; ValueError where they do not fit together."""
    orders, ranks, factors, count = arrays["order"], arrays["rank"], arrays["factors"], arrays["order"].size
    widths = arrays.get("width", orders)  # old files of SISO plants have none
    if {len(arrays[name]) for name in ("rank", "level", "value")} | {len(widths)} != {count}:
        raise ValueError("the arrays of its certificates differ in length")
    if np.any(orders < 0) or np.any(widths < 0) or np.any(ranks < -1):
        raise ValueError("the factors of its certificates do not fit together")
    samples, left_rows, right_rows = _used(arrays, orders, widths)
    high, wide = (np.array([one.sum() for one in rows], int) for rows in (left_rows, right_rows))
    ends = np.cumsum(np.where(ranks < 0, high * wide, (high + wide) * ranks))
    if factors.size != (ends[-1] if ends.size else 0):
        raise ValueError("the factors of its certificates do not fit together")
    found: list[SupportCertificate] = []
    for k, parts in enumerate(np.split(factors, ends[:-1])[:count]):
        if ranks[k] < 0:
            left, right = parts.reshape(high[k], wide[k]), np.eye(wide[k])
        else:
            cut = high[k] * ranks[k]
            left, right = parts[:cut].reshape(high[k], ranks[k]), parts[cut:].reshape(wide[k], ranks[k])
        left, right = _with_zero_rows(left, left_rows[k]), _with_zero_rows(right, right_rows[k])
        found.append(SupportCertificate(samples[k], left, right, float(arrays["level"][k]), float(arrays["value"][k])))
    return tuple(found)


def _used(arrays: Arrays, orders: Counts, widths: Counts) -> tuple[Complex, list[Mask], list[Mask]]:
    """The multipliers of the samples of every certificate, and which rows of its factors are kept."""
    count, samples = orders.size, arrays["samples"]
    if _MASKS[0] not in arrays:
        if len(samples) != count:
            raise ValueError("the arrays of its certificates differ in length")
        all_rows = ([np.ones(size, bool) for size in sizes] for sizes in (orders, widths))
        return samples, next(all_rows), next(all_rows)
    kept, *sides = (arrays[name] for name in _MASKS)
    fits = all(one.dtype == bool and one.ndim == 1 for one in (kept, *sides)) and kept.size % max(count, 1) == 0
    if not (fits and kept.sum() == samples.size and [one.size for one in sides] == [orders.sum(), widths.sum()]):
        raise ValueError("the arrays of its certificates differ in length")
    everywhere = np.zeros(kept.size, complex)
    everywhere[kept] = samples
    left, right = (
        np.split(one, np.cumsum(sizes)[:-1])[:count] for one, sizes in zip(sides, (orders, widths), strict=True)
    )
    return everywhere.reshape(count, -1), left, right


def _with_zero_rows(factor: Real, rows: Mask) -> Real:
    """The factor with rows of zeros where it was packed without them."""
    whole = np.zeros((rows.size, factor.shape[1]))
    whole[rows] = factor
    return whole


def pack_values(values: Sequence[ValueSet]) -> Arrays:
    """Stacked value sets of any frequencies."""
    certificates = pack_certificates(c for v in values for c in v.certificates)
    angles = np.concatenate([np.zeros(0), *(v.directions for v in values)])
    # Those of all SISO plants are equally spaced, and known from their number.
    spaced = all(np.array_equal(v.directions, _equally_spaced(v.directions.size)) for v in values)
    return (
        ({} if spaced else {"directions": angles})
        | {
            "omega": np.array([v.omega for v in values], float),
            "sides": np.array([v.directions.size for v in values], int),
            "slack": np.array([v.slack for v in values], float),
            "support": np.concatenate([np.zeros(0), *(v.support for v in values)]),
            "entry": np.array([v.entry for v in values], int).reshape(-1, 2),
            "points": np.concatenate([np.zeros(0, complex), *(v.matrices.ravel() for v in values)]),
        }
        | {f"certificates/{name}": array for name, array in certificates.items()}
    )


def unpack_values(
    arrays: Arrays, dt: float, entries: Entries = SINGLE, directions: int | None = None
) -> list[ValueSet]:
    """Value sets from the arrays that `pack_values` made, with polygons of a number of directions (default: their own).

    ValueError for arrays that do not fit together, or polygons of another number of sides.
    """
    if not np.all((arrays["omega"] >= 0) & (arrays["omega"] * dt <= np.pi * (1 + 1e-9))):
        raise ValueError("its frequencies are not between 0 and pi/dt")
    ends = np.cumsum(arrays["sides"])
    angles = _directions(arrays, dt, directions)
    if arrays["slack"].size != len(angles):
        raise ValueError("its polygons do not have the sides of their number of directions")
    certificates = unpack_certificates(part(arrays, "certificates/"))
    shape = entries.outputs, entries.inputs
    points = arrays["points"].reshape(-1, *shape)
    total = int(ends[-1]) if ends.size else 0
    # MIMO: every polygon comes with two more values than it has sides; in old files with one.
    more = 0 if entries.single else (len(points) - total) // max(ends.size, 1)
    if more not in ((0,) if entries.single else (1, 2)):
        raise ValueError("its polygons and values differ in number")
    if (len(certificates), arrays["support"].size, len(points)) != (total, total, total + more * ends.size):
        raise ValueError("its polygons and certificates differ in number")
    expected = independent_entries(entries)
    places = arrays.get("entry", np.zeros((ends.size, 2), int))  # old files of SISO plants have none
    repeated = np.reshape(expected * (len(places) // len(expected)), (-1, 2))
    if not np.array_equal(places, repeated):
        raise ValueError("its polygons are not those of all entries, one after the other")
    if np.any(np.ptp(arrays["omega"].reshape(-1, len(expected)), axis=1)):
        raise ValueError("the polygons of its entries are not at the same frequencies")
    found: list[ValueSet] = []
    for k, end in enumerate(ends):
        at = slice(end - angles[k].size, end)
        omega, slack = float(arrays["omega"][k]), float(arrays["slack"][k])
        entry, matrices = expected[k % len(expected)], points[at.start + more * k : at.stop + more * (k + 1)]
        attained = matrices[: angles[k].size, *entry]
        proved = omega, angles[k], arrays["support"][at], attained, slack, certificates[at]
        found.append(ValueSet(*proved, entry, matrices))
    return found


def _equally_spaced(count: int) -> Real:
    return np.array([0.0, np.pi]) if count == 2 else 2 * np.pi * np.arange(count) / count


def _directions(arrays: Arrays, dt: float, most: int | None) -> list[Real]:
    """The directions of every polygon: stated, or equally spaced."""
    sides, omega, stated = arrays["sides"], arrays["omega"].tolist(), arrays.get("directions")
    if sides.size != len(omega) or np.any(sides < 2) or (stated is not None and stated.size != np.sum(sides)):
        raise ValueError("its directions do not fit to its polygons")
    # Two where the response is real only; of matrices fewer than were asked for where the first ones were enough.
    spaced = [directions_at(w, dt, max(int(count), 3)) for w, count in zip(omega, sides, strict=True)]
    if stated is None and not np.array_equal(sides, [one.size for one in spaced]):
        raise ValueError("its polygons do not have the sides of their number of directions")
    angles = spaced if stated is None else np.split(stated, np.cumsum(sides)[:-1])
    for w, one in zip(omega, angles, strict=True):
        allowed = most is None or np.isin(one, directions_at(w, dt, FINE * most)).all()
        if not (allowed and closes(one, w, dt)):
            raise ValueError("its polygons do not have sides that close, or not in the directions that were asked for")
    return angles
