"""Checks of arguments that a user gives from Python: their types, whole numbers, one or several."""

import math
import os
from collections.abc import Iterable
from numbers import Integral, Real
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from pouring_robot.exceptions import BadInputError


def expect(value: object, kind: type | UnionType, said: str) -> None:
    """Raise BadInputError, with ``said`` and the type given, unless a value is of a kind."""
    if not isinstance(value, kind):
        raise BadInputError(f"{said}, not a {type(value).__name__}")


class Options:
    """Base of dataclasses of options: a value that is not of the type of its field raises BadInputError.

    A tuple may be any iterable; each class checks its items, and ranges, itself.
    """

    def __post_init__(self) -> None:
        for name, hint in get_type_hints(type(self)).items():
            value, kinds = getattr(self, name), _kinds(hint)
            if not any(_is_a(value, kind) for kind in kinds):
                said = " or ".join(_SAID.get(kind) or str(getattr(kind, "__name__", repr(kind))) for kind in kinds)
                raise BadInputError(f"{name} of {type(self).__name__} must be {said}, not {value!r}")


_SAID = {bool: "True or False", int: "a whole number", float: "a number", str: "a text", NoneType: "None"}


def _kinds(hint: Any) -> list[Any]:
    """Return the types that an annotation accepts, and the values of a Literal."""
    if get_origin(hint) in (Literal, Union, UnionType):
        return [kind for one in get_args(hint) for kind in _kinds(one)]
    return [get_origin(hint) or hint]


def _is_a(value: Any, kind: Any) -> bool:
    from numpy import bool_  # heavy, and already loaded where there are options

    if isinstance(kind, str):
        return isinstance(value, str) and value == kind
    if isinstance(value, bool):  # which Python counts as a number, too
        return kind is bool
    return isinstance(value, {bool: bool_, int: Integral, float: Real, tuple: Iterable}.get(kind, kind))


def as_path(value: Any) -> Path:
    """Return the path of a file, or raise BadInputError."""
    expect(value, str | os.PathLike, "a file is named by its path")
    return Path(value)


def whole(value: Any, least: int, said: str, most: float = math.inf) -> int:
    """Return a whole number, of numpy or not, or raise BadInputError, with ``said`` and the value given."""
    if isinstance(value, bool) or not isinstance(value, Integral) or not least <= int(value) <= most:
        raise BadInputError(f"{said}, not {value!r}")
    return int(value)


def as_tuple(values: Any) -> tuple[Any, ...]:
    """Return one or several values as a tuple; a text is one value."""
    return tuple(values) if isinstance(values, Iterable) and not isinstance(values, str) else (values,)
