"""The picture of a campaign: where its poses lie in the workspace, and how far they are from the nominal robot."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from pouring_robot.campaign.data import Campaign
from pouring_robot.checks.check import Examination
from pouring_robot.checks.flags import wrong_rows
from pouring_robot.io.files import write_whole
from pouring_robot.mechanism.arrays import FloatArray, Indices
from pouring_robot.mechanism.rotations import tilts
from pouring_robot.report import plots
from pouring_robot.report.plots import DARK_GREY, GREY, VERMILION, draw_box, new_figure, own_look, png_of
from pouring_robot.robot.pouring.layout_schema import Layout

# Vermilion is reserved for flagged rows.
_COLOURS = (plots.BLUE, plots.ORANGE, plots.GREEN, plots.PURPLE, plots.SKY, "#8C6D1F", "#000000")
_LETTERS = 130  # that fit into one line under the picture


@own_look()
def write_picture(campaign: Campaign, found: Examination, layout: Layout | None, path: Path | str) -> Path:
    """Draw the commanded poses from three sides with the workspace box, and the misfit of each row, as PNG.

    A robot without a workspace box has no ``layout``; rows that the checks flagged are marked. Raises OutputError if
    the file cannot be written.
    """
    figure = new_figure(11.0, 9.5, dpi=120)
    # The box is four times as high as wide, so that the first two views keep its shape.
    sights_of = figure.subplot_mosaic("XYTT;MMMM", height_ratios=(1.6, 1.0), width_ratios=(1.0, 1.0, 1.2, 1.2))
    wrong = wrong_rows(found.flags)
    poses = found.comparison.poses.inverse() if found.comparison.inverted else found.comparison.poses
    tilt = np.degrees(tilts(poses.rotation))
    values = dict(zip(("x", "y", "z", "tilt"), (*poses.position_m.T * 1e3, tilt), strict=True))
    third, limits = ("seen along z", "x", "y"), dict[str, tuple[float, float]]()
    if layout is not None:
        third = ("tilt over height", "tilt", "z")
        *edges, (least, most) = np.transpose(layout.box)
        limits = dict(zip("xyz", (edge * 1e3 for edge in edges), strict=True))
        limits["tilt"] = math.degrees(least), math.degrees(most)
    sights = {"X": ("seen along y", "x", "z"), "Y": ("seen along x", "y", "z"), "T": third}
    for key, (title, across, up) in sights.items():
        xlabel, ylabel = (f"{name} [{'°' if name == 'tilt' else 'mm'}]" for name in (across, up))
        _points(sights_of[key], campaign, values[across], values[up], wrong)
        sights_of[key].set(title=title, xlabel=xlabel, ylabel=ylabel)
        sights_of[key].grid(alpha=0.25)
        if limits:
            draw_box(sights_of[key], limits[across], limits[up])
    _misfit(sights_of["M"], campaign, found, wrong)
    handles, labels = sights_of["X"].get_legend_handles_labels()
    columns = min(6, _LETTERS // (8 + max(map(len, labels))))
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False)
    figure.suptitle(f"{campaign.path.name}: {len(campaign)} {campaign.seen}, as commanded, in the base's frame")
    return write_whole(path, png_of(figure))


def _points(place: Any, campaign: Campaign, across: FloatArray, up: FloatArray, wrong: Indices) -> None:
    sessions = list(campaign.rows_by_session().items())
    shown, rest = sessions[: len(_COLOURS)], sessions[len(_COLOURS) :]
    groups = [(f"session {name}"[:24], rows, colour) for colour, (name, rows) in zip(_COLOURS, shown, strict=False)]
    if rest:
        groups.append(("other sessions", np.sort(np.concatenate([rows for _, rows in rest])), GREY))
    for index, (name, rows, colour) in enumerate(groups):
        # Poses are often visited again in a later session: larger dots below smaller ones show both.
        size = min(16.0 + 14.0 * (len(groups) - 1 - index), 60.0)
        place.scatter(across[rows], up[rows], s=size, color=colour, alpha=0.75, linewidths=0, label=name)
    if wrong.size:
        place.scatter(across[wrong], up[wrong], s=70, marker="x", color=VERMILION, label="flagged row", zorder=3)


def _misfit(place: Any, campaign: Campaign, found: Examination, wrong: Indices) -> None:
    """Draw each row's distance from the nominal robot, and the noise level; logarithmic, as gross errors are large."""
    place.set(title="measured against nominal robot, frames fitted", xlabel="line in file", ylabel="distance [mm]")
    place.grid(alpha=0.25)
    if found.fit is None:
        said = "the frames cannot be fitted" if campaign.position_measured.any() else "no row has a measured position"
        place.text(0.5, 0.5, said, ha="center", transform=place.transAxes)
        return
    residual = found.fit.position_residual_m
    distance = np.linalg.norm(np.nan_to_num(residual), axis=1) * 1e3
    distance[~np.isfinite(residual).all(axis=1) | (distance == 0.0)] = np.nan
    _points(place, campaign, campaign.lines.astype(float), distance, wrong)
    noise = (campaign.metadata.sigma_position_m or 0.0) * 1e3 * np.sqrt(3.0)
    if noise:
        place.axhline(noise, color=DARK_GREY, linestyle=":", linewidth=1.2)
        place.annotate("noise", (1.0, noise), xycoords=("axes fraction", "data"), ha="right", va="bottom")
    if np.isfinite(distance).any():
        from matplotlib.ticker import LogLocator

        place.set_yscale("log")
        decades = np.log10(np.nanmax(distance) / np.nanmin(distance))
        place.yaxis.set_major_formatter("{x:g}")
        place.yaxis.set_minor_formatter("{x:g}" if decades < 3.0 else "")
        if decades >= 1.0:
            place.yaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
