"""What all Matplotlib plots have in common: colours, an empty figure, a quiet panel, and the PNG."""

import base64
import hashlib
import io
import re
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

# Okabe and Ito's colours, told apart by colour-blind readers too.
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"
GREY, DARK_GREY = "#999999", "#666666"
COLOURS = (BLUE, VERMILION, GREEN, PURPLE)
BEFORE, AFTER, HELD_OUT = VERMILION, BLUE, GREEN

# Quieter ones for temperatures and the paper's plots.
STEEL, MOSS, BRICK, ASH = "#2f6690", "#5b8e55", "#c8553d", "#8a8a8a"

_SVG, _TELL = "{http://www.w3.org/2000/svg}", "tell-"
_drawing = threading.RLock()


@contextmanager
def own_look() -> Iterator[None]:
    """Draw as everywhere, whatever style the user's own plots have: it is one of the whole process, so one at a time.

    Decorates what draws a figure; what becomes of the figure in :func:`png_of` and :func:`svg_of` has it too.
    """
    import matplotlib as mpl

    with _drawing, mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams["text.parse_math"] = False  # others' names hold any sign; log axes so need "{x:g}"
        yield


def new_figure(width: float, height: float, dpi: float = 110.0) -> Any:
    """Return an empty Matplotlib figure that needs no screen, sizes in inches."""
    from matplotlib.figure import Figure  # no pyplot: it would look for a screen and keep figures alive

    return Figure(figsize=(width, height), dpi=dpi, layout="constrained")


def tidy(panel: Any) -> None:
    """Give a panel a light grid and no box."""
    panel.spines[["top", "right"]].set_visible(False)
    panel.grid(visible=True, color="#808080", alpha=0.2, linewidth=0.7)
    panel.set_axisbelow(True)


def draw_box(panel: Any, across: tuple[float, float], up: tuple[float, float]) -> None:
    """Draw the workspace box, dashed, in the units of the panel."""
    from matplotlib.patches import Rectangle

    size = across[1] - across[0], up[1] - up[0]
    corner = across[0], up[0]
    panel.add_patch(Rectangle(corner, *size, fill=False, edgecolor=DARK_GREY, linestyle="--", label="workspace"))


def _place(figure: Any) -> None:
    """Find room for everything now: saving would draw all of it twice for that."""
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine(None)


@own_look()
def png_of(figure: Any) -> bytes:
    """Return a figure as a PNG file: no date and no version inside, so the same figure gives the same bytes."""
    stream = io.BytesIO()
    _place(figure)
    figure.savefig(stream, format="png", dpi="figure", metadata={"Software": None})
    return stream.getvalue()


def tell(artist: Any, texts: Iterable[str]) -> None:
    """Say what each point or bar of an artist is when a reader of the SVG points at it, a text each.

    The artist is a line of markers, a scatter, or one patch; points that are not finite are not drawn and have no text.
    """
    artist.set_gid(_TELL + base64.urlsafe_b64encode("\n".join(texts).encode()).decode())


@own_look()
def svg_of(figure: Any) -> str:
    """Return a figure as an SVG element to stand in a page: real letters, colours that follow the page's, no date."""
    import matplotlib as mpl
    from lxml import etree

    _place(figure)
    stream, unsaid = io.BytesIO(), dict.fromkeys(("Date", "Creator", "Format", "Type"))
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "pouring_robot"}):
        figure.savefig(stream, format="svg", transparent=True, metadata=unsaid)
    root = etree.fromstring(stream.getvalue())
    # About as large as it was drawn, so that a phone keeps the letters' size and scrolls, and a page with room does not
    # blow it up; a page is 60rem wide at most.
    width = root.get("width")
    size = f"min-width: min({width}, 60rem); max-width: min(1.25 * {width}, 60rem)"
    root.set("style", f"stroke-linejoin: round; stroke-linecap: butt; fill: currentColor; {size}")
    for style in root.iter(f"{_SVG}style"):
        style.getparent().remove(style)  # it would be the whole page's
    for group in root.iter(f"{_SVG}g"):
        words = group.attrib.pop("id", "")
        if words.startswith(_TELL):
            marks = list(group.iter(f"{_SVG}use")) or group.findall(f"{_SVG}path")
            texts = base64.urlsafe_b64decode(words.removeprefix(_TELL)).decode().split("\n")
            for mark, said in zip(marks, texts, strict=False):  # what lies outside its panel is not drawn
                etree.SubElement(mark, f"{_SVG}title").text = said
        _shorten(group)
    for element in root.iter():  # two decimals: a hundredth of a point is not seen
        for name in {"d", "x", "y", "width", "height"} & set(element.attrib):
            element.set(name, re.sub(r"(\d\.\d\d)\d+", r"\1", element.get(name)))
    text = etree.tostring(root, encoding="unicode")
    for clip in root.iter(f"{_SVG}clipPath"):  # named after places in memory, some of them
        shape = hashlib.md5(etree.tostring(clip[0]), usedforsecurity=False).hexdigest()[:10]
        text = text.replace(clip.get("id"), f"clip{shape}")
    # Black is what the page writes with and white what it writes on, be it bright or dark.
    return re.sub(r"(stroke|fill): #000000", r"\1: currentColor", text).replace("#ffffff", "var(--paper)")


def _shorten(group: Any) -> None:
    """Say once what all points of a group look like, and where they are to a tenth of a point: there are thousands."""
    marks = group.findall(f"{_SVG}use")
    if len({mark.get("style") for mark in marks}) == 1:
        group.set("style", marks[0].get("style", ""))
        for mark in marks:
            mark.attrib.pop("style", None)
    for mark in marks:
        mark.set("x", f"{float(mark.get('x', 0.0)):.1f}")
        mark.set("y", f"{float(mark.get('y', 0.0)):.1f}")
