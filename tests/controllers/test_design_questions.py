"""Questions about controllers that have no sense: each is refused with the number that stands in the way."""

import dataclasses
import math

import control
import numpy as np
import pytest

import robustid as rid
from robustid.design import FIR, PID, Attenuation, Fixed, Limits, LowPass, Notch
from support.cases import slow
from support.design_cases import DT, lag_band, matrix_band_of, values_of

TOP = f"{math.pi / DT:.5g}"


def banded(model, **data):
    """The band about a model, of its own response."""
    omega = np.linspace(3.0, 300.0, 12)
    frf = rid.FrequencyResponse(omega, values_of(model, omega), **{"bound": 0.01, "dt": model.dt or None, **data})
    decay = {"decay_rate": 1.08} if model.dt else {"decay": 10.0}
    return rid.band(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.2, **decay)), model=model)


@pytest.fixture(scope="module")
def bands():
    unstable, gain = control.ss(1.1, 1.0, 1.0, 0.0, DT), control.ss([], [], [], 0.5, DT)
    loop = rid.Loop(gain)
    R = loop.residual_of(unstable)
    return {
        "sampled": lag_band(),
        "slower": banded(control.ss(control.tf([0.1], [1, -0.9], 1.01 * DT))),
        "continuous": banded(control.ss(control.tf([50.0], [1, 50.0]))),
        "unstable": rid.loop_bounds(banded(R), loop),
    }


REFUSED = [
    (
        "sampled",
        {"limits": Limits(bandwidth=400.0)},
        f"`bandwidth` must be below the Nyquist frequency, {TOP} rad/s; got 400",
    ),
    (
        "sampled",
        {"limits": Limits(attenuation=[(350.0, 400.0, 0.5)])},
        f"must begin below the Nyquist frequency, {TOP} .* 350",
    ),
    (
        "sampled",
        {"limits": Limits(roll_off=[(350.0, 400.0, 0.5)])},
        f"`roll_off` must begin below .*{TOP} rad/s; got 350",
    ),
    ("sampled", {"maximise": Attenuation(320.0, 330.0)}, f"begins below the Nyquist frequency, {TOP} rad/s; got 320"),
    (
        "sampled",
        {"limits": Limits(attenuation=[(1.0, 9.0, 0.1)], roll_off=[(5.0, 30.0, 0.2)])},
        r"0.1 \+ 0.2 = 0.3 at 5 rad/s",
    ),
    (
        "sampled",
        {"limits": Limits(tracking=[(1.0, 9.0, 0.9)], roll_off=[(5.0, 30.0, 0.8)])},
        r"both are about \|T\|; got at least 0.9 and at most 0.8 at 5",
    ),
    (
        "sampled",
        {"limits": Limits(bandwidth=50.0, roll_off=[(20.0, 300.0, 0.3)])},
        "0.5 there; got a `roll_off` of 0.3 from 20",
    ),
    ("sampled", {"structure": Notch(400.0)}, f"Notch must be below the Nyquist frequency, {TOP} rad/s; got 400"),
    ("sampled", {"structure": [PID(), LowPass((500.0, 900.0))]}, f"LowPass must be below .* {TOP} rad/s; got 500"),
    ("sampled", {"structure": [PID(), PID()]}, "one integrator at most; got 2"),
    ("sampled", {"structure": [PID(), Fixed(control.ss(1.0, 1.0, DT, 0.0, DT))]}, "one integrator at most; got 2"),
    ("sampled", {"structure": Fixed(control.ss(0.5, 1.0, 1.0, 0.0, 0.02))}, "dt = 0.02 s; the plant has dt = 0.01 s"),
    ("sampled", {"structure": PID(filter=math.nan)}, "`filter` must be finite; got nan"),
    ("sampled", {"structure": Notch(-3.0)}, "`omega` must be positive; got -3"),
    ("sampled", {"structure": FIR(0)}, "`length` must be at least 1; got 0"),
    ("sampled", {"structure": PID(integral=False), "limits": Limits(integral_gain=3.0)}, "must hold an integrator"),
    ("sampled", {"maximise": "least control"}, "else C = 0 is the answer; got none"),
    (
        "sampled",
        {"maximise": "least control", "limits": Limits(attenuation=[(1, 2, 1.5)])},
        "got an attenuation of 1.5",
    ),
    ("sampled", {"time_limit": -1.0}, "`time_limit` must be positive; got -1"),
    ("continuous", {"structure": FIR(4)}, r"FIR\(4\), whose past samples"),
    ("unstable", {"structure": Fixed(control.zpk([1.1], [0.2], 1.0, DT))}, "must not cancel an unstable pole: .* 1.1"),
]


