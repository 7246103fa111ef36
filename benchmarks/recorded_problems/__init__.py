"""Small problems of all kinds whose numbers are recorded, by room; `PROBLEMS` holds them by name."""

from . import advice, commands, data, fits, guarantees, identification, passive, reduction, runs
from .registry import PROBLEMS

__all__ = [
    "PROBLEMS",
    "advice",
    "commands",
    "data",
    "fits",
    "guarantees",
    "identification",
    "passive",
    "reduction",
    "runs",
]
