"""How a long computation reports its progress."""

from collections.abc import Callable

Progress = Callable[[str, int, int], None]
"""Called with the current task, the number of its steps done and their total, 0 if unknown."""


def say_nothing(what: str, done: int, total: int) -> None:
    """Report nothing: the default."""
