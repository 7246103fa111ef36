"""Small problems of all kinds whose numbers are recorded, by room; `PROBLEMS` holds them by name."""

from . import advice, commands, data, fits, guarantees, identification, pages, passive, reduction, runs  # noqa: F401
from .registry import PROBLEMS

__all__ = ["PROBLEMS"]
