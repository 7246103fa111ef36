"""Any for every name: what SciPy itself states of its types is incomplete."""

from typing import Any

def __getattr__(name: str) -> Any: ...
