"""Value sets at many frequencies: over any executor, streamed to a folder from which an interrupted sweep goes on."""

from __future__ import annotations

import contextlib
import functools
import itertools
import logging
import os
import pathlib
import pickle
import time
import zipfile
from collections.abc import Callable, Generator, Hashable, Iterable, Mapping
from concurrent.futures import Executor
from typing import TYPE_CHECKING, NamedTuple, Protocol, TypedDict, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robustid.core import (
    Budget,
    Complex,
    Interruptible,
    Progress,
    Real,
    Workers,
    atomic_write,
    fingerprint,
    read_arrays,
    threads_for,
)
from robustid.errors import InputError, SolverError
from robustid.guarantees.consistent_set import ConsistentSet
from robustid.guarantees.packing import pack_values, unpack_values
from robustid.guarantees.polygons import value_sets_at
from robustid.guarantees.value_set import ValueSet

if TYPE_CHECKING:
    import control

Processes = Executor | int | None  # over any executor, over so many processes of our own, or in this process
Folder = str | os.PathLike[str]

Asked = TypeVar("Asked", bound=Hashable)
Found = TypeVar("Found")
_log = logging.getLogger("robustid")
Sets = tuple[ValueSet, ...]  # of the entries at one frequency
_WORDS = "bounding the error at every frequency"
_LOOSE = 8.0  # radius of a known disc over the half-width of an ellipsoid inside the set, where it may be twice what can be proved
_TOGETHER = 24  # frequencies whose widths are estimated at once, where each is a node of its own


def answers(
    ask: Callable[[ConsistentSet, Asked], Found],
    consistent: ConsistentSet,
    wanted: Iterable[Asked],
    executor: Processes,
    name: Callable[[Asked], str],
) -> Generator[tuple[Asked, Found]]:
    """(question, answer) as they are found; `ask` is a function of a module, or a partial of one, `name` a question in words."""
    wanted = list(wanted)
    if executor is None or not wanted:
        for one in wanted:
            yield one, _limited(ask, consistent, one)
        return
    # Packed once, and unpacked once by every worker: what it derives from the arrays serves all its questions.
    packed = pickle.dumps(consistent)
    with Workers(executor) as workers:
        yield from workers.run(_packed, (ask, packed), wanted, name)


def _limited(ask: Callable[[ConsistentSet, Asked], Found], consistent: ConsistentSet, one: Asked) -> Found:
    with threads_for(consistent.data.sarason.pair.order):
        return ask(consistent, one)


def _packed(ask: Callable[[ConsistentSet, Asked], Found], packed: bytes, one: Asked) -> Found:
    return _limited(ask, _unpacked(packed), one)


@functools.lru_cache(maxsize=2)
def _unpacked(packed: bytes) -> ConsistentSet:
    return pickle.loads(packed)


class Means(NamedTuple):
    """Workers, receiver of progress, folder of what is finished, and time of a sweep."""

    executor: Processes = None
    progress: Progress | None = None
    resume: Folder | None = None
    budget: Budget | None = None

    def part(self, name: str, share: float = 1.0, progress: Progress | None = None) -> Means:
        """The same for a part of the work: a folder of its own, a share of the time that is left, and its own receiver."""
        folder = None if self.resume is None else pathlib.Path(self.resume) / name
        return Means(self.executor, progress, folder, None if self.budget is None else self.budget.share(share))

    @property
    def options(self) -> Options:
        """The same as keywords of a public function."""
        limit = None if self.budget is None else self.budget.seconds
        return {"executor": self.executor, "progress": self.progress, "resume": self.resume, "time_limit": limit}


class Options(TypedDict):
    """Keywords of the public functions that sweep."""

    executor: Processes
    progress: Progress | None
    resume: Folder | None
    time_limit: float | None


class Known(Protocol):
    """Discs that are known to hold the responses before a sweep, a `Band` for instance."""

    @property
    def range(self) -> tuple[float, float]:
        """Frequencies between which they are known, rad/s."""
        ...

    def at(self, omega: ArrayLike) -> tuple[Complex, Real]:
        """Centres and radii, (F, ny, nu) each."""
        ...


