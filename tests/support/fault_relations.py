"""Faults of the catalogue in one record against the others, or in one part of it against the rest."""

import control
import numpy as np

from support.fault_catalogue import changed, fault, first
from support.fault_plants import recipes, record

# --- records against each other -------------------------------------------------------------------------------------------------


@fault("another plant", "periodic random", "other plant", (1.15, 1.01, 1.0 + 1e-5))
def _other_plant(clean, given, size, rng):
    """The last record is of a machine whose time goes so many times faster."""
    if clean.plant is None or len(given) < 2:
        return None
    recipe, kind = recipes()[clean.name], "periodic" if given is clean.periodic else "random"
    return [*given[:-1], record(recipe, rng, kind=kind, plant=recipe.faster(size))]


@fault("varying plant", "periodic random", "varying, other plant", (1.1, 1.01, 1.0 + 1e-5))
def _varying(clean, given, size, rng):
    """Half-way through every record the machine becomes faster (it warms up)."""
    if clean.plant is None:
        return None
    other, found = recipes()[clean.name].faster(size), []
    for one in given:
        half = len(one.u) // 2
        settled = control.forced_response(
            clean.plant, inputs=np.concatenate([one.u, one.u[: half + 1]]).T, return_x=True
        )
        late = control.forced_response(
            other, inputs=one.u[half:].T, initial_state=settled.states[:, -1], return_x=False
        )
        y = np.atleast_2d(late.outputs).T
        y = y + clean.noise * rng.standard_normal(y.shape)
        found.append(changed(one, y=np.concatenate([one.y[:half], y])))
    return found


@fault("one record with the sign turned", "periodic random", "sign, other plant", (-1.0, None, None), ("negate",))
def _one_negative(clean, given, size, rng):
    return first(given, lambda r: changed(r, y=-r.y)) if len(given) > 1 else None


@fault("one record in another unit", "periodic random", "unit, other plant", (1000.0, 1.1, 1.0001), ("times",))
def _one_unit(clean, given, size, rng):
    return first(given, lambda r: changed(r, y=size * r.y)) if len(given) > 1 else None


@fault("one record noisier", "periodic", "disturbed", (20.0, 2.5, 1.0))
def _noisier(clean, given, size, rng):
    if len(given) < 2:
        return None
    return first(given, lambda r: changed(r, y=r.y + size * clean.noise * rng.standard_normal(r.y.shape)))
