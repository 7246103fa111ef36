"""One small design, made once for all tests that only look at one: its controller is given, and proved."""

import functools

import numpy as np

from robustid.controllers.controller_storage import design_again
from robustid.controllers.plants import Plants
from robustid.core import StateMatrices
from robustid.design import PID, Bandwidth, Limits
from support.design_cases import band_of

PI = StateMatrices(*(np.array([[one]]) for one in (1.0, 0.01, 12.9, 0.38)))
LIMITS = Limits(gain_margin=2.0, roll_off=((150.0, 310.0, 0.9),), attenuation=((0.5, 3.0, 0.5),))


@functools.cache
def small_band():
    return band_of(1)[1]


@functools.cache
def small_design():
    """PI for the band of a random plant, with limits of several kinds."""
    loop = Plants.of(small_band()).loop
    return design_again((small_band(),), (loop,), PI, (PID(),), LIMITS, Bandwidth(), 11.0, ())
