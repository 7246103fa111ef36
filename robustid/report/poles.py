"""Poles in words, numbers and charts; those of an identification, and the modes of a MIMO parametric part with their residues."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from robustid.bases import ParametricBasis
from robustid.errors import InputError
from robustid.fitting import continuous
from robustid.identification import Identification, check_model
from robustid.report.charts import DATA, FAINT, NOMINAL, Axis, Chart, Layer, Panel
from robustid.report.document import Beside, Block, Column, Drawing, Heading, Table, Text
from robustid.report.identified import Models, band, shown_models, siso, transfer, unit
from robustid.report.words import HZ, in_hz, number

if TYPE_CHECKING:
    import control

    from robustid.reduction import Reduction

# The rounded pole of a (double) integrator lies this close to z = 1.
_INTEGRATOR = 1e-7
_TINY = 1e-10  # of a damping: rounding
_LIGHT = 0.05  # damping, below which a pole stands out
_SAME = 1e-5  # relative distance of a pole of the model from the one that was asked for
_MOST = 10  # poles or modes at the terminal
_RANKS = (
    "A mode adds R/(z − a) and its conjugate to the response, R its residue matrix. Peak: σmax(R)/(1 − |a|), about its largest"
    " size. Rank ratio: the second singular value of R over the first; near 0 where the mode has one shape, as that of a"
    " structure has, larger where two modes share the poles, or where the data leave it open."
)


@dataclasses.dataclass(frozen=True)
class PoleRow:
    """A real pole or a conjugate pair.

    Attributes
    ----------
    pole : complex
        In the plane of the model (z, or s where it is continuous); of a pair the one above the real axis.
    count : int
        1, or 2 for a pair.
    hz : float
        Natural frequency |s|/2π in Hz, s = log(z)/dt; 0 for an integrator, nan for a pole at z = 0.
    damping : float
        -Re(s)/|s|; nan for an integrator.
    modulus : float
        |z|; nan for a continuous model.
    time_constant : float
        -1/Re(s) in s: inf on the stability boundary, negative beyond it.
    """

    pole: complex
    count: int
    hz: float
    damping: float
    modulus: float
    time_constant: float


def pole_table(model: control.StateSpace) -> list[PoleRow]:
    """Return the poles of a model with their natural frequency, damping and time constant, by frequency.

    ``s = log(z)/dt``, ``hz = |s|/2π``, ``damping = -Re(s)/|s|``.

    Parameters
    ----------
    model : control.StateSpace
        Discrete with its sample time, or continuous.

    Returns
    -------
    list of PoleRow

    Raises
    ------
    InputError, InputTypeError
        If `model` isn't a finite StateSpace, or is discrete without a sample time.

    Examples
    --------
    >>> import control, robustid as rid
    >>> experiment = rid.datasets.flexible_structure()
    >>> [(round(row.hz, 2), round(row.damping, 4)) for row in pole_table(experiment.truth)]
    [(9.0, 0.1), (17.67, 0.004)]
    """
    system = check_model("model", model)
    if system.dt is True:
        raise InputError("`model` is discrete without a sample time; give it its dt in s")
    return pole_rows(system.poles(), system.dt or 0)


def pole_rows(poles: np.ndarray, dt: float) -> list[PoleRow]:
    """Return the rows of `pole_table`, from the poles."""
    upper = sorted((complex(p) for p in np.atleast_1d(poles) if p.imag >= 0), key=lambda p: (p.imag, p.real))
    rows = [_pole_row(pole, dt) for pole in upper]
    return sorted(rows, key=lambda row: (np.isnan(row.hz), row.hz))


def _pole_row(pole: complex, dt: float) -> PoleRow:
    count, modulus = 1 + (pole.imag > 0), abs(pole) if dt else np.nan
    if dt and pole == 0:
        return PoleRow(pole, count, np.nan, 1.0, 0.0, 0.0)
    if dt and abs(pole - 1) <= _INTEGRATOR:
        return PoleRow(pole, count, 0.0, np.nan, modulus, np.inf)
    s = continuous(pole, dt)
    damping = -s.real / abs(s) if s else np.nan
    return PoleRow(pole, count, abs(s) / HZ, damping, modulus, -1 / s.real if s.real else np.inf)


def describe_pole(row: PoleRow) -> str:
    """One pole in words."""
    if row.modulus == 0:
        return "delay of one sample"
    if row.hz == 0:
        return "integrator"
    if row.count == 1:
        return f"time constant {number(row.time_constant)} s"
    return f"{in_hz(row.hz, 4)} with damping {number(row.damping, 3)}"


def delay_words(basis: ParametricBasis) -> str:
    """The delays of the functions: zeros at the beginning of their impulse responses."""
    state, pulses = basis.B, [basis.D[:, 0]]
    for _ in range(basis.states):
        pulses.append((basis.C @ state)[:, 0])
        state = basis.A @ state
    delays = np.argmax(np.array(pulses) != 0, axis=0)
    low, high = int(delays.min()), int(delays.max())
    if not np.any(basis.poles):
        return f"none but delays, {low} to {high} samples"
    # Of a pair, one function is zero one sample longer.
    return f"delay, {low} sample{'s' * (low != 1)}"


def poles_section(identification: Identification, models: Models) -> list[Block]:
    """Build the section of the poles of every model, and of the modes of a MIMO parametric part."""
    nominal, *others = shown_models(identification, models)
    own, rest = _told_apart(identification)
    tables: list[tuple[Block, ...]] = [(Heading(nominal.name, 3), _table(own), *_counted(rest))]
    tables += [(Heading(one.name, 3), _table(pole_table(one.model))) for one in others]
    blocks: list[Block] = [
        Heading("Poles"),
        Drawing(pole_chart(identification, models), beside=True),
        Beside(tables),
        Text(
            "f is the natural frequency |s|/2π with s = log(z)/dt, τ the time constant −1/Re s; bold: damping below 0.05.",
            "soft",
        ),
    ]
    modes = modes_table(identification)
    return [*blocks, Heading("Modes"), modes, Text(_RANKS, "soft")] if modes.rows else blocks


def _told_apart(identification: Identification) -> tuple[list[PoleRow], list[PoleRow]]:
    """Poles of the nominal model: those outside the region of the non-parametric part, or of the parametric part; and the others.

    Without a parametric part the slowest are told apart.
    """
    rows, problem = pole_table(identification.model), identification.problem
    if problem.parametric is None or problem.prior.physical:
        slow = sorted(rows, key=lambda row: -row.time_constant if row.time_constant > 0 else -np.inf)
        return sorted(slow[:_MOST], key=lambda row: row.hz), slow[_MOST:]
    known = pole_rows(problem.parametric.in_s().poles, problem.dt)
    own = [row for row in rows if any(abs(row.pole - one.pole) <= _SAME * max(abs(one.pole), 1e-3) for one in known)]
    return own, [row for row in rows if row not in own]


def _counted(rows: list[PoleRow]) -> list[Text]:
    """Say how many poles are left out, and how slow they are."""
    if not rows:
        return []
    slowest = max(row.time_constant for row in rows)
    states = sum(row.count for row in rows)
    words = f"{states} further states are left out here: none has a time constant above {number(slowest, 3)} s."
    return [Text(words, "soft")]


def slowest_poles(identification: Identification, reduction: Reduction | None) -> Table:
    """Table of the slowest poles of the reduced model, or of the nominal one."""
    model, name = (identification.model, "nominal") if reduction is None else (reduction.model, "reduced")
    rows = sorted(pole_table(model), key=lambda row: -row.modulus)
    kept, left = sorted(rows[:_MOST], key=lambda row: row.hz), rows[_MOST:]  # those left out only count
    return _table([*kept, *left], f"Slowest poles of the {name} model")


def _table(rows: list[PoleRow], title: str = "") -> Table:
    columns = [
        Column("f [Hz]", "n", "Hz"),
        Column("damping", "n", "Damping"),
        Column("|z|", "n"),
        Column("τ [s]", "n", "Time constant [s]"),
        Column("states", "n", "States"),
    ]
    light = [row.count == 2 and row.damping < _LIGHT for row in rows]
    cells = [pole_cells(row) for row in rows]
    return Table(columns, cells, strong=light, empty="no poles: a static gain", title=title, most=_MOST)


def pole_cells(row: PoleRow) -> tuple[str, ...]:
    """Cells on a pole: frequency, damping, modulus, time constant, number of states."""
    if row.modulus == 0:
        return "delay", "–", "0", "–", str(row.count)
    damping, constant = (0.0, np.inf) if abs(row.damping) < _TINY else (row.damping, row.time_constant)
    numbers = number(row.hz, 5), number(damping, 3), number(row.modulus, 5), number(constant, 3)
    return *numbers, str(row.count)


def modes_table(identification: Identification) -> Table:
    """Table of the modes of the parametric part and their residue matrices; empty for a SISO problem, whose coefficients say
    it all.
    """
    problem, rows = identification.problem, list[tuple[str, ...]]()
    for mode in () if siso(identification) else identification.modes:
        size = np.abs(mode.residue)
        i, j = np.unravel_index(int(np.argmax(size)), size.shape)
        with np.errstate(divide="ignore"):  # an integrator
            decay = mode.omega * mode.damping
            peak = np.linalg.norm(mode.residue, 2) / (-np.expm1(-decay * problem.dt) if problem.dt else decay)
        ratio = number(mode.rank_ratio, 2) if min(size.shape) > 1 else "–"
        hz, damping = number(mode.omega / HZ, 5), number(mode.damping, 3)
        rows.append((hz, damping, number(float(peak), 3), transfer(identification, int(i), int(j)), ratio))
    what = unit(identification)
    columns = [
        Column("f [Hz]", "n", "Hz"),
        Column("damping", "n", "Damping"),
        Column(f"peak [{what}]" if what else "peak", "n", f"Peak\n[{what}]" if what else "Peak"),
        Column("largest in", "text", "Largest in"),
        Column("rank ratio", "n", "Rank\nratio"),
    ]
    note = "Rank ratio: near 0 where the mode has one shape"
    return Table(columns, rows, title="Modes of the parametric part", note=note, most=_MOST)


def _edges(identification: Identification) -> Iterator[Layer]:
    """The stability boundary, and that of the class."""
    prior = identification.prior
    if not identification.problem.dt:
        height = np.array([-1.0, 1.0]) * 1.1 * max(np.abs(identification.model.poles()).max(initial=0.0), prior.decay)
        yield Layer("imaginary axis: Re s = 0", np.zeros(2), height, DATA, dash="solid")
        name = f"Re s = −α = −{number(prior.decay)} 1/s"
        yield Layer(name, np.full(2, -prior.decay), height, FAINT, dash="dash")
        return
    turn, rho = np.linspace(0, 2 * np.pi, 361), prior.decay_rate
    circles = (("unit circle: |z| = 1", 1.0, DATA, "solid"), (f"|z| = 1/ρ = {number(1 / rho)}", 1 / rho, FAINT, "dash"))
    for name, radius, colour, dash in circles:
        yield Layer(name, radius * np.cos(turn), radius * np.sin(turn), colour, dash=dash)


def pole_chart(identification: Identification, models: Models = None) -> Chart:
    """Poles in the z-plane or s-plane, and their damping over their frequency."""
    shown, discrete = shown_models(identification, models), bool(identification.problem.dt)
    plane = list(_edges(identification))
    damping: list[Layer] = []
    reach = max(float(np.abs(layer.x).max()) for layer in plane)
    for one in shown:
        rows, poles = pole_table(one.model) if one.model.nstates else [], one.model.poles()
        marker = "x" if one.colour == NOMINAL else one.marker
        dots = partial(Layer, one.name, colour=one.colour, marker=marker, size=1.3)
        words = {row.pole: _pole_words(row) for row in rows}
        words |= {pole.conjugate(): text for pole, text in words.items()}
        hover = tuple(words.get(complex(p), "") for p in poles)
        reach = max(reach, float(np.abs(poles).max(initial=0.0)))
        plane.append(dots(poles.real, poles.imag, hover=hover))
        swings = [row for row in rows if row.count == 2 and row.damping > 0]
        x, y = (np.array([getattr(row, part) for row in swings]) for part in ("hz", "damping"))
        damping.append(dots(x, y, hover=tuple(_pole_words(row) for row in swings)))
    span, letter = (-1.1 * reach, 1.1 * reach), "z [–]" if discrete else "s [rad/s]"
    every = np.concatenate([layer.x for layer in damping] + [np.array(band(identification.problem)) / HZ])
    ratios = np.concatenate([layer.y for layer in damping])
    panels = (
        Panel(
            f"Poles in the {letter[0]}-plane",
            Axis(f"real part of {letter}", range=span if discrete else None),
            Axis(f"imaginary part of {letter}", range=span),
            plane,
            square=discrete,
        ),
        Panel(
            "Damping of the oscillating poles",
            Axis(
                "natural frequency [Hz]",
                log=every.max() > 2 * every.min(),
                range=(0.9 * every.min(), 1.1 * every.max()),
            ),
            Axis("damping ratio [–]", log=True, range=(min(0.5 * ratios.min(initial=1.0), 0.05), 2.0)),
            damping,
        ),
    )
    return Chart("poles", panels, columns=2)


def _pole_words(row: PoleRow) -> str:
    if row.modulus == 0:
        return "delay of one sample, |z| = 0"
    text = f"|z| = {number(row.modulus, 5)}"
    if row.hz == 0:
        return f"integrator, {text}"
    return f"{in_hz(row.hz, 4)}, damping {number(row.damping, 3)}, {text}"
