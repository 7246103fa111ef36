"""A model as JSON."""

from __future__ import annotations

import json
from typing import Any

import numpy as np


def model_text(model: Any, name: str) -> str:
    """Return A, B, C, D, dt (0: continuous), the names of the signals; numbers with all their digits."""
    found: dict[str, Any] = {"name": name, "dt": float(model.dt or 0)}
    found |= {part: np.asarray(getattr(model, part), dtype=float).tolist() for part in "ABCD"}
    found |= {"inputs": list(model.input_labels), "outputs": list(model.output_labels)}
    return json.dumps(found, indent=1) + "\n"
