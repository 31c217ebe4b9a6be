"""Pictures: they show something, for a changed robot and for one left alone."""

from xml.etree import ElementTree

import matplotlib as mpl

from pouring_robot.calibration.plots import plots


def marks(svg):
    """Return how many lines, areas and points a drawing has."""
    drawing = ElementTree.fromstring(svg)
    assert float(drawing.get("width").removesuffix("pt")) > 400
    return sum(element.tag.endswith(("path", "use")) for element in drawing.iter())


def test_four_pictures_of_a_calibrated_robot(found):
    drawn = plots(found)
    assert [title.split(" ")[0] for title, _ in drawn] == ["Error", "Parameters", "How", "Correlation"]
    assert all(marks(svg) > 30 for _, svg in drawn)


def test_the_style_of_the_users_own_plots_is_not_in_them(unchanged):
    usual = plots(unchanged)
    with mpl.rc_context({"text.color": "white", "axes.labelcolor": "white", "font.size": 30.0}):
        assert plots(unchanged) == usual
        assert mpl.rcParams["font.size"] == 30.0


def test_two_of_one_left_alone(unchanged):
    assert len(plots(unchanged)) == 2
