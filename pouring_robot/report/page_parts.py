"""What the HTML reports have in common: style, tables, pictures, colours."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence

Row = Sequence[str]

# Okabe and Ito's colours, told apart by colour-blind readers too.
BEFORE, AFTER, HELD_OUT, GREY = "#D55E00", "#0072B2", "#009E73", "#999999"

STYLE = """
body{font:15px/1.45 system-ui,sans-serif;max-width:68rem;margin:2rem auto;padding:0 1rem;color:#1b1f23}
table{border-collapse:collapse;margin:.6rem 0;font-variant-numeric:tabular-nums}
th,td{padding:.2rem .7rem;text-align:right;border-bottom:1px solid #d8dee4}
th:first-child,td:first-child,th:nth-child(2),td:last-child{text-align:left}
.warn{background:#fff4d6;border-left:4px solid #d99000;padding:.4rem .8rem;margin:.3rem 0}
.lead{font-size:1.25rem}img{max-width:100%}code,li.mono{font-family:ui-monospace,monospace;font-size:.9em}
"""


def html_page(title: str, parts: Iterable[str], style: str = "") -> str:
    """Return a page without any outside file; ``parts`` are HTML."""
    head = f"<meta charset='utf-8'><title>{html.escape(title)}</title><style>{STYLE}{style}</style>"
    return "\n".join([f"<!doctype html><html lang='en'><head>{head}</head><body>", *parts, "</body></html>\n"])


def html_table(head: Row, rows: Sequence[Row]) -> str:
    """Return a table of plain texts."""
    cells = "".join(f"<th>{html.escape(name)}</th>" for name in head)
    body = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><tr>{cells}</tr>{body}</table>"


def html_picture(title: str, png: bytes) -> str:
    """Return a picture with its title below, embedded."""
    text = html.escape(title)
    code = base64.b64encode(png).decode()
    return f"<figure><img alt='{text}' src='data:image/png;base64,{code}'><figcaption>{text}</figcaption></figure>"
