"""One page for every report: complete, without external files, and safe whatever its texts contain."""

import hashlib
import re
import shutil
import subprocess
import zlib
from html.parser import HTMLParser

import numpy as np
import pytest

from pouring_robot import __version__
from pouring_robot.report.page import Heading, Lines, Paragraph, Plot, Table, html_page
from pouring_robot.report.plots import new_figure, own_look, svg_of, tell

EVIL = "<script>alert('&')</script>"
BLOCKS = [
    Heading(EVIL),
    Paragraph(EVIL, "warn"),
    Paragraph(EVIL, "headline"),
    Table((EVIL, "b"), [(EVIL, "2")]),
    Table(("a",), [("1",), ("2",)], folded=EVIL),
    Lines(["first", "  below it", EVIL]),
    Lines([EVIL], mono=True),
    Plot(EVIL, "<svg></svg>"),
]


class Reader(HTMLParser):
    def __init__(self):
        super().__init__()
        self.open, self.seen = [], []

    def handle_starttag(self, tag, attributes):
        self.seen.append(tag)
        if tag not in {"meta", "img"}:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_every_tag_is_closed_and_no_text_is_taken_for_one():
    page = html_page(EVIL, BLOCKS)
    reader = Reader()
    reader.feed(page)
    assert not reader.open
    assert reader.seen.count("script") == 1 and "link" not in reader.seen  # the page's own
    assert [reader.seen.count(tag) for tag in ("h1", "h2", "table", "tr", "li", "details", "figure")] == [
        *(1, 1, 2, 5, 4, 1, 1)
    ]
    assert page.startswith("<!doctype html>") and page.endswith("</html>\n")


def test_blocks_stand_in_their_order_and_look_as_asked():
    page = html_page("t", BLOCKS)
    assert page.index('class="warn"') < page.index('class="lead"') < page.index("<details>") < page.index("<figure>")
    assert '<li class="sub">below it</li>' in page and page.count('class="mono"') == 1
    assert "<svg></svg>" in page and 'name="viewport"' in page and "prefers-color-scheme:dark" in page
    assert "http" not in page.replace("http://www.w3.org/2000/svg", "")


