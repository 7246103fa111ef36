"""Certificates in files and on the way from workers: without the zeros of other parts, and back."""

import pickle

import numpy as np
import pytest

from robustid.guarantees.packing import pack_certificates, unpack_certificates
from robustid.identification import SupportCertificate


def certificate(seed, used, size=80, rank=3):
    """A certificate of which only some samples, and rows of the factors, are not zero."""
    rng = np.random.default_rng(seed)
    samples = np.zeros(size, complex)
    samples[:used] = rng.standard_normal(used) + 1j
    left, right = np.zeros((size, rank)), np.zeros((size // 2, rank))
    left[used : 2 * used], right[:used] = rng.standard_normal((2, used, rank))
    return SupportCertificate(samples, left, right, 1.0, float(seed))


def same(one, other):
    return (
        np.array_equal(one.samples, other.samples)
        and (one.level, one.value) == (other.level, other.value)
        and (one.left.shape[0], one.right.shape[0]) == (other.left.shape[0], other.right.shape[0])
        and np.allclose(one.left @ one.right.T, other.left @ other.right.T, rtol=0, atol=1e-14)
    )


@pytest.mark.parametrize("used", [(10, 40), (40, 40), (1, 2)], ids=["some", "all of one", "next to nothing"])
def test_certificates_come_back_as_they_were(used):
    certificates = [certificate(k, count) for k, count in enumerate(used)]
    back = unpack_certificates(pack_certificates(certificates))
    assert len(back) == len(certificates)
    assert all(map(same, back, certificates))


def test_none_of_them_is_none():
    assert unpack_certificates(pack_certificates([])) == ()


def test_zeros_of_other_parts_take_no_room():
    parts = [certificate(k, 5, size=400) for k in range(8)]
    packed = pack_certificates(parts)
    assert sum(np.asarray(array).nbytes for array in packed.values()) < 0.2 * sum(
        one.samples.nbytes + one.left.nbytes + one.right.nbytes for one in parts
    )
    sent = pickle.dumps(parts)
    assert len(sent) < 0.2 * len(pickle.dumps([(one.samples, one.left, one.right) for one in parts]))
    for back, one in zip(pickle.loads(sent), parts, strict=True):
        assert all(np.array_equal(getattr(back, name), getattr(one, name)) for name in ("samples", "left", "right"))


@pytest.mark.parametrize(
    "change",
    [
        lambda a: {"used_samples": a["used_samples"][:-1]},
        lambda a: {"used_samples": ~a["used_samples"]},
        lambda a: {"used_left": a["used_left"][1:]},
        lambda a: {"used_left": np.ones_like(a["used_left"])},
        lambda a: {"used_right": a["used_right"].astype(float)},
        lambda a: {"used_right": np.ones_like(a["used_right"])},
        lambda a: {"samples": a["samples"][:-1]},
        lambda a: {"factors": a["factors"][:-1]},
        lambda a: {"order": a["order"] + 1},
        lambda a: {"rank": a["rank"] - 5},
        lambda a: {"value": a["value"][:1]},
    ],
)
def test_arrays_that_do_not_fit_together_are_refused(change):
    packed = pack_certificates([certificate(0, 5), certificate(1, 7)])
    with pytest.raises(ValueError, match="certificates"):
        unpack_certificates(packed | change(packed))