@pytest.mark.parametrize(("of", "change", "words"), REFUSED)
def test_a_question_without_sense_is_refused_with_its_number(bands, of, change, words):
    with pytest.raises(rid.RobustIdError, match=words):
        rid.design_controller(**{"bands": bands[of], "structure": PID(), **change})


def test_bands_that_do_not_go_together_are_refused(bands):
    with pytest.raises(rid.InputError, match=r"one sample time; got 0\.01 and 0\.0101 s"):
        rid.design_controller([bands["sampled"], bands["slower"]], PID())
    with pytest.raises(rid.InputError, match="about models"):
        rid.design_controller(rid.band(bands["sampled"].problem), PID())
    with pytest.raises(rid.RobustIdError, match="stable"):
        bands["sampled"].with_model(control.ss(1.2, 1.0, 1.0, 0.0, DT))


@pytest.mark.parametrize("one", [lag_band, slow(lambda: matrix_band_of(0)[1])])
def test_a_band_that_is_open_somewhere_is_refused_before_the_search(one, monkeypatch):
    band = one()
    circle, arc = band.circle, np.searchsorted(band.circle.edges, 40.0)
    here = (np.arange(circle.bound.size) == arc)[:, None, None]
    bound, radius = (np.where(here, np.inf, size) for size in (circle.sets.bound, circle.sets.radius))
    sets = circle.sets._replace(bound=bound, radius=radius)
    monkeypatch.setattr(type(band), "circle", dataclasses.replace(circle, sets=sets))
    monkeypatch.setattr("robustid.controllers.plants._about_fewer_states", lambda band: band)
    with pytest.raises(rid.InputError, match=f"at {circle.edges[arc]:.5g} rad/s nothing is known"):
        rid.design_controller(band, PID())


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"sensitivity_peak": math.nan}, "`sensitivity_peak` must be finite; got nan"),
        ({"bandwidth": math.inf}, "`bandwidth` must be finite; got inf"),
        ({"delay_margin": -1e-3}, "`delay_margin` must be positive; got -0.001"),
        ({"attenuation": [(2.0, 2.0, 0.1)]}, r"low < high .* got \(2.0, 2.0, 0.1\)"),
        ({"roll_off": [(2.0, 5.0, math.inf)]}, r"got \(2.0, 5.0, inf\)"),
        ({"tracking": [(2.0, 5.0, 1.0)]}, r"and a value between 0 and 1; got \(2.0, 5.0, 1.0\)"),
        ({"disturbance": [(2.0, 5.0, -1.0)]}, r"`disturbance` must be .* got \(2.0, 5.0, -1.0\)"),
        ({"attenuation": [(math.nan, 5.0, 0.1)]}, r"got \(nan, 5.0, 0.1\)"),
        ({"phase_margin": math.nan}, "`phase_margin` must be finite; got nan"),
    ],
)
def test_limits_without_sense_are_refused(given, words):
    with pytest.raises(rid.InputError, match=words):
        Limits(**given)


@pytest.mark.parametrize(("low", "high"), [(20.0, 1.0), (5.0, 5.0), (-1.0, 3.0), (math.nan, 3.0)])
def test_an_empty_range_of_attenuation_is_refused(low, high):
    with pytest.raises(rid.InputError, match="`low`"):
        Attenuation(low, high)
