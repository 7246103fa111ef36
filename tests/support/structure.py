"""Problems about the simulated structure of two masses and a beam."""

import robustid as rid

ANY = rid.Prior(gain_bound=1.0, decay_rate=1.5)  # a placeholder


def structure_problem(which, **options):
    data = rid.flexible_structure(**options)
    modes = data.modes[which]
    basis = rid.kautz(modes[:, 0], modes[:, 1], dt=0.01, delay=1) if len(modes) else None
    return rid.MixedProblem(frequency=data.frequency, time=data.time, prior=ANY, parametric=basis)
