"""Runs of plants with modes and a slow real pole, of friction or of warming up: no smooth remainder stands for it."""

import control
import numpy as np

import robustid as rid
from robustid.app.run.modes import box_of_modes
from robustid.guarantees import real_poles
from robustid.guarantees.scope import pole_words
from robustid.report.proved_band import poles_words


def drive(dt):
    """Torque to the speed of the motor of two masses with friction, two samples of delay: a real pole at 0.59 Hz and a mode."""
    motor, load, stiffness, damping, friction = 2e-3, 5e-3, 60.0, 0.012, 0.02
    A = [
        [-(friction + damping) / motor, damping / motor, -stiffness / motor],
        [damping / load, -(damping + 0.3 * friction) / load, stiffness / load],
        [1.0, -1.0, 0.0],
    ]
    speed = control.c2d(control.ss(A, [[1 / motor], [0.0], [0.0]], [[1.0, 0.0, 0.0]], 0.0), dt)
    return lambda omega: speed(np.exp(1j * omega * dt)) * np.exp(-2j * omega * dt)


def test_a_drive_with_friction_has_its_slow_real_pole_beside_the_mode(unreduced, undrawn):
    """Without it no class that says anything holds the response: the data were called inconsistent, by a factor of 100."""
    dt, rng = 2e-3, np.random.default_rng(3)
    hz = np.concatenate([np.geomspace(1.0, 25.0, 8), np.linspace(28.0, 38.0, 8), np.linspace(45.0, 200.0, 8)])
    omega, plant = 2 * np.pi * hz, drive(dt)
    bound = 0.02 * np.abs(plant(omega))
    errors = bound * rng.uniform(0, 0.9, omega.size) * np.exp(2j * np.pi * rng.uniform(size=omega.size))
    frf = rid.FrequencyResponse(omega, plant(omega) + errors, bound=bound, dt=dt)
    found = rid.identify_reduced(frf, worst_case=False)
    assert found.consistent
    modes = found.run_file.modes
    ((real, ends),) = [one[:2] for one in zip(modes.hz, modes.hz_interval, modes.damping, strict=True) if one[2] == 1]
    assert np.isclose(real, 0.026 / 0.007 / (2 * np.pi), rtol=0.05)
    assert ends == (real, real)
    box = box_of_modes(modes)
    assert len(box[0]) == 1
    band = rid.band(found.identification, box=box)
    between = 2 * np.pi * np.linspace(0.2, 249.0, 2000)
    centre, radius = band.at(between)
    assert np.all(np.abs(plant(between) - centre[:, 0, 0]) <= radius[:, 0, 0])
    assert real_poles(band.problem) == 1  # which is taken as exact, and said to be
    assert poles_words(band).endswith("the real pole beside taken as exact")
    assert pole_words([band]).endswith("of others taken as exact")
