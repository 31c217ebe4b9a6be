"""A report as one self-contained HTML page: its content is made here, its look is in ``templates/``."""

from __future__ import annotations

import base64
import functools
import hashlib
import itertools
import math
import os
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pouring_robot import __version__

if TYPE_CHECKING:
    from jinja2 import Environment

Row = Sequence[str]


@dataclass(frozen=True)
class Heading:
    """A heading; ``level`` is 2 for a section, 3 for a part of one."""

    text: str
    level: int = 2


@dataclass(frozen=True)
class Paragraph:
    """A paragraph; ``look`` is "lead", "headline" (a lead in bold), "warn" or nothing."""

    text: str
    look: str = ""


@dataclass(frozen=True)
class Table:
    """A table of texts; cells at the end of a row may be left out.

    ``folded`` is the text shown in its place until it is opened.
    """

    head: Row
    rows: Sequence[Row]
    folded: str = ""

    @functools.cached_property
    def left(self) -> set[int]:
        """Columns aligned left, with their headings: those in which any cell is not a figure."""
        columns = itertools.zip_longest(*self.rows, fillvalue="")
        return {k for k, cells in enumerate(columns) if not all(_is_figure(cell) for cell in cells)}


@dataclass(frozen=True)
class Lines:
    """A list; a line that begins with a blank belongs to the one above it. ``mono`` sets it in a monospaced font."""

    lines: Sequence[str]
    mono: bool = False


def _is_figure(cell: str) -> bool:
    text = cell.strip(" ±%×–").replace("−", "-")
    try:
        return not text or math.isfinite(float(text.split()[0]))
    except ValueError:
        return False


@dataclass(frozen=True)
class Plot:
    """A plot with its title below; ``svg`` is of :func:`pouring_robot.report.plots.svg_of`, which escapes its texts."""

    title: str
    svg: str


Block = Heading | Paragraph | Table | Lines | Plot


def html_page(
    title: str, blocks: Iterable[Block], *, links: Mapping[str, str] | None = None, data: Sequence[Path] = ()
) -> str:
    """Return a page; its texts may hold anything, as they are escaped.

    Args:
        title: of the window, and the heading of the page.
        blocks: its content, from top to bottom.
        links: files that accompany it, by their description.
        data: the files it is about; their hashes are given at its end, with the version and the time.
    """
    drawn = [(type(block).__name__.lower(), block) for block in blocks]  # by the macro of that name
    template = templates("pouring_robot.report").get_template("report.html.j2")
    return template.render(title=title, blocks=drawn, links=links or {}, origin=origin(data))


def origin(data: Iterable[Path]) -> list[str]:
    """Return when and with what a page was made, and of which files (SHA-256); ``SOURCE_DATE_EPOCH`` sets the time."""
    stamp = float(os.environ.get("SOURCE_DATE_EPOCH") or time.time())
    made = f"Made {time.strftime('%Y-%m-%d %H:%M', time.gmtime(stamp))} UTC by pouring_robot {__version__}."
    hashes = ((path, hashlib.sha256(path.read_bytes()).hexdigest()) for path in data if path.is_file())
    return [made, *(f"{path}: SHA-256 {digest}" for path, digest in hashes)]


def sentences(package: str, what: str, **known: Any) -> list[str]:
    """Return the lines of a macro of a package's ``sentences.txt.j2``, called with ``known``."""
    macros = templates(package).get_template("sentences.txt.j2").module
    return [line for line in getattr(macros, what)(**known).splitlines() if line]


@functools.cache
def templates(package: str) -> Environment:
    """Return the templates of a package's folder ``templates``; values inserted into HTML are escaped."""
    from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

    found = Environment(
        loader=PackageLoader(package),
        autoescape=select_autoescape(["html.j2"]),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    found.filters["shown"] = format
    found.filters["base64"] = lambda data: base64.b64encode(data).decode()
    found.filters["css"] = lambda colour: ", ".join(str(round(255 * value)) for value in colour)
    return found
