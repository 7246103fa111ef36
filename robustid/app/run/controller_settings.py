"""The section of a run file about a controller that is designed, with its constant matrices; `control` has the same words."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from robustid.app.run.checks import Described, key, number, several, text
from robustid.app.run.structure_text import goal_of, goal_text, structure_around, structure_of, structure_text
from robustid.errors import InputError, InputTypeError

if TYPE_CHECKING:
    from robustid.controllers import Attenuation, Factor, Limits, Matrix
    from robustid.core import Real

Rows = tuple[tuple[float, ...], ...]


def matrix_text(name: str, content: str) -> object:
    """Rows from 1,0;0,1 on the command line; what holds other than numbers is the name of a file."""
    del name
    try:
        return [[float(part) for part in row.split(",")] for row in content.split(";")]
    except ValueError:
        return content


def matrix_or_file(name: str, value: object) -> Rows | str:
    """Check of a key: rows of numbers of one length, or the name of a file."""
    if isinstance(value, str):
        return value
    rows = several(several(number()))(name, value)
    if not rows or not rows[0] or len({len(row) for row in rows}) > 1:
        raise InputError(
            f"{name} must be rows of numbers, all of one length, or a file; got rows of {[*map(len, rows)]}"
        )
    return rows


def matrix_of(name: str, value: Rows | str, folder: Path) -> Real:
    """The matrix; files are seen from a folder: text, or the only array of an .npz, .npy or .mat."""
    import numpy as np

    if not isinstance(value, str):
        return np.array(value, dtype=float)
    path = folder / value
    if not path.is_file():
        raise InputError(f"{name} {value}: there is no such file, and rows of numbers are written 1,0;0,1")
    from robustid.formats import read_table

    table = read_table(path)
    arrays = [table.numbers(one) for one in table.columns]
    if table.text:
        arrays = [np.stack(arrays, axis=1)]
    if len(arrays) != 1 or arrays[0].ndim != 2 or np.iscomplexobj(arrays[0]) or not np.all(np.isfinite(arrays[0])):
        shapes = ", ".join(str(one.shape) for one in arrays)
        raise InputError(f"{name} {value}: one real matrix of finite numbers is needed; got arrays of shape {shapes}")
    return arrays[0].astype(float)


_HZ = 2 * math.pi
_ROW = "LOW:HIGH:VALUE,..."
# Names of the library's limits, by those of the keys.
_NAMES = {
    "peak": "sensitivity_peak",
    "complementary_peak": "complementary_peak",
    "control_peak": "control_peak",
    "process_peak": "process_peak",
    "gain_margin": "gain_margin",
    "phase_margin_deg": "phase_margin",
    "delay_margin": "delay_margin",
    "attenuate": "attenuation",
    "tracking": "tracking",
    "roll_off": "roll_off",
    "disturbance": "disturbance",
    "action": "action",
    "bandwidth_hz": "bandwidth",
    "integral_gain": "integral_gain",
}
Row = tuple[float, float, float]


def _rows(name: str, content: str) -> list[list[float]]:
    """Rows of a template from LOW:HIGH:VALUE,LOW:HIGH:VALUE,..."""
    try:
        found = [[float(part) for part in row.split(":")] for row in content.split(",")]
    except ValueError:
        found = []
    if not found or any(len(row) != 3 for row in found):
        raise InputError(f"{name} must be LOW:HIGH:VALUE, frequencies in Hz, such as 1:20:0.1; got {content!r}")
    return found


def _files(name: str, content: str) -> list[str]:
    del name
    return [one.strip() for one in content.split(",")]


def _over_frequency(flag: str, what: str) -> Described:
    """Description of rows over frequency."""
    words = f"Ranges in Hz in which {what}: rows of low, high and value."
    return {"help": words, "flag": flag, "text": _rows, "metavar": _ROW}


_template = several(several(number(least=0.0), 3))
_positive = number(above=0.0)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ControllerChoice:
    """A controller that is designed for every plant that the data allow, and proved."""

    structure: str | None = key(
        structure_text,
        help="What the drive runs, as factors with their poles in Hz; numerators are free, LOW..HIGH is searched: P, PI, PD(80),"
        " PID(80), Notch(300..400, damping=0.5), LeadLag(20), LowPass(900, order=2), FIR(3), with commas between them. Of several"
        " outputs one such loop to each; other loops are Diagonal(PI, PID(80) * Notch(30)), any are rows of entries, each row from"
        " all outputs to one input: Matrix(PI, 0; P, PI).",
        flag="--structure",
        metavar="FACTORS",
        text=lambda _, content: content,
    )
    actuators: tuple[tuple[float, ...], ...] | str | None = key(
        matrix_or_file,
        help="Constant matrix from the loops to the inputs of the plant, where these are no axes: the controller is actuators x"
        " structure x sensors. Rows, or a file that holds it.",
        flag="--actuators",
        text=matrix_text,
        metavar="1,0;0,1|FILE",
    )
    sensors: tuple[tuple[float, ...], ...] | str | None = key(
        matrix_or_file,
        help="Constant matrix from the outputs of the plant to the loops.",
        flag="--sensors",
        text=matrix_text,
        metavar="1,0;0,1|FILE",
    )
    fixed: tuple[str, ...] | None = key(
        several(text()),
        help="Files with models that stand in the loop beside it: a filter, a delay of the computer.",
        flag="--fixed",
        text=_files,
        metavar="FILE,...",
    )
    maximise: str | None = key(
        goal_text,
        help="What is to be as large as it can be: bandwidth (default), integral-gain, least-control (the least peak of C S) or"
        " attenuation:LOW:HIGH, in Hz.",
        flag="--maximise",
        text=lambda _, content: content,
        metavar="GOAL",
    )
    peak: float | None = key(
        number(above=1.0), help="Largest |S|, S = 1/(1 + P C), with any consistent plant. Default: 2.", flag="--peak"
    )
    complementary_peak: float | None = key(
        number(above=1.0), help="Largest |T|, T = 1 - S.", flag="--complementary-peak"
    )
    gain_margin: float | None = key(
        number(above=1.0), help="Factor by which the gain may grow.", flag="--gain-margin", metavar="FACTOR"
    )
    phase_margin_deg: float | None = key(
        _positive, help="Phase margin, on both sides.", unit="degrees", flag="--phase-margin", metavar="DEGREES"
    )
    delay_margin: float | None = key(
        _positive, help="Further delay that leaves every loop stable.", unit="s", flag="--delay-margin"
    )
    control_peak: float | None = key(
        _positive, help="Largest |C S|, from noise at the output to the input of the plant.", flag="--control-peak"
    )
    process_peak: float | None = key(
        _positive, help="Largest |P S|, from a disturbance at the input to the output.", flag="--process-peak"
    )
    attenuate: tuple[Row, ...] | None = key(
        _template,
        **_over_frequency("--attenuate", "|S| is at most a value (the error of tracking, a disturbance at the output)"),
    )
    tracking: tuple[Row, ...] | None = key(
        _template, **_over_frequency("--tracking", "|T| is at least a value below 1")
    )
    roll_off: tuple[Row, ...] | None = key(_template, **_over_frequency("--roll-off", "|T| is at most a value"))
    disturbance: tuple[Row, ...] | None = key(
        _template, **_over_frequency("--disturbance", "|P S| is at most a value (a disturbance at the input)")
    )
    action: tuple[Row, ...] | None = key(
        _template, **_over_frequency("--action", "|C S| is at most a value (noise that reaches the input)")
    )
    bandwidth_hz: float | None = key(
        _positive, help="Frequency up to which |P C| is at least 1.", unit="Hz", flag="--bandwidth"
    )
    integral_gain: float | None = key(_positive, help="Least gain of the integrator.", flag="--integral-gain")
    time_limit: float | None = key(
        _positive,
        help="Seconds after which the best controller so far is taken. Default: its share of the time of the run.",
        unit="s",
    )

    @property
    def is_stated(self) -> bool:
        """Return whether a controller is asked for."""
        return self.structure is not None

    @property
    def files(self) -> list[str]:
        """Files that are read: models beside the structure, and matrices around it."""
        return [*(self.fixed or ()), *(one for one in (self.actuators, self.sensors) if isinstance(one, str))]

    def renamed(self, name: Callable[[str], str]) -> ControllerChoice:
        """The same with other names of its files."""
        fixed = None if self.fixed is None else tuple(map(name, self.fixed))
        ends = {one: name(value) for one in ("actuators", "sensors") if isinstance(value := getattr(self, one), str)}
        return dataclasses.replace(self, fixed=fixed, **ends)

    def read(self, called: Callable[[str], str], folder: Path = Path()) -> tuple[Factor, ...] | Matrix:
        """The structure, with the models beside each loop and the matrices around them from their files, seen from a folder."""
        from robustid.app.load_save import load
        from robustid.controllers import Fixed

        beside: list[Fixed] = []
        for name in self.fixed or ():
            if not (folder / name).is_file():
                raise InputError(f"{called('fixed')} {name}: there is no such file")
            beside.append(Fixed(load(folder / name, kind="model")))
        around = {
            one: matrix_of(called(one), value, folder)
            for one in ("actuators", "sensors")
            if (value := getattr(self, one)) is not None
        }
        try:
            return structure_around(structure_of(called("structure"), self.structure or ""), beside, around)
        except InputError as error:
            raise error.reworded(self.words(called)) from None

    @property
    def goal(self) -> str | Attenuation:
        """The goal, as the library takes it."""
        return goal_of("maximise", self.maximise or "bandwidth")

    @property
    def limits(self) -> Limits:
        """The limits, in the library's units."""
        from robustid.controllers import Limits

        def rows(value: tuple[Row, ...] | None) -> tuple[Row, ...]:
            return tuple((_HZ * low, _HZ * high, most) for low, high, most in value or ())

        return Limits(
            sensitivity_peak=2.0 if self.peak is None else self.peak,
            complementary_peak=self.complementary_peak,
            gain_margin=self.gain_margin,
            phase_margin=None if self.phase_margin_deg is None else math.radians(self.phase_margin_deg),
            delay_margin=self.delay_margin,
            control_peak=self.control_peak,
            process_peak=self.process_peak,
            attenuation=rows(self.attenuate),
            tracking=rows(self.tracking),
            roll_off=rows(self.roll_off),
            disturbance=rows(self.disturbance),
            action=rows(self.action),
            bandwidth=None if self.bandwidth_hz is None else _HZ * self.bandwidth_hz,
            integral_gain=self.integral_gain,
        )

    @staticmethod
    def words(called: Callable[[str], str]) -> dict[str, str]:
        """The library's names of what is stated, as it is called here; `called`: the name of a key."""
        same = ("structure", "actuators", "sensors", "maximise")
        found = {name: called(one) for one, name in (*_NAMES.items(), *zip(same, same, strict=True))}
        return found | {"filter": called("structure")}

    def check(self, place: str) -> None:
        """Refuse limits without a structure, and limits that make no sense."""
        if not self.is_stated:
            if self != ControllerChoice():
                raise InputError(f'{place} needs a structure, such as structure = "PID(80)"')
            return
        try:
            _ = self.limits
        except (InputError, InputTypeError) as error:
            raise error.reworded(self.words(lambda one: f"{place} {one}")) from None