def value_sets(
    consistent: ConsistentSet,
    omega: Real,
    directions: int,
    gap: float,
    means: Means,
    model: control.StateSpace | None = None,
    known: Known | None = None,
    least: int = 1,
) -> list[ValueSet]:
    """The value sets of all entries at each frequency, in their order; `progress` is told of them.

    Those of matrices have their sides where they bound the distance from a model. `_order` says which come first; a folder holds
    those that are finished. Where the budget is over, and on Ctrl-C without a folder, those finished by then, of the budget so
    many at `least`; one that is begun in this process is given up there.
    """
    executor, progress, resume, budget = means
    store = None if resume is None else _Store(resume, consistent, directions, gap)
    found = {} if store is None else store.load(omega.tolist())
    if found and progress is not None:
        progress(_WORDS, len(found), omega.size)
    missing = [w for w in omega.tolist() if w not in found]
    order = _order(consistent, missing)
    if known is not None and len(missing) > 1:
        first = loose(consistent, np.array(missing), known)
        order = [*first, *(k for k in order if k not in set(first))]
    missing = [missing[k] for k in order]
    longest, last = 0.0, time.monotonic()
    with Interruptible(lambda: store is None and bool(found)) as sweep:
        try:
            # Closed at once, whatever happens: the processes of our own end with it.
            about = {} if model is None else _values_of(model, missing, consistent)
            whole = functools.partial(_one, directions=directions, gap=gap, about=about)

            def ask(here: ConsistentSet, w: float) -> Sets:
                return whole(here, w, budget=budget if len(found) >= least else None)

            each = answers(ask if executor is None else whole, consistent, missing, executor, "{:.9g} rad/s".format)
            with contextlib.closing(each):
                for w, value in each:
                    if not value:
                        break
                    if store is not None:
                        store.write(value)
                    found[w] = value
                    if progress is not None:
                        progress(_WORDS, len(found), omega.size)
                    longest, last = max(longest, time.monotonic() - last), time.monotonic()
                    if budget is not None and budget.left <= (longest if executor is None else 0.0):
                        break  # another one may not end in time
        except SolverError as error:
            kept = "give `resume` a folder to keep what is finished"
            if store is not None:
                kept = f"{len(found)} of {omega.size} frequencies are in {store.folder}, to go on from"
            raise SolverError(f"{error}; {kept}") from error
    if sweep.interrupted:
        _log.warning("interrupted: %d of %d frequencies are finished, and returned", len(found), omega.size)
    return [one for w in omega.tolist() for one in found.get(w, ())]


def _order(consistent: ConsistentSet, omega: list[float]) -> list[int]:
    """The widest frequencies first, by turns with others that are spread over all of them; last those outside of the data.

    The widths are those of an ellipsoid inside the set, for the price of one problem where frequencies are no nodes of it.
    """
    spread_out = spread_order(len(omega))
    if len(omega) < 3 or consistent.posed_at(omega[0]) is not consistent.posed:
        return spread_out
    widest = np.argsort(-np.linalg.norm(consistent.spreads(np.array(omega)), axis=(1, 2)), kind="stable").tolist()
    turns = list(dict.fromkeys(itertools.chain.from_iterable(zip(widest, spread_out, strict=True))))
    points = [end for frf in consistent.posed.problem.frequency for end in (frf.omega.min(), frf.omega.max())]
    low, high = (min(points), max(points)) if points else (0.0, np.inf)
    return sorted(turns, key=lambda k: not low <= omega[k] <= high)


def loose(consistent: ConsistentSet, omega: Real, known: Known) -> list[int]:
    """Numbers of the frequencies at which known discs may be twice as large as can be proved, the loosest first.

    Of 240 values on random problems all 12 with a ratio above two were among the 58 that this names, with a median of 1.7.
    """
    ratio = looseness(consistent, omega, known)
    order: list[int] = np.argsort(-ratio, kind="stable").tolist()
    return [k for k in order if ratio[k] > _LOOSE]


