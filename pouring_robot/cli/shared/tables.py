"""One look for every table on the terminal."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

from rich.table import Table


def plain_table(
    head: Sequence[str],
    rows: Iterable[Sequence[str]],
    left: Collection[int] = (0,),
    *,
    title: str | None = None,
    wrap: bool = False,
) -> Table:
    """Return a table of plain texts without a frame.

    Args:
        head: headings.
        rows: one text a column; cells at the end may be left out.
        left: columns set to the left; the others, figures, to the right.
        title: above it.
        wrap: whether long cells may go on in the next line.
    """
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    for k, name in enumerate(head):
        table.add_column(name, justify="left" if k in left else "right", no_wrap=not wrap)
    for row in rows:
        table.add_row(*row)
    return table
