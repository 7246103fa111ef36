"""Every public flag refuses a word: "no" would count as true."""

import inspect
import types

import numpy as np
import pytest

import robustid as rid
from robustid.errors import InputTypeError
from robustid.fitting import subspace_estimate

pytestmark = pytest.mark.quick

OMEGA = np.linspace(1, 9, 40)
FRF = rid.FrequencyResponse(OMEGA, 1 / (16 - OMEGA**2 + 0.2j * OMEGA))
RECORD = rid.TimeRecord(np.cos(np.arange(40.0) ** 2), np.ones(40), dt=0.1)
CLASS = rid.datasets.flexible_structure(lines=5)
PRIOR = rid.Prior(gain_bound=0.2, decay_rate=1.1)
PAIR = rid.kautz(CLASS.modes[:1, 0], CLASS.modes[:1, 1], dt=CLASS.frequency.dt)
PROBLEM = rid.MixedProblem(frequency=CLASS.frequency, prior=PRIOR, parametric=PAIR)

# name, flags, what takes the flag
CALLS = [
    ("Band.verify", "exact", lambda **flag: rid.guarantee.Band.verify(None, **flag)),
    ("Contradiction.verify", "exact", lambda **flag: rid.guarantee.Contradiction.verify(None, **flag)),
    ("Family.on_circle", "everywhere", lambda **flag: rid.guarantee.Family.on_circle(None, **flag)),
    ("Family.verify", "exact", lambda **flag: rid.guarantee.Family.verify(None, **flag)),
    ("FrequencyResponse", "judged", lambda **flag: rid.FrequencyResponse(OMEGA, FRF.values, **flag)),
    ("MixedProblem", "symmetric", lambda **flag: rid.MixedProblem(frequency=CLASS.frequency, prior=PRIOR, **flag)),
    ("Modal", "symmetric", rid.fits.Modal),
    ("PID", "integral", rid.design.PID),
    ("TimeRecord", "held", lambda **flag: rid.TimeRecord(np.ones(4), np.ones(4), dt=1.0, **flag)),
    ("WorstCaseError.on_circle", "everywhere", lambda **flag: rid.guarantee.WorstCaseError.on_circle(None, **flag)),
    ("WorstCaseError.verify", "exact", lambda **flag: rid.guarantee.WorstCaseError.verify(None, **flag)),
    ("coprime", "normalised", lambda **flag: rid.guarantee.coprime(None, **flag)),
    ("datasets.find", "verify", lambda **flag: rid.datasets.find("daisy/hairdryer.mat", **flag)),
    ("estimate_delay", "feedthrough", lambda **flag: rid.prepare.estimate_delay(FRF, **flag)),
    ("fit_mfd", "feedthrough modal restart stable", lambda **flag: rid.fit_mfd(FRF, order=2, **flag)),
    ("fit_records", "feedthrough offset stable", lambda **flag: rid.fit_records(RECORD, order=2, **flag)),
    ("identify_reduced", "worst_case", lambda **flag: rid.identify_reduced(CLASS.frequency, **flag)),
    ("improve_kautz", "repeat", lambda **flag: rid.advise.improve_kautz(PROBLEM, **flag)),
    (
        "multisine",
        "minimise_crest",
        lambda **flag: rid.prepare.multisine(band_hz=(1, 31), period=1000, dt=1e-3, **flag),
    ),
    ("run", "force resume static", lambda **flag: rid.run("ask.toml", "results", **flag)),
    ("write_report", "static", lambda **flag: rid.write_report(FRF, "page.html", **flag)),
    ("subspace_estimate", "feedthrough stable", lambda **flag: subspace_estimate(FRF.values, 1j * OMEGA, 2, **flag)),
]


MEANT = {("fit_mfd", "modal"): (0.0, None, "False"), ("fit_mfd", "feedthrough"): (None,)}  # words that say something


@pytest.mark.parametrize(
    ("call", "flag", "words"),
    [
        (call, flag, [word for word in ("no", "False", 0.0, None) if word not in MEANT.get((name, flag), ())])
        for name, flags, call in CALLS
        for flag in flags.split()
    ],
)
def test_a_word_for_a_flag_is_refused(call, flag, words):
    for word in words:
        with pytest.raises(InputTypeError, match=f"{flag}.* must be [Tt]rue or "):
            call(**{flag: word})


def test_numpys_flags_are_flags():
    assert rid.fits.Modal(symmetric=np.True_).symmetric is True


def public():
    """Names and objects that take arguments: functions, classes and their methods; of groups by their own names."""
    for name in dir(rid):
        value, found = getattr(rid, name), [(name, getattr(rid, name))]
        if isinstance(value, types.ModuleType):
            own = "" if name in rid._GROUPS and name != "datasets" else f"{name}."
            found = [(f"{own}{key}", getattr(value, key)) for key in dir(value) if not key.startswith("_")]
        for key, one in found:
            yield key, one
            if isinstance(one, type):
                yield from ((f"{key}.{part}", getattr(one, part)) for part in dir(one) if not part.startswith("_"))


def test_no_public_flag_is_missing_here():
    found = set()
    for name, value in public():
        error = isinstance(value, type) and issubclass(value, Exception)
        if callable(value) and getattr(value, "__module__", "").startswith("robustid") and not error:
            for parameter in inspect.signature(value).parameters.values():
                if isinstance(parameter.default, bool):
                    found.add((name, parameter.name))
    assert found <= {(name, flag) for name, flags, _ in CALLS for flag in flags.split()}
    assert len(found) >= 18
