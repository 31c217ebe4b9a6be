"""What a user gives from Python: of which kind it must be, one or several."""

from collections.abc import Iterable
from types import UnionType
from typing import Any

from pouring_robot.exceptions import BadInputError


def expect(value: object, kind: type | UnionType, said: str) -> None:
    """Raise BadInputError, what is ``said`` and what came instead, unless a value is of a kind."""
    if not isinstance(value, kind):
        raise BadInputError(f"{said}, not a {type(value).__name__}")


def as_tuple(values: Any) -> tuple[Any, ...]:
    """Return one or several as a tuple; a text is one, not its letters."""
    return tuple(values) if isinstance(values, Iterable) and not isinstance(values, str) else (values,)
