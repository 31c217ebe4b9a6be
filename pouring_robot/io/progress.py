"""How a long computation says where it is."""

from collections.abc import Callable

Progress = Callable[[str, int, int], None]
"""Called with what is being done now, the number of its steps done and their number in all, 0 if nobody can say."""


def say_nothing(what: str, done: int, total: int) -> None:
    """Be quiet: the default."""
