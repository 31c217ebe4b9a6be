"""Pictures: they show something, for a changed robot and for one left alone."""

import io

from PIL import Image

from pouring_robot.calibration.plots import plots


def colours(png):
    with Image.open(io.BytesIO(png)) as picture:
        assert picture.width > 700
        return len(picture.convert("RGB").getcolors(1 << 22))


def test_four_pictures_of_a_calibrated_robot(found):
    drawn = plots(found)
    assert [title.split(" ")[0] for title, _ in drawn] == ["Error", "Parameters", "How", "Correlation"]
    assert all(colours(png) > 30 for _, png in drawn)


def test_two_of_one_left_alone(unchanged):
    assert len(plots(unchanged)) == 2
