"""Figures as JSON takes them, and with how many decimals they are shown."""

import json
import math
from typing import Any


def json_text(content: Any) -> str:
    """Return content as the text of a JSON file; ValueError where a number of it is not finite."""
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def two_digits(value: float, fewest: int = 0) -> int:
    """Return with how many decimals a value is shown with two digits: at least the fewest, at most 6, 3 for zero."""
    return min(max(1 - math.floor(math.log10(abs(value))), fewest), 6) if abs(value) > 0.0 else 3


def without_nan(value: Any) -> Any:
    """Return nested figures with None, JSON's null, in the place of everything that is not finite."""
    if isinstance(value, dict):
        return {key: without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
