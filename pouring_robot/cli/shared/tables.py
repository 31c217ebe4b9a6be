"""One look for every table on the terminal."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import TYPE_CHECKING

from pouring_robot.cli.shared.options import print_indented, say, terminal

if TYPE_CHECKING:
    from pouring_robot.report.page import Block

_MOST_ROWS = 40


def print_table(
    head: Sequence[str],
    rows: Sequence[Sequence[str]],
    left: Collection[int] = (0,),
    *,
    title: str | None = None,
    bold: Collection[int] = (),
    most: int | None = None,
    beyond: str = "",
) -> None:
    """Print a table of plain texts without a frame, of a long one its beginning and what is said of the others.

    Cells at the end of a row may be left out. Columns in ``left`` are texts, set to the left, which go on in the next
    line where that makes the table fit a terminal; the others are figures, set to the right and never cut. Rows in
    ``bold`` stand out.
    """
    from rich.console import Console
    from rich.measure import Measurement
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    for k, name in enumerate(head):
        table.add_column(name, justify="left" if k in left else "right", no_wrap=k not in left)
    for k, row in enumerate(rows[:most]):
        table.add_row(*row, style="bold" if k in bold else None)
    wide, here = Console(width=10_000), terminal()
    needed = Measurement.get(wide, wide.options, table)
    fits = here.is_terminal and needed.minimum <= here.width
    table.width = min(needed.maximum, here.width) if fits else needed.maximum
    say(table, soft_wrap=True)
    if most is not None and len(rows) > most:
        say(f"… and {len(rows) - most} {beyond}")


def print_blocks(blocks: Iterable[Block]) -> None:
    """Print the blocks of a page, its plots left out."""
    from pouring_robot.report.page import Heading, Lines, Paragraph, Table

    for block in blocks:
        if isinstance(block, Heading | Paragraph):
            say(block.text, style="bold" if isinstance(block, Heading) else "")
        elif isinstance(block, Table):
            print_table(block.head, block.rows, block.left)
        elif isinstance(block, Lines):
            print_lines(block.lines)


def print_lines(lines: Iterable[str]) -> None:
    """Print a list; a line that begins with a blank stands further in."""
    for line in lines:
        print_indented(line.strip(), 2 + len(line) - len(line.lstrip()))


def print_rows(head: Sequence[str], rows: Sequence[Sequence[str]], title: str = "") -> None:
    """Print a table of figures, a row a pose, all set to the right; of a long one its beginning.

    As text and no rich table: that would take twice as long to set as thousands of poses take to close.
    """
    shown = [head, *rows[:_MOST_ROWS]]
    widths = [max(map(len, column)) for column in zip(*shown, strict=True)]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in shown]
    lines += [f"… and {len(rows) - _MOST_ROWS} more; --out FILE.csv writes all"] if len(rows) > _MOST_ROWS else []
    if title:
        say(title, style="italic")
    say("\n".join(lines), soft_wrap=True)
