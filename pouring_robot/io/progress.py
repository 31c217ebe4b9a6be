"""How a long computation says where it is."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, int, int], None]
"""Called with the name of a stage, the number of its steps done and their number in all."""

Status = Callable[[str], None]
"""Called with what is being done now, where steps cannot be counted."""


def say_nothing(what: str, done: int = 0, total: int = 0) -> None:
    """Be quiet: the default of either."""
