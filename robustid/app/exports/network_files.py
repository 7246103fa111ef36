"""Responses and models in the files of network analysis."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import StateMatrices, as_array, as_positive, as_state_space, hz_words, input_states, model_of
from robustid.data import FrequencyResponse
from robustid.errors import InputError, InputTypeError
from robustid.formats import scattering_model, scattering_of, write_spice, write_touchstone

if TYPE_CHECKING:
    import control

_PARAMETERS = ("s", "z", "y")


def save_network(
    path: str | os.PathLike[str],
    thing: object,
    *,
    parameter: str | None,
    reference: float | None,
    omega: ArrayLike | None,
) -> None:
    """Write Touchstone or a SPICE subcircuit; see `robustid.save`."""
    parameter = "s" if parameter is None else parameter
    if parameter not in _PARAMETERS:
        raise InputError(f'`parameter` must be "s", "z" or "y"; got {parameter!r}')
    resistance = as_positive("reference", 50.0 if reference is None else reference)
    touchstone = Path(path).suffix.lower().endswith("p") and Path(path).suffix.lower() != ".sp"
    if isinstance(thing, FrequencyResponse):
        if not touchstone:
            raise InputError(
                "a SPICE subcircuit is made of a model: fit_mfd(response, ...) and make_passive lead to one"
            )
        if omega is not None:
            raise InputError("`omega` is for models; a response has its own frequencies")
        _check_square(thing.values.shape[1:], thing.dt)
        values = scattering_of(thing.values, parameter, resistance)
        note = thing.note if thing.bound is None else thing.bound.words(thing.note)
        write_touchstone(path, thing.omega, values, resistance, note)
        return
    system = StateMatrices.of(_model(thing))
    if not touchstone:
        if omega is not None:
            raise InputError("`omega` is for Touchstone: a subcircuit holds at all frequencies")
        write_spice(path, _passive(scattering_model(system, parameter, resistance)), resistance, _header(resistance))
        return
    if omega is None:
        raise InputError("`omega` is needed to write a model as Touchstone: the frequencies in rad/s, (F,)")
    frequencies = as_array("omega", omega, ndim=1)
    if not frequencies.size or np.any(frequencies < 0) or np.any(np.diff(frequencies) <= 0):
        raise InputError("`omega` must be frequencies >= 0 in rad/s that increase")
    waves = scattering_model(system, parameter, resistance)
    values = waves.D + waves.C @ input_states(waves.A, waves.B, 1j * frequencies)
    write_touchstone(path, frequencies, values, resistance)


def _model(thing: object) -> control.StateSpace:
    import control

    thing = as_state_space("thing", model_of(thing))
    if not isinstance(thing, control.StateSpace):
        raise InputTypeError(
            f"`thing` must be a FrequencyResponse or a control.StateSpace for this ending; got {type(thing).__name__}"
        )
    model: control.StateSpace = thing
    _check_square(model.D.shape, model.dt if model.nstates else None)
    return model


def _check_square(shape: tuple[int, ...], dt: float | None) -> None:
    if shape[0] != shape[1]:
        raise InputError(f"a network has as many outputs as inputs, one pair a port; got {shape[0]} and {shape[1]}")
    if dt:
        raise InputError(f"a network is one in continuous time; got dt = {dt:g}")


def _passive(waves: StateMatrices) -> StateMatrices:
    """The scattering matrices, if no violation of passivity is found: a subcircuit that isn't passive can make others unstable."""
    import control

    from robustid.passivity import PassivityStatus, prove_passive

    proof = prove_passive(control.StateSpace(*waves, 0))
    if proof.status is PassivityStatus.VIOLATED:
        worst = max(proof.bands, key=lambda band: band.amount)
        raise InputError(
            f"the model isn't passive: the largest singular value of its scattering matrix is {1 + worst.amount:.6g} at"
            f" {hz_words(worst.omega / (2 * np.pi), 6)}. make_passive(model, ...) makes it so"
        )
    return waves


def _header(reference: float) -> str:
    return (
        "Subcircuit of a passive state-space model, written by robustid\n"
        f"Scattering form with {reference:g} ohm inside; it holds for any load"
    )
