"""What all Matplotlib plots have in common: colours, an empty figure, a quiet panel, and the PNG."""

from __future__ import annotations

import io
from typing import Any

# Okabe and Ito's colours, told apart by colour-blind readers too.
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"
GREY, DARK_GREY = "#999999", "#666666"
COLOURS = (BLUE, VERMILION, GREEN, PURPLE)
BEFORE, AFTER, HELD_OUT = VERMILION, BLUE, GREEN

# Quieter ones for temperatures and the paper's plots.
STEEL, MOSS, BRICK, ASH = "#2f6690", "#5b8e55", "#c8553d", "#8a8a8a"


def new_figure(width: float, height: float, dpi: float = 110.0) -> Any:
    """Return an empty Matplotlib figure that needs no screen, sizes in inches."""
    from matplotlib.figure import Figure  # no pyplot: it would look for a screen and keep figures alive

    return Figure(figsize=(width, height), dpi=dpi, layout="constrained")


def tidy(panel: Any) -> None:
    """Give a panel a light grid and no box."""
    panel.spines[["top", "right"]].set_visible(False)
    panel.grid(visible=True, color="#ececec", linewidth=0.7)
    panel.set_axisbelow(True)


def draw_box(panel: Any, across: tuple[float, float], up: tuple[float, float]) -> None:
    """Draw the workspace box, dashed, in the units of the panel."""
    from matplotlib.patches import Rectangle

    size = across[1] - across[0], up[1] - up[0]
    corner = across[0], up[0]
    panel.add_patch(Rectangle(corner, *size, fill=False, edgecolor=DARK_GREY, linestyle="--", label="workspace"))


def png_of(figure: Any) -> bytes:
    """Return a figure as a PNG file: no date and no version inside, so the same figure gives the same bytes."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi="figure", metadata={"Software": None})
    return stream.getvalue()
