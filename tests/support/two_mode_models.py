"""Models of two modes, and a response of a rigid body with a mode."""

import control
import numpy as np

import robustid as rid
from robustid.bases import stack_bases
from support.reduction_models import mode


def two_modes(dt):
    """A mode at 1 Hz with a peak of 10 beside one at 10 Hz with a peak of 50, whose response is 0.5 at 1 Hz."""
    omega = 20 * np.pi
    model = mode(0.05, omega / 10)[0] + control.ss(
        [[0, 1], [-(omega**2), -0.1 * omega]], [[0], [5 * omega]], [[0, 1]], 0
    )
    return control.sample_system(model, dt) if dt else model


def rigid_body(bound):
    """A sampled rigid body with a mode, noise of 1 % and a bound relative to the response; the basis of its poles."""
    rng, omega = np.random.default_rng(2), np.geomspace(3.0, 200.0, 40)
    z = np.exp(1j * omega * 0.01)
    mode = rid.kautz([60.0], [0.02], dt=0.01, delay=1)
    plant = 5e-3 * (z + 1) / (z - 1) ** 2 + mode.response(omega * 0.01) @ [0.2, 0.1]
    noise = 0.01 * np.abs(plant) * (rng.standard_normal(40) + 1j * rng.standard_normal(40))
    frf = rid.FrequencyResponse(omega, plant + noise, bound=bound * np.abs(plant), dt=0.01)
    return frf, stack_bases([rid.integrators(2, dt=0.01), mode])
