"""Unstable plants that were measured in their loops: the bands of R, with polygons where they limit the loop."""

import functools

import control
import numpy as np

import robustid as rid
from robustid.guarantees import limiting_polygons
from support.halvings import arcs_halved

DT = 0.01
PLANT = control.ss([[1.1, 0.3], [0.0, 0.4]], [[0.2], [1.0]], [[1.0, 0.5]], 0.0, DT)


@functools.cache
def growing():
    """The plant 1/(z - 1.1), the loop with the gain 1/2 that it ran in, its R, and the band of R known to 0.01 about it."""
    plant, loop = control.ss(1.1, 1.0, 1.0, 0.0, DT), rid.Loop(control.ss([], [], [], 0.5, DT))
    R, omega = loop.residual_of(plant), np.linspace(5.0, 300.0, 20)
    frf = rid.FrequencyResponse(omega, loop.response_of(R, omega), bound=0.01, dt=DT)
    problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=8.8, decay_rate=1.4))
    return plant, loop, R, rid.band(rid.identify(problem)).with_model(R)


@functools.cache
def measured():
    """The loop, the identification of R, its band about a small model, the polygons, and the band with them.

    With arcs between knots halved twice, not four times, which takes half as long again.
    """
    loop = rid.Loop(control.ss([], [], [], 0.5, DT))
    R, omega = loop.residual_of(PLANT), np.linspace(5.0, 310.0, 16)
    values = np.array([R(np.exp(1j * DT * w)) for w in omega])
    frf = rid.FrequencyResponse(omega, values, bound=0.05 * np.abs(values).max(), dt=DT)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=12.0, decay_rate=1.3)))
    model = rid.balanced_truncation(result.model, order=2).model
    band = rid.band(result, model=model, omega=omega, knots=48)
    found = limiting_polygons(band, loop, result, omega, directions=8, rtol=0.1)
    with arcs_halved(2):
        return loop, result, band, found, band.with_polygons(found)