def looseness(consistent: ConsistentSet, omega: Real, known: Known) -> Real:
    """Radii of known discs over the half-widths of ellipsoids inside the sets of values, the largest of the entries, (F,)."""
    # On five random problems, about two models each, it was four to six times the ratio of the two proved errors, and its ranks
    # followed those of that ratio with a correlation of 0.83; those of the error over its estimate from the ellipsoid with 0.75,
    # and over the bound of the nearest sample and the distance from it with 0.52.
    alone = consistent.posed_at(float(omega[0])) is not consistent.posed  # each frequency is a node of its own
    size = _TOGETHER if alone else omega.size
    half = np.concatenate([consistent.spreads(omega[k : k + size]) for k in range(0, omega.size, size)])
    _, radius = known.at(np.clip(omega, *known.range))
    return (radius / np.maximum(half, np.finfo(float).tiny)).max(axis=(1, 2))


def spread_order(count: int) -> list[int]:
    """The numbers below `count` in an order of which every beginning is spread over all of them: 0, middle, quarters, ..."""
    bits = max(count - 1, 1).bit_length()
    turned = (int(f"{k:0{bits}b}"[::-1], 2) for k in range(2**bits))
    return [k for k in turned if k < count]


def _values_of(model: control.StateSpace, omega: list[float], consistent: ConsistentSet) -> dict[float, Complex]:
    """Values of a model at frequencies, where sides are found around them."""
    problem = consistent.posed.problem
    if problem.entries.single:
        return {}
    return dict(zip(omega, problem.plane.values_at(model, np.array(omega)), strict=True))


def _one(
    consistent: ConsistentSet,
    omega: float,
    directions: int,
    gap: float,
    about: Mapping[float, Complex],
    budget: Budget | None = None,
) -> Sets:
    return value_sets_at(consistent, omega, directions, gap, about.get(omega), budget)


class _Store:
    """A folder with one file for every frequency, named after problem, settings and frequency, and bound to them inside."""

    def __init__(self, folder: Folder, consistent: ConsistentSet, directions: int, gap: float):
        self.folder = pathlib.Path(folder)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"`resume` = {str(folder)!r} can't be a folder: {error.strerror}") from None
        self._digest, self._settings = _identity(consistent), (directions, gap)
        self._dt, self._entries = consistent.posed.problem.dt, consistent.posed.problem.entries
        others = [f for f in self.folder.glob("values-*.npz") if not f.name.startswith(self._prefix)]
        if others:
            _log.warning("%s: %d results there are of other data, and are left alone", self.folder, len(others))

    @property
    def _prefix(self) -> str:
        return f"values-{self._digest[:16]}-"

    def _path(self, omega: float) -> pathlib.Path:
        directions, gap = self._settings
        return self.folder / f"{self._prefix}{directions}-{gap!r}-{omega!r}.npz"

    def load(self, omega: list[float]) -> dict[float, Sets]:
        """Value sets that are there of these frequencies; files that can't be used are named, and left out."""
        found: dict[float, Sets] = {}
        for w in omega:
            path = self._path(w)
            if not path.exists():
                continue
            try:
                found[w] = self._read(path, w)
            except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
                _log.warning("%s can't be used (%s); its frequency is computed again", path, error)
        return found

    def _read(self, path: pathlib.Path, omega: float) -> Sets:
        arrays = read_arrays(path)
        if not np.array_equal(arrays.pop("identity"), self._bound(omega)):
            raise ValueError("it is of other data or settings")
        return tuple(unpack_values(arrays, self._dt, self._entries, self._settings[0]))

    def write(self, values: Sets) -> None:
        """The values of one frequency, whole or not at all."""
        omega = values[0].omega
        path = self._path(omega)
        try:
            with atomic_write(path, "wb") as file:
                np.savez(file, allow_pickle=False, identity=self._bound(omega), **pack_values(values))  # type: ignore[arg-type]
        except OSError as error:
            raise InputError(
                f"`resume`: {path} can't be written ({error.strerror}); what is finished stays in {self.folder}:"
                " make room, and run the same again"
            ) from error

    def _bound(self, omega: float) -> NDArray[np.str_]:
        directions, gap = self._settings
        return np.array(fingerprint((self._digest, directions, gap, omega)))


def _identity(consistent: ConsistentSet) -> str:
    """Digest of everything that the values and their certificates are about: data, assumptions, basis, level."""
    pair = consistent.data.sarason.pair
    return fingerprint((consistent.posed.problem, pair.A, pair.c, consistent.level))
