"""Problems about the simulated structure of two masses and a beam."""

import robustid as rid

ANY = rid.Prior(gain_bound=1.0, decay_rate=1.5)  # a placeholder


def structure_problem(which, **options):
    data = rid.datasets.flexible_structure(**options)
    modes = data.modes[which]
    basis = rid.kautz(modes[:, 0], modes[:, 1], dt=0.01, delay=1) if len(modes) else None
    return rid.MixedProblem(frequency=data.frequency, time=data.time, prior=ANY, parametric=basis)


def about_structure(data, gain_bound, decay_rate, *, time=False, modes=None, repeat=1, **options):
    """What is asked about simulated data: their lines and perhaps their record, pairs at their own modes or at others."""
    basis = rid.kautz(*(data.modes if modes is None else modes).T, dt=0.01, delay=1, repeat=repeat)
    prior, record = rid.Prior(gain_bound=gain_bound, decay_rate=decay_rate), data.time if time else None
    return rid.MixedProblem(frequency=data.frequency, time=record, prior=prior, parametric=basis, **options)
