"""What all Matplotlib figures have in common: an empty one, a quiet panel, and the PNG."""

from __future__ import annotations

import io
from typing import Any

_DPI = 110


def new_figure(width: float, height: float) -> Any:
    """Return an empty Matplotlib figure that needs no screen, sizes in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=_DPI, layout="constrained")


def tidy(panel: Any) -> None:
    """Give a panel a light grid and no box."""
    panel.spines[["top", "right"]].set_visible(False)
    panel.grid(visible=True, color="#ececec", linewidth=0.7)
    panel.set_axisbelow(True)


def png_of(figure: Any, dpi: float | None = None) -> bytes:
    """Return a figure as a PNG file: no date and no version inside, so the same figure gives the same bytes.

    Args:
        figure: the figure.
        dpi: dots an inch; by default the figure's own.
    """
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=dpi or "figure", metadata={"Software": None})
    return stream.getvalue()
