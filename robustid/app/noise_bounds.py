"""Bounds that a source states: a number, a part of the response, or what they are taken from; and those of sources without one."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

from robustid.app.sources import RecordSource, ResponseSource
from robustid.estimation import BOUND_SOURCES, default_bound

Source = TypeVar("Source", bound=RecordSource | ResponseSource)


def with_bound(data: Any, source: Source) -> tuple[Any, Source]:
    """The data with the bound that their source asks to be taken from them, or, where nobody states one, that they offer.

    And the source with what it was taken from.
    """
    word = source.bound if source.bound in BOUND_SOURCES else None
    if data.bound is not None and word is None:
        return data, source
    averages = getattr(source, "averages", None)
    bounded, word = default_bound(data, word, averages=averages)
    return bounded, dataclasses.replace(source, bound=word)
