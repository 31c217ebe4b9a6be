"""What a user gives from Python: of which kind it must be, whole numbers, one or several."""

import math
import os
from collections.abc import Iterable
from numbers import Integral
from pathlib import Path
from types import UnionType
from typing import Any

from pouring_robot.exceptions import BadInputError


def expect(value: object, kind: type | UnionType, said: str) -> None:
    """Raise BadInputError, what is ``said`` and what came instead, unless a value is of a kind."""
    if not isinstance(value, kind):
        raise BadInputError(f"{said}, not a {type(value).__name__}")


def as_path(value: Any) -> Path:
    """Return the path of a file, or raise BadInputError."""
    expect(value, str | os.PathLike, "a file is named by its path")
    return Path(value)


def whole(value: Any, least: int, said: str, most: float = math.inf) -> int:
    """Return a whole number, of numpy or not, or raise BadInputError, what is ``said`` and what came instead."""
    if isinstance(value, bool) or not isinstance(value, Integral) or not least <= int(value) <= most:
        raise BadInputError(f"{said}, not {value!r}")
    return int(value)


def as_tuple(values: Any) -> tuple[Any, ...]:
    """Return one or several as a tuple; a text is one, not its letters."""
    return tuple(values) if isinstance(values, Iterable) and not isinstance(values, str) else (values,)
