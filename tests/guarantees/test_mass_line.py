"""A mass with two flexible modes: amplitudes far apart in size, one of them next to nothing."""

import numpy as np

import robustid as rid

HZ = np.geomspace(0.5, 300.0, 90)
MASS, MODES, DAMPING, SIZES = 3.0, 2 * np.pi * np.array([62.0, 150.0]), 0.006, (0.25, -0.1)
BOX = np.column_stack([MODES * 0.9983, MODES * 1.0017]), np.array([[0.004, 0.008]] * 2)


def plant(s):
    modes = (size / (s**2 + 2 * DAMPING * w * s + w**2) for w, size in zip(MODES, SIZES, strict=True))
    return 1 / (MASS * s**2) + sum(modes)


def test_the_error_is_proved_where_the_drift_of_a_mass_is_next_to_nothing():
    """Discs to begin with were those of its fitted amplitude, 1e7 times too small: nothing was proved at any frequency."""
    rng, omega = np.random.default_rng(3), 2 * np.pi * HZ
    true = plant(1j * omega)
    values = true * (1 + 0.02 * (rng.standard_normal(90) + 1j * rng.standard_normal(90)) / np.sqrt(2))
    basis = [rid.integrators(2, dt=0), rid.kautz(MODES, [DAMPING] * 2, dt=0)]
    frf = rid.FrequencyResponse(omega, values, bound=0.07 * np.abs(true), dt=None)
    problem = rid.MixedProblem(frequency=frf, parametric=basis, prior=rid.Prior(gain_bound=1.2e-8, decay=940.0))
    band = rid.band(rid.identify(problem), box=BOX)
    at = 2 * np.pi * np.geomspace(0.5, 300.0, 1500)
    centre, radius = band.at(at)
    assert np.all(np.abs(plant(1j * at) - centre[:, 0, 0]) < radius[:, 0, 0])
    assert np.median(radius[:, 0, 0] / np.abs(plant(1j * at))) < 0.1
    assert band.certified
