"""Objects that are equal where everything that is stored of them is equal, and rows of tables as pandas takes them."""

from __future__ import annotations

import functools
import importlib
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from robustid.core.description import fingerprint
from robustid.errors import InputError

if TYPE_CHECKING:
    import pandas  # type: ignore[reportMissingTypeStubs]


class ByValue:
    """Mixin of frozen dataclasses that can be stored: equal by everything that is stored of them."""

    @functools.cached_property
    def _fingerprint(self) -> str:
        return fingerprint(self)

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        return type(self) is type(other) and isinstance(other, ByValue) and self._fingerprint == other._fingerprint

    def __hash__(self) -> int:
        return hash(self._fingerprint)


class Tabular:
    """Mixin of what has rows: `to_dataframe` gives them to pandas."""

    INDEX: ClassVar[str] = ""  # the column by whose values rows are named

    def table(self) -> Mapping[str, Any]:
        """Columns of one length by their names."""
        raise NotImplementedError

    def to_dataframe(self) -> pandas.DataFrame:
        """Return the rows as a DataFrame of pandas.

        Returns
        -------
        pandas.DataFrame

        Raises
        ------
        InputError
            If pandas is not installed.
        """
        try:
            frame: Any = importlib.import_module("pandas").DataFrame
        except ImportError:
            raise InputError("`to_dataframe` needs pandas, which is not installed: pip install pandas") from None
        found = frame({name: np.array(column) for name, column in self.table().items()})
        return found.set_index(self.INDEX) if self.INDEX else found
