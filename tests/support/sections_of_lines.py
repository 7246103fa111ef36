"""What the tests of the form in powers of sections share."""

import numpy as np

import robustid as rid

CIRCLE = np.exp(2j * np.pi * np.arange(2**13) / 2**13)


def coordinates(values, sections):
    """<g, phi_j> of a function with these values on the circle."""
    circle = CIRCLE[:: CIRCLE.size // len(values)]
    return (values @ sections.evaluate(circle * (1 - 1e-16)).conj()).real / circle.size


def lines(omega, bound=0.01, rho=1.05, gain=1.0):
    frf = rid.FrequencyResponse(omega, np.zeros(np.size(omega)), bound=bound, dt=1.0)
    return rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=gain, decay_rate=rho))


def oversampled(count=300, rho=1.003, top=0.01, noise=1.0, bound=0.01):
    """Frequency points up to the part `top` of 1 kHz, of a member: three modes with poles at 1.5 to 2.5 times the decay."""
    rng, dt = np.random.default_rng(0), 1e-3
    angles = np.linspace(2e-4, top, count) * 2 * np.pi
    poles = (1 + (rho - 1) * rng.uniform(1.5, 2.5, 3)) * np.exp(2j * np.pi * top * rng.uniform(0.1, 0.9, 3))
    weights = rng.standard_normal(3) + 1j * rng.standard_normal(3)

    def member(z):
        return sum(
            w / (1 - z / p) + w.conjugate() / (1 - z / p.conjugate()) for w, p in zip(weights, poles, strict=True)
        )

    size = np.abs(member(rho * np.exp(1j * np.linspace(0, np.pi, 20000)))).max()
    error = bound * np.sqrt(rng.random(count)) * np.exp(2j * np.pi * rng.random(count))
    values = 0.9 * member(np.exp(-1j * angles)) / size + noise * error
    frf = rid.FrequencyResponse(angles / dt, values, dt=dt, bound=bound)
    return rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.0, decay_rate=rho))
