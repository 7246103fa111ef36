"""Any for every name: what scikit-rf itself states of its types is incomplete."""

from typing import Any

def __getattr__(name: str) -> Any: ...
