"""A judge of proof files in exact fractions: complex discs with rational middles; no code of the package nor of the kernel in C."""

import functools
import hashlib
import json
import re
from collections.abc import Callable
from fractions import Fraction
from typing import Any

from support.proof_arcs import on_arcs
from support.proof_modes import Mode
from support.proof_numbers import GRID, Disc, Refused, number, root, rounded_up, solve, turn


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    if len({key for key, _ in pairs}) < len(pairs):
        raise Refused("a key stands twice")
    return dict(pairs)


class Judge:
    """One file."""

    def __init__(self, text: str) -> None:
        whole = json.loads(text, object_pairs_hook=_unique)
        start = re.search(r'"question"\s*:\s*', text)
        if start is None:
            raise Refused("no question")
        end = json.JSONDecoder().raw_decode(text, start.end())[1]
        if hashlib.sha256(text[start.end() : end].encode()).hexdigest() != whole["digest"]:
            raise Refused("another digest")
        if (whole["format"], whole["version"]) != ("robustid-proof", 1):
            raise Refused("another format")
        self.question, self.evidence = whole["question"], whole["evidence"]
        units, of = self.question["units"], self.question["class"]
        if (units["frequency"], units["time"]) != ("rad/s", "s"):
            raise Refused("other units")
        self.K, level = number(of["gain_bound"]), number(self.question["level"])
        self.continuous = self.question["sample_time"] == "continuous"
        if self.continuous:
            self.alpha, self.corner = (number(one) for one in of["decay_rate"])
            self.rho = self.T = 1 + self.alpha
        else:
            self.rho, self.T = number(of["decay_rate"]), number(self.question["sample_time"])
        if min(self.K, self.T, level, self.corner if self.continuous else 1) <= 0 or self.rho <= 1:
            raise Refused("no class")
        self.modes = [Mode(one) for one in of.get("modes", [])]
        if set(of) - {"modes"} != {"gain_bound", "decay_rate", "functions"}:
            raise Refused("other keys")
        self.matrices = {name: of["functions"][name] for name in "ABCD"}
        self.omega = [row[0] for row in self.question["data"]]
        self.y = [Disc(number(row[1]), number(row[2])) for row in self.question["data"]]
        self.bound = [number(row[3]) * level for row in self.question["data"]]
        if any(one <= 0 for one in self.bound):
            raise Refused("a bound that is not positive")
        self.N, self.fixed = len(self.y), len(self.matrices["D"])
        self.M = self.fixed + sum(2 * len(one.poles) for one in self.modes)
        if self.question["records"] and (self.modes or self.continuous):
            raise Refused("records")
        self.records: list[tuple[list[Fraction], int, Fraction, Fraction, list[Fraction]]] = []
        for one in self.question["records"]:
            u = [number(v) for v in one["input"]]
            answers = self.responses(u)
            for t, y, bound in one["samples"]:
                if not 0 <= t < len(u) or number(bound) <= 0:
                    raise Refused("a sample of a record")
                self.records.append((u, t, number(y), number(bound) * level, answers[t]))
        self.powers = max([self.evidence["powers"], *(len(u) for u, *_ in self.records)])
        placed = [self.place(one) for one in self.omega]
        self.nodes = [zeta for zeta, _ in placed] + [zeta.conj for zeta, _ in placed]
        self.P = [values for _, values in placed] + [self.conjugate(values) for _, values in placed]
        self.about: list[Disc] = []
        self.within: list[Fraction] = []

    def responses(self, u: list[Fraction]) -> list[list[Fraction]]:
        """The responses of the functions to an input, exactly."""
        A, B, C, D = (self.matrices[name] for name in "ABCD")
        state, found = [Fraction(0)] * len(B), []
        for one in u:
            found.append([_inner(c, state) + number(d) * one for c, d in zip(C, D, strict=True)])
            state = [_inner(a, state) + number(b) * one for a, b in zip(A, B, strict=True)]
            state = [Fraction(v.numerator * GRID // v.denominator, GRID) for v in state]
        return found

    def seen(self, k: int, m: int, nodes: list[Disc]) -> Disc:
        """The functional k of the function that stands for the functional m: values at nodes, then Taylor coefficients."""
        count = len(nodes)
        if k < count and m < count:
            return (Disc(1) - nodes[k] * nodes[m].conj).inverse
        if k < count:
            return _power(nodes[k], m - count)
        return _power(nodes[m].conj, k - count) if m < count else Disc(int(k == m))

    def conjugate(self, values: list[Disc]) -> list[Disc]:
        """The functions at the conjugate of a node: those of modes stand beside their conjugates."""
        own, pairs = values[: self.fixed], values[self.fixed :]
        return [one.conj for one in own + [pairs[k ^ 1] for k in range(len(pairs))]]

    def turned(self, omega: str) -> Disc:
        """exp(-j omega T), or (b - s)/(b + s) in continuous time; "half" is half the sample rate, or infinity."""
        if omega == "half":
            return Disc(-1)
        if self.continuous:
            w = number(omega)
            if w < 0:
                raise Refused("a frequency out of range")
            # (b - jw)^2/(b^2 + w^2)
            size = self.corner**2 + w**2
            return Disc((self.corner**2 - w**2) / size, -2 * self.corner * w / size)
        x = number(omega) * self.T
        if not 0 <= x <= 4:
            raise Refused("a frequency out of range")
        return turn(x)

    def place(self, omega: str) -> tuple[Disc, list[Disc]]:
        """Zeta and the values of the functions."""
        e = self.turned(omega)
        A, B, C, D = (self.matrices[name] for name in "ABCD")
        size = len(B)
        rows = [
            [(e.conj if a == b else Disc(0)) - Disc(number(A[a][b])) for b in range(size)] + [Disc(number(B[a]))]
            for a in range(size)
        ]
        state = solve(rows)
        values = [Disc(number(d)) for d in D]
        for i, row in enumerate(C):
            for a in range(size):
                values[i] += Disc(number(row[a])) * state[a]
        for mode in self.modes:
            values += mode.values(e)
        if not self.continuous:
            return e * Disc(1 / self.rho), values
        # (b - s)/(b + 2 alpha + s) at s = jw, which is b (1 - e)/(1 + e).
        kappa = Disc(self.alpha / self.corner)
        return e * (Disc(1) + kappa + kappa * e).inverse, values

    def norm(self, terms: dict[int, Disc], nodes: list[Disc], base: Disc) -> Fraction:
        """Above the norm of sum c_k phi(zeta_k) in H2 of the measure of the base."""
        total, count = Disc(0), len(nodes)
        room = 1 - root(base.re**2 + base.im**2) ** 2 if base.im else 1 - base.re**2
        if room <= 0:
            raise Refused("a base outside of the disc")
        turned: dict[int, Disc] = {}
        for k, c in terms.items():
            for at, one in ((k, c), (k, -base.conj * nodes[k] * c) if k < count else (k - 1, -base.conj * c)):
                if k < count or at >= count:
                    turned[at] = turned.get(at, Disc(0)) + one
        for k, c in turned.items():
            for m, d in turned.items():
                total += c * d.conj * self.seen(k, m, nodes)
        return root(max(total.re + total.error, Fraction(0)) / room)

    def sums(
        self, evidence: Any, target: dict[int, Disc], at: Any = None, wanted: int | None = None
    ) -> tuple[Disc, Fraction, Fraction]:
        """Centre and radius of the functional of all consistent systems, and the part of the radius from parameters."""
        zeta, values = at or (Disc(0), [Disc(0)] * self.M)
        nodes, P = [*self.nodes, zeta, zeta.conj], [*self.P, values, self.conjugate(values)]
        if set(evidence) != {"base", "factors", "multipliers"}:
            raise Refused("other keys")
        rest = dict(target)
        missed = [Disc(-1 if i == wanted else 0) for i in range(self.M)]
        for k, t in target.items():
            missed = [m - t * p for m, p in zip(missed, P[k], strict=True)]
        centre, radius = Disc(0), Fraction(0)
        for k, t in target.items():
            radius += t.most * self.beyond(P[k])
        for k, a, b in evidence["multipliers"]:
            d = Disc(number(a), number(b))
            if not 0 <= k < 2 * self.N + len(self.records):
                raise Refused("an index out of range")
            if k >= 2 * self.N:
                u, t, y, bound, answers = self.records[k - 2 * self.N]
                centre += d * Disc(y)
                radius += d.most * bound
                for past in range(t + 1):
                    at = len(nodes) + past
                    rest[at] = rest.get(at, Disc(0)) - d * Disc(u[t - past] / self.rho**past)
                missed = [m + d * Disc(p) for m, p in zip(missed, answers, strict=True)]
                continue
            own = k % self.N
            centre += d * (self.y[own] if k < self.N else self.y[own].conj)
            radius += d.most * (self.bound[own] + self.beyond(P[k]))
            rest[k] = rest.get(k, Disc(0)) - d
            missed = [m + d * p for m, p in zip(missed, P[k], strict=True)]
        cost = Fraction(0)
        for one in evidence["factors"]:
            f, g = (_added(one[name]) for name in "fg")
            cost += self.norm({k: a.conj for k, a in f.items()}, nodes, Disc(0)) * self.norm(
                {k: a.conj for k, a in g.items()}, nodes, Disc(0)
            )
            if max([*f, *g], default=0) >= len(nodes) + self.powers:
                raise Refused("an index out of range")
            for k, a in f.items():
                # <phi g, zeta^s> is the sum of g_m phi_(s - m).
                parts = [(k, k)] if k < len(nodes) else [(len(nodes) + m, k - m) for m in range(k - len(nodes) + 1)]
                for of, at in parts:
                    value = Disc(0)
                    for m, b in g.items():
                        value += b * self.seen(of, m, nodes)
                    rest[at] = rest.get(at, Disc(0)) - a.conj * value
        base = Disc(*(number(one) for one in evidence["base"]))
        radius += self.K * (cost + self.norm(rest, nodes, base))
        if self.M and not self.within:
            raise Refused("nothing is said of the parameters")
        parametric = Fraction(0)
        for m, q, u in zip(missed, self.about, self.within, strict=True):
            centre -= m * q
            parametric += m.most * u
        return centre, radius + parametric, parametric

    def parameters(self) -> None:
        """The discs of the parameters."""
        said = self.evidence["parameters"]
        if self.M and not any(said.values()):
            return
        own, sizes = [number(one) for one in said["radius"]], list[Fraction]()
        if not len(own) == len(said["centre"]) == len(said["combinations"]) == self.fixed + len(self.modes):
            raise Refused("not a disc for every parameter")
        about = [Disc(number(one)) for one in said["centre"][: self.fixed]]
        places = list(range(self.fixed))
        for mode, (a, b), u in zip(self.modes, said["centre"][self.fixed :], own[self.fixed :], strict=True):
            places.append(len(about))
            q, rest = Disc(number(a), number(b)), 2 * len(mode.poles) - 2
            mode.amplitude = q.most + u
            about += [q, q.conj] + [Disc(0)] * rest
            sizes += [u, u] + [mode.amplitude * size for size in mode.sizes for _ in range(2)]
        self.about, self.within = about, own[: self.fixed] + sizes
        for number_, evidence in enumerate(said["combinations"]):
            i = places[number_]
            centre, radius, parametric = self.sums(evidence, {}, wanted=i)
            away = centre - self.about[i]
            apart = abs(away.re) + away.error if number_ < self.fixed else away.most
            if not (self.within[i] > 0 and apart + radius <= self.within[i] and parametric < self.within[i]):
                raise Refused("a parameter")

    def beyond(self, values: list[Disc]) -> Fraction:
        """What the modes have beyond their terms, at a node with these values."""
        total, place = Fraction(0), self.fixed
        for mode in self.modes:
            total += mode.rest * mode.amplitude * (values[place].most + values[place + 1].most)
            place += 2 * len(mode.poles)
        return rounded_up(total)

    def disc(self, said: Any, evidence: Any) -> bool:
        centre, radius, _ = self.sums(evidence, {2 * self.N: Disc(1)}, self.place(said["omega"]))
        return (centre - Disc(*map(number, said["centre"]))).most + radius <= number(said["radius"])

    def support(self, said: Any, evidence: Any) -> bool:
        half = Disc(*(number(one) / 2 for one in said["direction"]))
        centre, radius, _ = self.sums(
            evidence, {2 * self.N: half, 2 * self.N + 1: half.conj}, self.place(said["omega"])
        )
        return centre.re + centre.error + radius <= number(said["value"])

    def inconsistent(self, said: Any, evidence: Any) -> bool:
        centre, radius, _ = self.sums(evidence, {})
        return radius < centre.size - centre.error - Fraction(2, GRID)

    def arcs(self, said: Any, evidence: Any) -> bool:
        return on_arcs(self, said, evidence, loop=False)

    def loop(self, said: Any, evidence: Any) -> bool:
        return on_arcs(self, said, evidence, loop=True)

    def consistent(self, said: Any, evidence: Any) -> bool:
        if set(evidence) != {"reflections", "parameters"} or set(said) != {"kind"} or self.modes:
            raise Refused("other keys")
        gains, p = (
            [Disc(number(one)) for one in evidence["reflections"]],
            [number(one) for one in evidence["parameters"]],
        )
        if any(abs(number(one)) >= 1 for one in evidence["reflections"]):
            return False
        for zeta, values, y, bound in zip(self.nodes, self.P, self.y, self.bound, strict=False):
            w = Disc(0)
            for g in reversed(gains):
                w = (g + zeta * w) * (Disc(1) + g * zeta * w).inverse
            rest = y - Disc(self.K) * w
            for q, one in zip(p, values, strict=True):
                rest -= Disc(q) * one
            if rest.most > bound:
                return False
        series = [Disc(0)] * max((t + 1 for _, t, *_ in self.records), default=0)
        for g in reversed(gains if self.records else []):
            shifted = [Disc(0), *series[:-1]]
            series = []
            for k, one in enumerate(shifted):  # (g + shifted)/(1 + g shifted)
                own = one + (g if k == 0 else Disc(0))
                for m in range(1, k + 1):
                    own -= g * shifted[m] * series[k - m]
                series.append(own)
        for u, t, y, bound, answers in self.records:
            rest = Disc(y)
            for past in range(t + 1):
                rest -= series[past] * Disc(self.K * u[t - past] / self.rho**past)
            for q, one in zip(p, answers, strict=True):
                rest -= Disc(q * one)
            if rest.most > bound:
                return False
        return True

    def proved(self) -> bool:
        """Say whether all statements are proved."""
        self.parameters()
        kinds: dict[str, Callable[[Any, Any], bool]] = {
            name: getattr(self, name) for name in ("disc", "support", "inconsistent", "consistent", "arcs", "loop")
        }
        pairs = list(zip(self.question["statements"], self.evidence["statements"], strict=True))
        return bool(pairs) and all(kinds[said["kind"]](said, evidence) for said, evidence in pairs)


def _inner(row: list[Any], state: list[Fraction]) -> Fraction:
    return sum((number(a) * x for a, x in zip(row, state, strict=True)), Fraction(0))


def _added(rows: list[Any]) -> dict[int, Disc]:
    found: dict[int, Disc] = {}
    for k, a, b in rows:
        found[k] = found.get(k, Disc(0)) + Disc(number(a), number(b))
    return found


def _power(base: Disc, exponent: int) -> Disc:
    found = Disc(1)
    for _ in range(exponent):
        found = found * base
    return found


@functools.lru_cache(256)
def judged(text: str) -> bool:
    """Whether a file is a proof, in exact fractions."""
    try:
        return Judge(text).proved()
    except (Refused, ValueError, KeyError, TypeError, IndexError, AttributeError):
        return False
