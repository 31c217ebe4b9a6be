"""What all Matplotlib plots have in common: colours, an empty figure, a quiet panel, and the PNG."""

import base64
import hashlib
import io
import re
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

# Okabe and Ito's colours, which colour-blind readers can distinguish, too.
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
    """Draw in the package's style, whatever style the user has set: style is global, so one figure at a time.

    Decorates functions that draw a figure; :func:`png_of` and :func:`svg_of` use it, too.
    """
    import matplotlib as mpl

    with _drawing, mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams["text.parse_math"] = False  # users' names hold any sign; log axes then need "{x:g}"
        yield


def new_figure(width: float, height: float, dpi: float = 110.0) -> Any:
    """Return an empty Matplotlib figure that needs no screen, sizes in inches."""
    from matplotlib.figure import Figure  # not pyplot, which would look for a screen and keep figures alive

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
    """Do the layout now: saving would draw everything twice for it."""
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
    """Set the tooltip of each point or bar of an artist in the SVG, a text each.

    The artist is a line of markers, a scatter, or one patch; points that are not finite are not drawn and have no text.
    """
    artist.set_gid(_TELL + base64.urlsafe_b64encode("\n".join(texts).encode()).decode())


@own_look()
def svg_of(figure: Any) -> str:
    """Return a figure as an SVG element for a page: text as text, colours that follow the page's, no date."""
    import matplotlib as mpl
    from lxml import etree

    _place(figure)
    stream, omitted = io.BytesIO(), dict.fromkeys(("Date", "Creator", "Format", "Type"))
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "pouring_robot"}):
        figure.savefig(stream, format="svg", transparent=True, metadata=omitted)
    root = etree.fromstring(stream.getvalue())
    # About as large as drawn, so that a phone keeps the size of letters and scrolls, and a wide page does not enlarge
    # it; a page is 60rem wide at most.
    width = root.get("width")
    size = f"min-width: min({width}, 60rem); max-width: min(1.25 * {width}, 60rem)"
    root.set("style", f"stroke-linejoin: round; stroke-linecap: butt; fill: currentColor; {size}")
    for style in root.iter(f"{_SVG}style"):
        style.getparent().remove(style)  # it would apply to the whole page
    for group in root.iter(f"{_SVG}g"):
        words = group.attrib.pop("id", "")
        if words.startswith(_TELL):
            marks = list(group.iter(f"{_SVG}use")) or group.findall(f"{_SVG}path")
            texts = base64.urlsafe_b64decode(words.removeprefix(_TELL)).decode().split("\n")
            for mark, said in zip(marks, texts, strict=False):  # points outside their panel are not drawn
                etree.SubElement(mark, f"{_SVG}title").text = said
        _shorten(group)
    for element in root.iter():  # two decimals: a hundredth of a point is not visible
        for name in {"d", "x", "y", "width", "height"} & set(element.attrib):
            element.set(name, re.sub(r"(\d\.\d\d)\d+", r"\1", element.get(name)))
    text = etree.tostring(root, encoding="unicode")
    for clip in root.iter(f"{_SVG}clipPath"):  # some are named after memory addresses
        shape = hashlib.md5(etree.tostring(clip[0]), usedforsecurity=False).hexdigest()[:10]
        text = text.replace(clip.get("id"), f"clip{shape}")
    # Black becomes the page's text colour and white its background, in light or dark mode.
    return re.sub(r"(stroke|fill): #000000", r"\1: currentColor", text).replace("#ffffff", "var(--paper)")


def _shorten(group: Any) -> None:
    """State the style of a group's points once, and their places to a tenth of a point: there are thousands."""
    marks = group.findall(f"{_SVG}use")
    if len({mark.get("style") for mark in marks}) == 1:
        group.set("style", marks[0].get("style", ""))
        for mark in marks:
            mark.attrib.pop("style", None)
    for mark in marks:
        mark.set("x", f"{float(mark.get('x', 0.0)):.1f}")
        mark.set("y", f"{float(mark.get('y', 0.0)):.1f}")
