"""Polygons at an end of the range of a band."""

import numpy as np

import robustid as rid
from robustid.core import Budget
from robustid.guarantees.linear.directed import Sides
from robustid.guarantees.linear.directed_search import directed_band
from robustid.guarantees.linear.entry_band import apart, first_knots
from robustid.guarantees.linear.solved_nodes import NO_NODES, Nodes, joined_band
from support.halvings import arcs_halved


def test_a_polygon_at_the_nyquist_frequency_alone_narrows_the_band_beside_it():
    """It lies at a knot, not between two: the search around it has no other node to begin from."""
    omega = np.linspace(20.0, 280.0, 8)
    z = np.exp(0.01j * omega)
    values = 0.0375 * (z - 0.2) / ((z - 0.9) * (z - 0.7) * z)
    frf = rid.FrequencyResponse(omega, values, bound=0.03 * np.abs(values) + 0.005, dt=0.01)
    problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=2.5, decay_rate=1.05))
    plain = rid.band(problem).bands[0]
    low, high = plain.angles[[0, -1]]
    assert np.isclose(high, np.pi)
    sides, least = Sides(plain.samples, plain.extraction, NO_NODES.corners), 1e-7 * (high - low)
    with arcs_halved(0):
        lines = directed_band(sides, apart(first_knots(plain.samples, low, high), least), least, Budget())
    centre, radius = lines.at(plain.angles[-1:])
    corners = centre[:, None] + radius[:, None] / 10 * np.exp(0.25j * np.pi * np.arange(8))
    node = Nodes(plain.angles[-1:], centre, radius / 10, corners)
    found = joined_band(plain, lines, node, Budget())
    beside = np.array([np.pi, np.pi - 0.01])
    assert np.all(found.at(beside)[1] < 0.5 * lines.at(beside)[1])
