"""Shared by examples of controllers: worst cases of a loop over frequency, and the axes that they are drawn in."""

import numpy as np
from matplotlib.figure import Figure

TWO_PI = 2 * np.pi


def largest(bounds, omega, name="sensitivity"):
    """Largest singular values of S, or of another map of the loop, over all consistent plants, at frequencies."""
    centre, radius = bounds.at(omega)[name]
    return np.linalg.norm(centre, 2, axis=(1, 2)) + radius


def axes_over(omega, ylabel):
    """Logarithmic axes of a new figure, from the first frequency to the last."""
    axes = Figure(figsize=(8, 4.6), layout="constrained").subplots()
    axes.set(xlabel="frequency [Hz]", ylabel=ylabel, xlim=omega[[0, -1]] / TWO_PI, xscale="log", yscale="log")
    axes.grid(color="0.92", which="both")
    return axes
