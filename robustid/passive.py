"""Passive models: the nearest one, reduction, the modes of passive classes."""

from robustid.bases import passive_modes
from robustid.core import explain
from robustid.passivity import make_passive, reduce_passive

__all__ = ["make_passive", "passive_modes", "reduce_passive"]

explain(__name__, __all__)