@pytest.mark.skipif(shutil.which("chromium") is None, reason="needs chromium, which no Python package brings")
def test_what_is_folded_is_printed(tmp_path):
    page, words = html_page("t", BLOCKS), []
    for name, content in (("folded", page), ("open", page.replace("<details>", "<details open>"))):
        (tmp_path / f"{name}.html").write_text(content)
        command = ["chromium", "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
        command += ["--no-pdf-header-footer", f"--print-to-pdf={tmp_path / 'page.pdf'}"]
        command.append((tmp_path / f"{name}.html").as_uri())
        subprocess.run(command, capture_output=True, timeout=60, check=True)
        streams = re.findall(
            rb"/FlateDecode.*?stream\r?\n(.*?)endstream", (tmp_path / "page.pdf").read_bytes(), re.DOTALL
        )
        words.append(sum(len(re.findall(rb"T[jJ]\b", zlib.decompress(stream))) for stream in streams))
    assert words[0] == words[1] > 10


@pytest.mark.skipif(shutil.which("chromium") is None, reason="needs chromium, which no Python package brings")
def test_paper_cuts_off_nothing(tmp_path):
    """An A4 page has 718 px between its margins, and nobody can scroll it."""
    figure = new_figure(9.5, 3.0)
    figure.subplots()
    wide = Table(tuple(f"x{k} mrad" for k in range(8)), [("−123.4567 ± 1.2345",) * 8])
    page = html_page("t", [wide, Plot("t", svg_of(figure))]).replace("@media print", "@media all")
    probe = """document.title = [...document.querySelectorAll(".wide")].map(box =>
      `${getComputedStyle(box).overflowX} ${box.scrollWidth - box.clientWidth}`)"""
    (tmp_path / "page.html").write_text(page.replace("</body>", f"<script>{probe}</script></body>"))
    command = ["chromium", "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
    command += ["--window-size=718,1000", "--dump-dom", (tmp_path / "page.html").as_uri()]
    dom = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout
    assert re.search("<title>(.*)</title>", dom)[1] == "visible 0,visible 0"


def test_headings_stand_over_their_cells():
    table = Table(("name", "a", "b", "c", "d"), [("x", "1.0", "+3 ± 2", "mm", ""), ("y", "−2", "4 %", "", "–")])
    assert table.left == {0, 3}
    page = html_page("t", [table])
    rows = [re.findall(r'<t[hd]( class="l")?>', row) for row in re.findall("<tr>.*</tr>", page)]
    assert len(rows) == 3 and rows[0] == rows[1] == rows[2] == [' class="l"', "", "", ' class="l"', ""]
    ragged = html_page("t", [Table(("name", "a", "b"), [("x", "1", "2"), ("y",)])])
    assert [row.count("<td") for row in re.findall("<tr>.*</tr>", ragged)] == [0, 3, 3]


def test_a_page_says_when_and_of_what_it_was_made(tmp_path, monkeypatch):
    data = tmp_path / "<campaign>.csv"
    data.write_bytes(b"q1_mm\n1\n")
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    page = html_page("t", [], links={"the model": "model.yaml"}, data=[data, tmp_path / "gone.csv"])
    assert f"Made 1970-01-02 00:00 UTC by pouring_robot {__version__}." in page
    assert hashlib.sha256(b"q1_mm\n1\n").hexdigest() in page and "&lt;campaign&gt;.csv: SHA-256" in page
    assert "gone" not in page and '<a href="model.yaml">the model</a>' in page


def pointed():
    figure = new_figure(4.0, 3.0)
    panel = figure.subplots()
    (dots,) = panel.plot([1.0, np.nan, 2.0], [1.0, 2.0, 3.0], ".", color="black", label=EVIL)
    tell(dots, [EVIL, "second"])
    tell(panel.scatter([1.0, 2.0], [2.0, 2.0], c=[0.0, 1.0]), ["s1", "s2"])
    tell(panel.bar([3.0], [1.0])[0], ["a bar 0.12345"])
    panel.legend()
    return svg_of(figure)


@pytest.mark.parametrize("words", ["costs $5 and $6", r"wear of $\frac{$", "a_$x^2$_1"])
def test_texts_of_others_are_no_formulas(words):
    """Between two dollar signs Matplotlib sees TeX, and a formula that is none ended the command."""
    with own_look():
        figure = new_figure(6.0, 3.0)
        panel = figure.subplots()
        panel.set(title=words, xlabel=words)
        panel.set_yticks([0.0, 1.0], [words, "b"])
    assert re.findall(r"<text[^>]*>([^<]*\$[^<]*)</text>", svg_of(figure)) == 3 * [words]


def test_a_picture_is_about_as_large_as_it_was_drawn():
    figure = new_figure(4.0, 3.0)
    figure.subplots()
    assert "min-width: min(288pt, 60rem); max-width: min(1.25 * 288pt, 60rem)" in svg_of(figure)


def test_points_of_a_plot_say_what_they_are():
    svg = pointed()
    assert svg == pointed()  # no date, no random names
    found = re.findall("<(use|path)[^>]*><title>(.*?)</title></", svg)
    words = "&lt;script&gt;alert('&amp;')&lt;/script&gt;"
    assert sorted(found) == sorted(
        [("use", words), ("use", "second"), ("use", "s1"), ("use", "s2"), ("path", "a bar 0.12345")]
    )
    # The first point stands left of and below the second, as drawn.
    x, y = (np.array(re.findall(rf'{a}="([\d.]+)"[^>]*><title>(?:&lt;|second)', svg), dtype=float) for a in "xy")
    assert x[0] < x[1] and y[0] > y[1]
    assert "#000000" not in svg and "currentColor" in svg and "<style" not in svg and EVIL not in svg
