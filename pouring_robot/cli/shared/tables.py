"""One look for every table on the terminal."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import TYPE_CHECKING

from pouring_robot.cli.shared.options import print_indented

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from pouring_robot.report.page import Block

_MOST_ROWS = 40


def plain_table(
    head: Sequence[str],
    rows: Iterable[Sequence[str]],
    left: Collection[int] = (0,),
    *,
    title: str | None = None,
    wrap: bool = False,
) -> Table:
    """Return a table of plain texts without a frame; cells at the end of a row may be left out.

    Columns in ``left`` are set to the left, the others, figures, to the right; ``wrap`` lets long cells go on in the
    next line.
    """
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    for k, name in enumerate(head):
        table.add_column(name, justify="left" if k in left else "right", no_wrap=not wrap)
    for row in rows:
        table.add_row(*row)
    return table


def print_blocks(console: Console, blocks: Iterable[Block]) -> None:
    """Print the blocks of a page, its plots left out."""
    from pouring_robot.report.page import Heading, Lines, Paragraph, Table

    for block in blocks:
        if isinstance(block, Heading | Paragraph):
            console.print(block.text, style="bold" if isinstance(block, Heading) else "")
        elif isinstance(block, Table):
            console.print(plain_table(block.head, block.rows, block.left))
        elif isinstance(block, Lines):
            for line in block.lines:
                print_indented(console, line.strip(), 2 + len(line) - len(line.lstrip()))


def few_rows(head: Sequence[str], rows: Sequence[Sequence[str]], where: str) -> str:
    """Return a table of figures as text, all set to the right; of a long one its beginning, and where the others are.

    Text and no rich table: that would take twice as long to set as thousands of poses take to close.
    """
    shown = [head, *rows[: _MOST_ROWS if len(rows) > _MOST_ROWS else None]]
    widths = [max(map(len, column)) for column in zip(*shown, strict=True)]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in shown]
    more = [f"… and {len(rows) - _MOST_ROWS} more; {where}"] if len(rows) > _MOST_ROWS else []
    return "\n".join([*lines, *more])
