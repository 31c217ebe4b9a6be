"""How a long computation says where it is."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, int, int], None]
"""Called with the name of a stage, the number of its steps done and their number in all."""


def say_nothing(stage: str, done: int, total: int) -> None:
    """Be quiet: the default."""
