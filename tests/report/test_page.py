"""One page for every report: whole, without outside files, and safe whatever its texts hold."""

from html.parser import HTMLParser

from pouring_robot.report.page import Heading, Lines, Paragraph, Plot, Table, html_page

EVIL = "<script>alert('&')</script>"
BLOCKS = [
    Heading(EVIL),
    Paragraph(EVIL, "warn"),
    Paragraph(EVIL, "headline"),
    Table((EVIL, "b"), [(EVIL, "2")]),
    Table(("a",), [("1",), ("2",)], folded=EVIL),
    Lines(["first", "  below it", EVIL]),
    Lines([EVIL], mono=True),
    Plot(EVIL, b"\x89PNG"),
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
    page = html_page(EVIL, EVIL, BLOCKS)
    reader = Reader()
    reader.feed(page)
    assert not reader.open
    assert "script" not in reader.seen and "link" not in reader.seen
    assert [reader.seen.count(tag) for tag in ("h1", "h2", "table", "tr", "li", "details", "figure")] == [
        *(1, 1, 2, 5, 4, 1, 1)
    ]
    assert page.startswith("<!doctype html>") and page.endswith("</html>\n")


def test_blocks_stand_in_their_order_and_look_as_asked():
    page = html_page("t", "h", BLOCKS)
    assert page.index('class="warn"') < page.index('class="lead"') < page.index("<details>") < page.index("<figure>")
    assert '<li class="sub">below it</li>' in page and page.count('class="mono"') == 1
    assert 'src="data:image/png;base64,iVBORw=="' in page
