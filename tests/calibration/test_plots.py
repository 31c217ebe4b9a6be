"""Plots: they show something, for a changed robot and for one left unchanged."""

import dataclasses
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np

from pouring_robot.calibration import plots as drawing
from pouring_robot.calibration.plots import plots
from pouring_robot.estimation.noise import Noise, NoiseLevel


def marks(svg):
    """Return how many lines, areas and points a drawing has."""
    drawing = ElementTree.fromstring(svg)
    assert float(drawing.get("width").removesuffix("pt")) > 400
    return sum(element.tag.endswith(("path", "use")) for element in drawing.iter())


def test_four_plots_of_a_calibrated_robot(found):
    drawn = plots(found)
    assert [title.split(" ")[0] for title, _ in drawn] == ["Error", "Parameters", "How", "Correlation"]
    assert all(marks(svg) > 30 for _, svg in drawn)


def test_numbers_of_parameters_are_explained(found, monkeypatch):
    """There is room for a few names only."""
    said = "parameter of calibration.json, the first is 0"
    assert said not in plots(found)[-1][1]
    monkeypatch.setattr(drawing, "_MOST_NAMES", 1)
    assert said in plots(found)[-1][1]


def test_errors_of_distances_alone_are_drawn(found):
    noise, lines = NoiseLevel({"distance": Noise(1e-4, "stated")}), np.full((len(found.before), 7), np.nan)
    lines[:, 6] = 1e-3
    title, svg = plots(dataclasses.replace(found, noise=noise, before=lines, after=lines))[0]
    assert "row" in title
    assert f"line {found.campaign.lines[0]}: 1.0000 mm before" in svg
    assert "distance error [mm]" in svg


def test_the_style_of_the_users_own_plots_has_no_effect(unchanged):
    usual = plots(unchanged)
    with mpl.rc_context({"text.color": "white", "axes.labelcolor": "white", "font.size": 30.0}):
        assert plots(unchanged) == usual
        assert mpl.rcParams["font.size"] == 30.0


def test_two_plots_of_an_unchanged_robot(unchanged):
    assert len(plots(unchanged)) == 2
