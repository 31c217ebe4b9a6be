"""What every result offers at a prompt or in a notebook: one line, and a small table."""

from __future__ import annotations

from abc import ABC, abstractmethod
from html import escape
from typing import TYPE_CHECKING, Any

from pouring_robot.exceptions import counted

if TYPE_CHECKING:
    import pandas as pd

_SHOWN_ROWS = 12


class Result(ABC):
    """Base of results. A dataclass that derives from it is declared with ``repr=False``.

    A result is saved whole or not at all; OutputError says why something cannot be written.
    """

    @property
    @abstractmethod
    def headline(self) -> str:
        """The result in one line, with figures and their units."""

    def to_frame(self) -> pd.DataFrame:
        """Return the figures as a table whose column names carry the units."""
        import pandas as pd

        return pd.DataFrame(self._table())

    def _table(self) -> Any:
        """Return the rows of the table, or its columns by name; a class may override :meth:`to_frame` instead."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.headline}>"

    def _repr_html_(self) -> str:
        """Return the headline and the first rows of the table, for notebooks."""
        frame = self.to_frame()
        more = f"<p>{counted(len(frame) - _SHOWN_ROWS, 'more row')}</p>" if len(frame) > _SHOWN_ROWS else ""
        some = frame.head(_SHOWN_ROWS).to_html(index=False, border=0, float_format=lambda value: f"{value:.6g}")
        return f"<p><strong>{escape(self.headline)}</strong></p>{some if len(frame) else ''}{more}"
