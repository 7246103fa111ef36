"""What the tests of files share: a frequency response and a record with every field set."""

import numpy as np

from robustid.data import Bound, FrequencyResponse, TimeRecord

RNG = np.random.default_rng(0)
TIME = 0.01 * np.arange(6)
U, Y = RNG.standard_normal((6, 2)), RNG.standard_normal((6, 3))
HZ = np.array([1.0, 2.0, 5.0, 7.0])
G = RNG.standard_normal((4, 2, 3)) + 1j * RNG.standard_normal((4, 2, 3))


def full_frf():
    root = RNG.standard_normal((4, 6, 6)) + 1j * RNG.standard_normal((4, 6, 6))
    return FrequencyResponse(
        HZ,
        G,
        bound=Bound(RNG.uniform(0.1, 1, G.shape), kind="confidence", probability=0.95, dof=7.5),
        covariance=root @ root.conj().swapaxes(1, 2),
        dt=0.1 + 0.2,
        inputs=["a [N]", "b, with comma", "c"],
        outputs=["x [µm]", 'y "quoted"'],
        note="first line\nsecond line",
        dof=7.5,
        coherence=RNG.uniform(0, 1, (4, 2)),
        noise=RNG.uniform(0, 1, G.shape),
        distortion=RNG.uniform(0, 1, G.shape),
        changed=RNG.uniform(0, 1, G.shape),
        doubt=RNG.standard_normal(G.shape) + 1j * RNG.standard_normal(G.shape),
    )


def full_record():
    bound = RNG.uniform(0.1, 1, Y.shape)
    bound[0] = np.inf
    return TimeRecord(
        U,
        Y,
        dt=1 / 3,
        bound=Bound(bound, kind="noise_floor"),
        reference=U[:, :1],
        initial="free",
        past_input_bound=np.pi,
        inputs=["a [A]", "b"],
    )
