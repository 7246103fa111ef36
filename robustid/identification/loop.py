r"""Loop(): the controller that runs while a plant is measured, and the stable system that is seen in open loop then.

With u = r - C y, the factors M of the loop of C and an auxiliary plant, and

.. math:: \begin{bmatrix} x \\ z \end{bmatrix} = M^{-1} \begin{bmatrix} u \\ y \end{bmatrix}, \qquad
          z = R x + (\tilde D_x - R \tilde N_c) v, \qquad x = \tilde D_c r,

v the noise at the output: x knows nothing of it, and R is stable for every plant that C stabilises (`tay1989`).
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from robustid.core import (
    Complex,
    Frozen,
    Real,
    StateMatrices,
    closed_loop,
    counted,
    decay_of,
    exchanged,
    inverse,
    left_quotient,
    loop_factors,
    loop_is_stable,
    points_of,
    poles_of,
    response_at,
    right_quotient,
    series,
)
from robustid.data import Fault, FrequencyResponse, TimeRecord
from robustid.errors import InputError, InputTypeError, Remedy
from robustid.identification.loop_faults import loop_faults
from robustid.identification.loop_terms import LAWS, OPENED, answer, controller_output, opened_by
from robustid.identification.validation import as_system, describe_poles

if TYPE_CHECKING:
    import control

_SAME_TIME = 1e-9  # relative


@dataclasses.dataclass(frozen=True, eq=False)
class Loop(Frozen):
    r"""Controller that runs while a plant is measured, with negative feedback: ``u = r - C y``.

    Every plant that C stabilises, stable or not, is

    .. math:: P(R) = (N_x + D_c R)(D_x - N_c R)^{-1}, \quad R \text{ stable},

    where :math:`P_x = N_x D_x^{-1}` is an auxiliary plant that C stabilises and :math:`C = N_c D_c^{-1}`. R is what is identified,
    in open loop, since its input does not depend on the noise. It is small where the auxiliary plant is close to the true one.

    Parameters
    ----------
    controller : control.StateSpace or control.TransferFunction
        C, from the outputs of the plant to its inputs, as it ran, with its sample time in s, or 0 in continuous time.
    auxiliary : control.StateSpace or control.TransferFunction, optional
        P_x; left out, it is 0, which a stable controller stabilises: then R is the response from r to y.
    excitation : {"input", "reference", "output"}
        Where r is added: ``u = r - C y``, ``u = C (r - y)``, or ``u = -C (y + r)``.

    Attributes
    ----------
    poles : (n,) complex array
        Of the loop of C and the auxiliary plant.

    Raises
    ------
    InputError, InputTypeError
        Systems that do not fit together, or whose loop is not stable.

    References
    ----------
    The dual of Youla's parameter: `tay1989`; factors of both, `vidyasagar1985`.

    Examples
    --------
    >>> import control, robustid as rid
    >>> plant = control.ss(1.1, 1.0, 1.0, 0.0, 0.01)  # unstable
    >>> loop = rid.Loop(control.ss([], [], [], 0.5, 0.01), auxiliary=control.ss(1.2, 1.0, 1.0, 0.0, 0.01))
    >>> residual = loop.residual_of(plant)
    >>> bool(abs(residual.poles()).max() < 1)
    True
    >>> again = loop.plant_of(residual)
    >>> bool(abs(again(1j) - plant(1j)) < 1e-12)
    True
    """

    controller: Any
    auxiliary: Any = None
    _: dataclasses.KW_ONLY
    excitation: str = "input"

    def __post_init__(self) -> None:
        controller, dt = as_system("controller", self.controller)
        if self.excitation not in LAWS:
            raise InputError(f"`excitation` must be one of {tuple(LAWS)}; got {self.excitation!r}")
        nu, ny = controller.D.shape
        if self.auxiliary is None:
            auxiliary, other = _nothing(ny, nu), None
        else:
            auxiliary, other = as_system("auxiliary", self.auxiliary)
        if auxiliary.D.shape != (ny, nu):
            got = " x ".join(map(str, auxiliary.D.shape))
            raise InputError(
                f"`auxiliary` must have {counted(ny, 'output')} and {counted(nu, 'input')}, as the controller says; got {got}"
            )
        if dt is not None and other is not None and not np.isclose(float(dt), float(other), rtol=_SAME_TIME, atol=0.0):
            raise InputError(f"`auxiliary` must have the sample time of the controller, {dt:g} s; got {other:g} s")
        time = next((one for one in (dt, other, getattr(self.controller, "dt", None)) if one is not None), None)
        if time is None or time is True:
            raise InputError("`controller` must have its sample time in s, or dt = 0 in continuous time")
        poles = poles_of(closed_loop(auxiliary, controller).A)
        if not loop_is_stable(poles, float(time)):
            self._refuse(controller, poles, float(time))
        factors = loop_factors(auxiliary, controller, float(time))
        self._set(_controller=controller, dt=float(time), poles=poles, factors=factors, back=inverse(factors))

    if TYPE_CHECKING:
        _controller: StateMatrices = dataclasses.field(init=False)
        back: StateMatrices = dataclasses.field(init=False)
        dt: float = dataclasses.field(init=False)
        poles: Complex = dataclasses.field(init=False)
        factors: StateMatrices = dataclasses.field(init=False)

    def _refuse(self, controller: StateMatrices, poles: Complex, dt: float) -> None:
        poles = poles[poles.imag >= 0]
        size: Real = np.abs(poles) if dt else np.real(poles)
        words = describe_poles(poles[np.argsort(-size)][:1], dt)
        if self.auxiliary is None:
            raise InputError(
                f"`auxiliary` is missing: the controller has a {words}, so that it does not stabilise a plant of 0. Give a plant"
                " that it stabilises: a model of the machine, if only a rough one"
            )
        raise InputError(
            f"`controller` must stabilise `auxiliary`; their loop has a {words}. Check the sign: the feedback is negative,"
            " u = r - C y"
        )

    def __repr__(self) -> str:
        nu, ny = self.shape
        time = f"dt={self.dt:.6g} s" if self.dt else "continuous time"
        return f"<Loop: {ny}x{nu} plant, u = {self.law}, {time}>"

    @property
    def auxiliary_is_stable(self) -> bool:
        """True if the auxiliary plant is stable by itself."""
        return self.auxiliary is None or decay_of(poles_of(as_system("auxiliary", self.auxiliary)[0].A), self.dt) > 0

    @property
    def law(self) -> str:
        """Law of the controller, with the place of the excitation r."""
        return LAWS[self.excitation]

    @property
    def shape(self) -> tuple[int, int]:
        """Inputs and outputs of the plant."""
        return self._controller.D.shape[0], self._controller.D.shape[1]

    def residual_of(self, plant: control.StateSpace | control.TransferFunction) -> control.StateSpace:
        """R of a plant: ``Z X^-1`` of ``[X; Z] = M^-1 [I; P]``; stable where the controller stabilises the plant."""
        system, _ = as_system("plant", plant)
        return self._quotient(self._beside(system), self.back)

    def plant_of(self, residual: control.StateSpace | control.TransferFunction) -> control.StateSpace:
        """The plant P(R): ``Y U^-1`` of ``[U; Y] = M [I; R]``; the controller stabilises it if R is stable."""
        system, _ = as_system("residual", residual)
        return self._quotient(self._beside(system), self.factors)

    def parameter_of(self, controller: control.StateSpace | control.TransferFunction) -> control.StateSpace:
        """Q of another controller: with the plant P(R) its loop is stable if that of R and Q is, with negative feedback.

        ``Q = (D_x + C_Q N_x)^-1 (C_Q D_c - N_c)``; 0 of the controller that ran.
        """
        A, B, C, D = self.as_controller(controller)
        nu, _ = self.shape
        given = StateMatrices(A, np.hstack([np.zeros((len(A), nu)), B]), C, np.hstack([np.eye(nu), D]))  # [I, C_Q]
        return left_quotient(series(self.factors, given), nu).model(self.dt)

    def as_controller(self, controller: control.StateSpace | control.TransferFunction) -> StateMatrices:
        """Another controller, checked."""
        system, dt = as_system("controller", controller)
        nu, ny = self.shape
        if system.D.shape != (nu, ny):
            got = " x ".join(map(str, system.D.shape))
            raise InputError(f"`controller` must have {counted(nu, 'output')} and {counted(ny, 'input')}; got {got}")
        if dt is not None:
            self._check_time(float(dt), "controller")
        return system

    def about(self, residual: StateMatrices, controller: StateMatrices | None = None) -> StateMatrices:
        """The loop of P(R + E) from ``[r; e; d]`` to ``[u; y; x]``, with e = E x; r is added at the input, d at the output y.

        Of another controller too. At the one that ran x does not answer to e.
        """
        nu, ny = self.shape
        E, F, G, H = self._controller if controller is None else controller
        one, other = np.eye(nu), np.eye(ny)
        # From [x; e] to [x; R x + e], from there to [u; y], with x beside them, and d: [x; e; d] to [u; y; x].
        direct = np.block([[one, np.zeros((nu, ny))], [residual.D, other]])
        inner = _widened(residual, np.hstack([residual.B, np.zeros(residual.C.T.shape)]), direct, rows=(nu, 0))
        plant = series(inner, self.factors)
        direct = np.block([[plant.D, np.vstack([np.zeros((nu, ny)), other])], [one, np.zeros((nu, 2 * ny))]])
        whole = _widened(plant, np.hstack([plant.B, np.zeros((len(plant.A), ny))]), direct, rows=(0, nu))
        # To u + C y before them, which is what r makes it.
        seen = np.hstack([np.zeros((len(E), nu)), F, np.zeros((len(E), nu))])
        direct = np.vstack([np.hstack([one, H, np.zeros((nu, nu))]), np.eye(2 * nu + ny)])
        after = _widened(StateMatrices(E, F, G, H), seen, direct, rows=(0, 2 * nu + ny))
        found = exchanged(series(whole, after), nu)
        return StateMatrices(found.A, found.B, found.C[nu:], found.D[nu:])

    def opened(self, record: TimeRecord, *, period: int | None = None) -> TimeRecord:
        """Record of R: its input x and output z from the input and output of the plant; no bound, whose noise is another one.

        `fit_records` makes it by itself of a `loop`. One that is not periodic begins at zero initial conditions of the controller,
        or in a free state. With a `period`, in samples, each by itself: no noise goes on into the next, as estimates of scatter
        assume.
        """
        signals = self._signals(record)
        alone = period is not None and 0 < period < len(signals) and len(signals) % period == 0
        parts = np.split(signals, len(signals) // period) if period and alone else [signals]
        periodic = alone or record.initial == "periodic"
        found = np.concatenate([answer(self.back, one, periodic=periodic) for one in parts])
        nu, _ = self.shape
        return dataclasses.replace(
            record, u=found[:, :nu], y=found[:, nu:], bound=None, reference=None, past_input_bound=None
        )

    def residual(self, record: TimeRecord) -> Real:
        """Part of the loop's equation that a record does not keep, (T, nu): ``x - D~_c r``, 0 where this controller ran.

        ``D~_c (u + C y - r)``, which is stable where C is not; r at its place, `excitation`.
        """
        signals, reference = self._signals(record), self._check_reference(record.reference)
        nu, _ = self.shape
        A, B, C, D = self.back
        columns, sign = (
            slice(0, nu) if self.excitation == "input" else slice(nu, None),
            1.0 - 2.0 * (self.excitation == "output"),
        )
        both = StateMatrices(
            A, np.hstack([B, -sign * B[:, columns]]), C[:nu], np.hstack([D[:nu], -sign * D[:nu, columns]])
        )
        return answer(both, np.hstack([signals, reference]), periodic=record.initial == "periodic")

    def faults(self, record: TimeRecord) -> tuple[Fault, ...]:
        """Mistake about the controller, or about the signals of a record, for which the loop's equation does not hold.

        Each is tried, and what leaves the least of the `residual` is told, where it explains most of what follows r, and clearly
        more than chance and the noise that is recorded with the signals. The state in which the controller began is free.
        Several, if they explain the record equally well: one of them is right. Two at once are told of as another controller.

        Returns
        -------
        tuple of Fault
            Empty where this controller ran, to the noise. Kinds: "sign", "late", "controller" (its gain, with `size` times the
            stated one; or nothing that was tried), "unit", "offset", "excitation" (the place of r), "exchanged", "sample time",
            "saturated", "no reference".

        Examples
        --------
        >>> import control, numpy as np, robustid as rid
        >>> r = np.random.default_rng(0).standard_normal(400)
        >>> y = control.forced_response(control.ss(0.5, 0.2, 1.0, 0.0, 0.01), inputs=r).outputs  # of 0.2/(z - 0.9), C = 2
        >>> record = rid.TimeRecord(r - 2 * y, y, dt=0.01, reference=r)
        >>> rid.Loop(control.ss([], [], [], 2.0, 0.01)).faults(record)
        ()
        >>> (fault,) = rid.Loop(control.ss([], [], [], 1.6, 0.01)).faults(record)
        >>> fault.kind == "controller", fault.size
        (True, 1.25)
        """
        self._signals(record)
        if record.reference is not None:
            self._check_reference(record.reference)
        return loop_faults(self._controller, decay_of(self.poles, self.dt) * self.dt, self.excitation, record)

    def with_reference(self, record: TimeRecord) -> TimeRecord:
        """The record with the reference that its signals imply, r = u + C y; nothing tests the controller then.

        The controller begins at zero initial conditions, or in periodic steady state; the mean of r is unknown there if the
        controller integrates, and is 0.

        Raises
        ------
        InputError
            If r is added elsewhere than at the input, or the controller is not stable, so that noise of y would grow without end.

        Examples
        --------
        >>> import control, robustid as rid
        >>> loop = rid.Loop(control.ss([], [], [], 2.0, 0.01))
        >>> loop.with_reference(rid.TimeRecord([1.0, 0.0], [0.0, 0.5], dt=0.01)).reference.ravel()
        array([1., 1.])
        """
        signals = self._signals(record)
        if self.excitation != "input":
            raise InputError(f"`record` needs its reference: r follows from u and y only at the input; got {self.law}")
        u, y = np.split(signals, [self.shape[0]], axis=1)
        return dataclasses.replace(
            record, reference=u + controller_output(self._controller, y, periodic=record.initial == "periodic")
        )

    def opened_response(self, frf: FrequencyResponse, *, of: str = "y") -> FrequencyResponse:
        r"""Response of R from one of the closed loop: T_y from r (at the input) to y, T_u to u, or S from an output error to y.

        ``D_c^-1 (T_y D~_c^-1 - N_x)``, ``N_c^-1 (D_x - T_u D~_c^-1)`` or ``(D~_x - D_c^-1 S) N~_c^-1``, for `of` = "y", "u",
        "sensitivity". A bound b of the entries is one of R, such as ``|D_c^-1| b |D~_c^-1|``. T_u and S tell R where C acts.
        """
        nu, ny = self.shape
        if of not in OPENED:
            raise InputError(f"`of` must be one of {tuple(OPENED)}; got {of!r}")
        wanted = {"y": (ny, nu), "u": (nu, nu), "sensitivity": (ny, ny)}[of]
        if frf.values.shape[1:] != wanted:
            got = " x ".join(map(str, frf.values.shape[1:]))
            raise InputError(f"`frf` must have {wanted[0]} outputs and {wanted[1]} inputs, {OPENED[of]}; got {got}")
        self._check_time(frf.dt or 0.0, "frf")
        points = points_of(frf.omega, self.dt)
        left, own, right = opened_by(response_at(self.factors, points), response_at(self.back, points), nu, of)
        values = left @ (frf.values @ right - own)
        bound = None if frf.bound is None else np.abs(left) @ frf.bound.outer_radius @ np.abs(right)
        return FrequencyResponse(frf.omega, values, bound=bound, dt=frf.dt, note=frf.note)

    def plant_response(self, frf: FrequencyResponse) -> FrequencyResponse:
        r"""Response of the plant from that of R: ``P = (N_x + D_c R)(D_x - N_c R)^-1``.

        Its bound is that of R to first order, ``|D_c + P N_c| b |(D_x - N_c R)^-1|``: for weights, not for a guarantee.
        """
        self._check_time(frf.dt or 0.0, "frf")
        nu, _ = self.shape
        M = response_at(self.factors, points_of(frf.omega, self.dt))
        down = np.linalg.inv(M[:, :nu, :nu] + M[:, :nu, nu:] @ frf.values)
        values = (M[:, nu:, :nu] + M[:, nu:, nu:] @ frf.values) @ down
        slope = M[:, nu:, nu:] - values @ M[:, :nu, nu:]
        bound = None if frf.bound is None else np.abs(slope) @ frf.bound.outer_radius @ np.abs(down)
        return FrequencyResponse(frf.omega, values, bound=bound, dt=frf.dt, note=frf.note)

    def response_of(self, model: control.StateSpace, omega: Real) -> Complex:
        """Response of a model with the time base of the loop at frequencies in rad/s."""
        return response_at(StateMatrices.of(model), points_of(omega, self.dt))

    def _beside(self, system: StateMatrices) -> StateMatrices:
        """``[I; system]``."""
        nu, ny = self.shape
        A, B, C, D = system
        if D.shape != (ny, nu):
            raise InputError(f"a system of {ny} outputs and {nu} inputs is needed; got {D.shape[0]} and {D.shape[1]}")
        return StateMatrices(A, B, np.vstack([np.zeros((nu, len(A))), C]), np.vstack([np.eye(nu), D]))

    def _quotient(self, system: StateMatrices, factors: StateMatrices) -> control.StateSpace:
        return right_quotient(series(system, factors), self.shape[0]).model(self.dt)

    def _signals(self, record: TimeRecord) -> Real:
        if not isinstance(cast("object", record), TimeRecord):
            raise InputTypeError(f"`record` must be a TimeRecord; got {type(record).__name__}")
        nu, ny = self.shape
        if (record.u.shape[1], record.y.shape[1]) != (nu, ny):
            got = f"{record.u.shape[1]} and {record.y.shape[1]}"
            raise InputError(f"`record` must have {nu} inputs and {ny} outputs, as the controller says; got {got}")
        self._check_time(record.dt, "record")
        return np.hstack([record.u, record.y])

    def _check_reference(self, reference: Real | None) -> Real:
        wanted = self.shape[0 if self.excitation == "input" else 1]
        if reference is None or reference.shape[1] != wanted:
            got = "none" if reference is None else f"{reference.shape[1]} signals"
            raise InputError(
                f"`record` must have a `reference` of {wanted} signals, what is added at the {self.excitation}; got {got}"
            )
        return reference

    def _check_time(self, dt: float, name: str) -> None:
        if not np.isclose(dt, self.dt, rtol=_SAME_TIME, atol=0.0):
            if not self.dt:
                raise InputError(
                    f"`{name}` has samples, each {dt:g} s, and the loop is in continuous time: give the controller as it runs, in"
                    " discrete time, as by control.c2d"
                )
            got = f"got {dt:g} s" if dt else "it has none. Give it, as "
            remedy = () if dt else (Remedy({"dt": float(self.dt)}),)
            raise InputError(
                f"`{name}` must have the sample time of the loop, {self.dt:g} s; {got}", *remedy, argument="dt"
            )


def _widened(system: StateMatrices, inputs: Real, direct: Real, *, rows: tuple[int, int]) -> StateMatrices:
    """The states of a system with other inputs and feedthrough, and outputs without states before and after its own."""
    none = [np.zeros((count, len(system.A))) for count in rows]
    return StateMatrices(system.A, inputs, np.vstack([none[0], system.C, none[1]]), direct)


def _nothing(ny: int, nu: int) -> StateMatrices:
    return StateMatrices(np.zeros((0, 0)), np.zeros((0, nu)), np.zeros((ny, 0)), np.zeros((ny, nu)))
