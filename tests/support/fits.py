"""Systems and data of the tests of fits: 120 frequency points with 2 % noise."""

import numpy as np

import robustid as rid
from support.mfd_systems import noisy, random_modal_system

HZ = 2 * np.pi
OMEGA = HZ * np.geomspace(4, 1200, 120)
SYSTEM = random_modal_system(1, 2, 2, 4)
SMALL = random_modal_system(5, 1, 1, 2)


def measured(system, omega, **names):
    points = 1j * omega if system.dt is None else np.exp(1j * omega * system.dt)
    values = noisy(np.random.default_rng(0), system.response(points))
    return rid.FrequencyResponse(omega, values, dt=system.dt, **names)
