"""A report as one HTML page without any outside file: plain content here, its look in ``templates/``."""

from __future__ import annotations

import base64
import functools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

if TYPE_CHECKING:
    from jinja2 import Environment

Row = Sequence[str]


@dataclass(frozen=True)
class Heading:
    """A heading; ``level`` is 2 for a section, 3 for a part of one."""

    text: str
    level: int = 2
    kind: ClassVar[str] = "heading"


@dataclass(frozen=True)
class Paragraph:
    """A paragraph; ``look`` is "lead", "headline" (a lead in bold), "warn" or nothing."""

    text: str
    look: str = ""
    kind: ClassVar[str] = "paragraph"


@dataclass(frozen=True)
class Table:
    """A table of texts.

    Attributes:
        head: its headings.
        rows: its rows.
        folded: what stands in its place until it is opened; "" for an open table.
    """

    head: Row
    rows: Sequence[Row]
    folded: str = ""
    kind: ClassVar[str] = "table"


@dataclass(frozen=True)
class Lines:
    """A list; a line that begins with a blank belongs to the one above it. ``mono`` keeps letters equally wide."""

    lines: Sequence[str]
    mono: bool = False
    kind: ClassVar[str] = "lines"


@dataclass(frozen=True)
class Plot:
    """A plot with its title below."""

    title: str
    png: bytes
    kind: ClassVar[str] = "plot"


Block = Heading | Paragraph | Table | Lines | Plot


def html_page(title: str, heading: str, blocks: Iterable[Block]) -> str:
    """Return a page; every text of it may hold anything, for it is escaped.

    Args:
        title: of the window.
        heading: of the page.
        blocks: its content, from top to bottom.
    """
    template = templates("pouring_robot.report").get_template("report.html.j2")
    return template.render(title=title, heading=heading, blocks=list(blocks))


@functools.cache
def templates(package: str) -> Environment:
    """Return the templates of a package's folder ``templates``; what is put into them is escaped."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    found = Environment(
        loader=PackageLoader(package),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    found.filters["base64"] = lambda data: base64.b64encode(data).decode()
    found.filters["css"] = lambda colour: ", ".join(str(round(255 * value)) for value in colour)
    return found
