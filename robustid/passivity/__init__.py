"""Passive models: the proof, the nearest passive model, passive reduction."""

from robustid.passivity.passive_models import PassiveModel, PassiveStatus, make_passive, reduce_passive
from robustid.passivity.passivity import Passivity, PassivityStatus, prove_passive
from robustid.passivity.passivity_certificate import PassivityCertificate

__all__ = [
    "PassiveModel",
    "PassiveStatus",
    "Passivity",
    "PassivityCertificate",
    "PassivityStatus",
    "make_passive",
    "prove_passive",
    "reduce_passive",
]
