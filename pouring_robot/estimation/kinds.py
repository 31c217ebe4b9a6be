"""The kinds of what is measured, and the components of a row: their order, their names and the units of display."""

from typing import Literal, get_args

import numpy as np

from pouring_robot.io.units import shown_in
from pouring_robot.mechanism.arrays import BoolArray, Indices

Kind = Literal["position", "rotation", "distance", "closure"]
KINDS: tuple[Kind, ...] = get_args(Kind)
LENGTHS: tuple[Kind, ...] = ("position", "distance", "closure")
_FIRST = (0, 3, 6, 7)
_COMPONENTS = ("x", "y", "z", "rx", "ry", "rz", "distance", "closure")


def kind_of(components: Indices) -> Indices:
    """Return the index in :data:`KINDS` of components, same shape."""
    return np.asarray(np.searchsorted(_FIRST, components, side="right") - 1, dtype=np.intp)


def kinds_of(components: Indices) -> tuple[Kind, ...]:
    """Return the kinds of components, each once."""
    return tuple(KINDS[place] for place in np.unique(kind_of(components)).tolist())


def are(kind: Kind, components: Indices) -> BoolArray:
    """Return which components are of a kind, same shape."""
    return np.asarray(kind_of(components) == KINDS.index(kind), dtype=np.bool_)


def component_name(component: int) -> str:
    """Return the name of a component: ``x``, ``rz``, ``distance``, ``closure``, ``closure_2``."""
    last = len(_COMPONENTS) - 1
    return _COMPONENTS[component] if component <= last else f"{_COMPONENTS[last]}_{component - last + 1}"


def unit_of(kind: Kind) -> tuple[str, float]:
    """Return the unit in which a kind is shown, and its size (SI)."""
    return shown_in("rad" if kind == "rotation" else "m")


def component_shown_in(component: int) -> tuple[str, float]:
    """Return the same for the kind of a component."""
    return unit_of(KINDS[kind_of(np.asarray(component))])
