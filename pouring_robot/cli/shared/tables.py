"""The same layout for every table on the terminal."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import zip_longest
from typing import TYPE_CHECKING

from pouring_robot.cli.shared.options import print_indented, say, terminal

if TYPE_CHECKING:
    from pouring_robot.report.page import Block

_MOST_ROWS, _COMMAND = 40, ": pouring-robot "


def print_table(
    head: Sequence[str],
    rows: Sequence[Sequence[str]],
    left: Collection[int] = (0,),
    *,
    title: str = "",
    bold: Collection[int] = (),
    most: int | None = None,
    beyond: str = "",
) -> None:
    """Print a table of plain texts without a frame; of a long one the first ``most`` rows and a line on the others.

    Cells at the end of a row may be left out. Columns in ``left`` are texts, left-aligned; the others are figures,
    right-aligned. Where a terminal is too narrow, texts are wrapped if that makes the rows fit; otherwise the last
    columns continue on the next line. No word or figure is broken. Rows in ``bold`` are highlighted.
    """
    from rich.text import Text

    shown = [(*row, *[""] * (len(head) - len(row))) for row in (head, *rows[:most])]
    here = terminal()
    lines = [
        Text(line, "bold" if k == 0 or k - 1 in bold else "")
        for k, taken in enumerate(_set(shown, left, here.width if here.is_terminal else math.inf))
        for line in taken
    ]
    if title:
        say(title, style="italic")
    say(Text("\n").join(lines), soft_wrap=True)
    if most is not None and len(rows) > most:
        say(f"… and {len(rows) - most} {beyond}")


def _set(rows: Sequence[Sequence[str]], left: Collection[int], room: float) -> Iterator[list[str]]:
    """Yield each row as the lines that it needs in a width of ``room`` characters."""
    widths, gap = _widths(list(zip(*rows, strict=True)), left, room)
    parts = _parts(widths, gap, room)
    for row in rows:
        folded = [
            textwrap.wrap(cell, width, break_long_words=False, break_on_hyphens=False) if len(cell) > width else [cell]
            for cell, width in zip(row, widths, strict=True)
        ]
        taken = []
        for cells in zip_longest(*folded, fillvalue=""):
            even = [cells[k].ljust(width) if k in left else cells[k].rjust(width) for k, width in enumerate(widths)]
            for part in parts:
                taken.append(" " * (gap * (part is not parts[0])) + (" " * gap).join(even[k] for k in part).rstrip())
        yield taken


def _widths(columns: Sequence[Sequence[str]], left: Collection[int], room: float) -> tuple[list[int], int]:
    """Return the widths of the columns and the gap between them; texts are narrowed where that makes all fit."""
    widths = [max(map(len, column)) for column in columns]
    least = {k: max(len(word) for cell in columns[k] for word in (*cell.split(), "")) for k in left}
    narrowest = [least.get(k, width) for k, width in enumerate(widths)]
    for gap in (2, 1):
        if _taken(narrowest, gap) <= room:
            while _taken(widths, gap) > room:
                widths[max((k for k in left if widths[k] > least[k]), key=widths.__getitem__)] -= 1
            return widths, gap
    return widths, 2


def _parts(widths: Sequence[int], gap: int, room: float) -> list[list[int]]:
    """Return the columns of each line: those for which there is no room continue on a line indented by the gap."""
    parts = [list[int]()]
    for k in range(len(widths)):
        further_in = gap * (len(parts) > 1)
        if parts[-1] and further_in + _taken([widths[j] for j in (*parts[-1], k)], gap) > room:
            parts.append([])
        parts[-1].append(k)
    return parts


def _taken(widths: Sequence[int], gap: int) -> int:
    return sum(widths) + gap * (len(widths) - 1)


def print_blocks(blocks: Iterable[Block]) -> None:
    """Print the blocks of a page, without its plots."""
    from pouring_robot.report.page import Heading, Lines, Paragraph, Table

    for block in blocks:
        if isinstance(block, Heading | Paragraph):
            say(block.text, style="bold" if isinstance(block, Heading) else "")
        elif isinstance(block, Table):
            print_table(block.head, block.rows, block.left)
        elif isinstance(block, Lines):
            print_lines(block.lines)


def print_lines(lines: Iterable[str]) -> None:
    """Print a list; a line with a leading blank is indented further, a command at its end gets its own line to copy."""
    for line in lines:
        text, command, arguments = line.strip().partition(_COMMAND)
        by = 2 + len(line) - len(line.lstrip())
        print_indented(text + command[:1], by)
        if command:
            say(f"{'':{by + 1}}{command[1:]}{arguments}", soft_wrap=True)


def print_rows(head: Sequence[str], rows: Sequence[Sequence[str]], title: str = "") -> None:
    """Print a table of figures, a row per pose, right-aligned; of a long one the first rows."""
    print_table(head, rows, (), title=title, most=_MOST_ROWS, beyond="more; --out FILE.csv writes all")
