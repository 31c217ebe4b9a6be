"""Common parts of the pages that check a part of the paper claim by claim."""

from __future__ import annotations

import io
import json
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from rich.console import Console, RenderableType
from rich.table import Table
from rich.text import Text

from pouring_robot.exceptions import OutputError
from pouring_robot.io.files import write_together
from pouring_robot.io.tables import rows_csv
from scripts.paper.claims import Claim

_WIDTH = 120
_STYLES = {"reproduced": "green", "differs": "red", "cannot be checked": "yellow"}


class PaperReport(ABC):
    """A judged study: printed, as files, and as a page of the documentation."""

    title: ClassVar[str]
    """Heading of the page."""
    part: ClassVar[str]
    """Of the paper, as the command calls it."""

    @abstractmethod
    def renderables(self) -> list[RenderableType]:
        """Return everything there is to print."""

    @property
    @abstractmethod
    def figures(self) -> Mapping[str, bytes]:
        """The pictures by file name; PNG."""

    @abstractmethod
    def claim_rows(self) -> list[dict[str, Any]]:
        """Return the claims as rows of a table."""

    @abstractmethod
    def record(self) -> dict[str, Any]:
        """Return all figures, ready for JSON."""

    @abstractmethod
    def tables(self) -> Mapping[str, str]:
        """Return further tables as CSV by file name."""

    @property
    def page(self) -> str:
        """File name of the page."""
        return f"paper_{self.part}.md"

    def text(self) -> str:
        """Return what is printed, 120 characters wide."""
        console = Console(width=_WIDTH, file=io.StringIO(), record=True, highlight=False, color_system=None)
        for item in self.renderables():
            console.print(item)
        return "\n".join(line.rstrip() for line in console.export_text().splitlines()) + "\n"

    def markdown(self, arguments: str) -> str:
        """Return what is printed, with the pictures, as Markdown.

        Args:
            arguments: of the command that made it.
        """
        pictures = "\n\n".join(f"![{name.removesuffix('.png').replace('_', ' ')}]({name})" for name in self.figures)
        command = f"python scripts/reproduce_paper.py {self.part}{arguments}"
        return f"# {self.title}\n\nPrinted by `{command}`.\n\n```text\n{self.text()}```\n\n{pictures}\n"

    def write(self, folder: Path, arguments: str = "") -> list[Path]:
        """Write everything into a folder, which is made if need be; each file whole or not at all.

        Raises:
            OutputError: the folder or a file cannot be written.
        """
        texts = {
            "claims.csv": rows_csv(self.claim_rows()),
            "claims.json": json.dumps(self.record(), indent=1, ensure_ascii=False, allow_nan=False) + "\n",
            **self.tables(),
        }
        return _write_all(folder, texts) + self.write_docs(folder, arguments)

    def write_docs(self, folder: Path, arguments: str = "") -> list[Path]:
        """Write the page and its pictures only.

        Raises:
            OutputError: the folder or a file cannot be written.
        """
        return _write_all(folder, {self.page: self.markdown(arguments), **self.figures})


def _write_all(folder: Path, files: Mapping[str, str | bytes]) -> list[Path]:
    return write_together({folder / name: content for name, content in files.items()})


def make_folder(folder: Path) -> None:
    """Make a folder for results, before the work.

    Raises:
        OutputError: it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(folder, f"{error.strerror or error}; choose a place you may write to") from error


def tally(claims: Sequence[Claim], *, starred: bool = False) -> str:
    """Return how many claims have which verdict, as a sentence."""
    counts: Counter[str] = Counter(claim.verdict for claim in claims)
    inferred = sum(claim.used and claim.verdict == "reproduced" for claim in claims)
    text = ", ".join(f"{counts[verdict]} {verdict}" for verdict in _STYLES)
    return f"{len(claims)} claims: {text}" + (f"; {inferred} of the reproduced with *" if starred else "")


def claims_table(title: str, claims: Sequence[Claim], *, short: bool = False) -> Table:
    """Return one row a claim; ``short`` leaves out source and rule, which the longer table gives."""
    table = Table(title=title, title_justify="left", title_style="bold", show_lines=True, pad_edge=False)
    if not short:
        table.add_column("section", width=9)
    table.add_column("the paper says", ratio=6 if short else 4)
    table.add_column("we compute", ratio=6 if short else 5)
    table.add_column("verdict", width=11)
    if not short:
        table.add_column("reading, rule, reason", ratio=6)
    for claim in claims:
        mark = "*" if claim.used and claim.verdict == "reproduced" and not short else ""
        verdict = Text(claim.verdict + mark, style=_STYLES[claim.verdict])
        cells = (Text(claim.says), Text(claim.computed), verdict)
        reasons = Text(claim.reasons)
        table.add_row(*cells) if short else table.add_row(Text(claim.source), *cells, reasons)
    return table
