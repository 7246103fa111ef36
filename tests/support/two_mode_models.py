"""Shared by the tests: two mode models."""

import control
import numpy as np

from support.reduction_models import mode


def two_modes(dt):
    """A mode at 1 Hz with a peak of 10 beside one at 10 Hz with a peak of 50, whose response is 0.5 at 1 Hz."""
    omega = 20 * np.pi
    model = mode(0.05, omega / 10)[0] + control.ss(
        [[0, 1], [-(omega**2), -0.1 * omega]], [[0], [5 * omega]], [[0, 1]], 0
    )
    return control.sample_system(model, dt) if dt else model
