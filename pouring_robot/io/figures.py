"""Figures for JSON, and the number of decimals with which they are shown."""

import json
import math
from typing import Any


def json_text(content: Any) -> str:
    """Return content as the text of a JSON file; raises ValueError if it holds a number that is not finite."""
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def two_digits(value: float, fewest: int = 0) -> int:
    """Return the decimals that show a value with two digits: at least ``fewest``, at most 6, 3 for zero."""
    return min(max(1 - math.floor(math.log10(abs(value))), fewest), 6) if abs(value) > 0.0 else 3


def without_nan(value: Any) -> Any:
    """Return nested figures with None, JSON's null, in place of every number that is not finite."""
    if isinstance(value, dict):
        return {key: without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
