"""The paper's Figs. 6 to 12 from our network. PNG, in memory."""

from __future__ import annotations

import numpy as np
from scipy.cluster.hierarchy import dendrogram

from pouring_robot.io.temperatures import ZERO_CELSIUS_K
from pouring_robot.io.units import MM
from pouring_robot.report.plots import ASH, BRICK, STEEL, new_figure, png_of, tidy
from pouring_robot.thermal.page import draw_legs
from scripts.paper.thermal.regression import compare, joint_of
from scripts.paper.thermal.study import LADLE_STEEL_DEGC, ThermalStudy


def lining_and_chains(study: ThermalStudy) -> bytes:
    """Draw Fig. 6: conduction alone, through the ladle's wall and along the chains; PNG."""
    figure = new_figure(10.0, 4.0)
    wall, legs = figure.subplots(1, 2)
    field = study.conduction[0]
    layers = field.temperatures_K[field.bodies.nodes.lining] - ZERO_CELSIUS_K
    width = study.lining_m / MM / len(layers)
    places = [0.0, *((np.arange(len(layers)) + 0.5) * width), study.lining_m / MM]
    wall.plot(places, [field.melt_K - ZERO_CELSIUS_K, *layers, field.shell_degC], "o-", color=BRICK)
    wall.set_xlabel("from the melt outwards, mm of lining")
    wall.set_ylabel("°C")
    wall.set_title(f"ladle's wall: shell at {field.shell_degC:.0f} °C", fontsize=10)
    draw_legs(legs, study.conduction[0])
    legs.set_title("chains, first pose", fontsize=10)
    for panel in (wall, legs):
        tidy(panel)
    figure.suptitle("Fig. 6: conduction alone", fontsize=11)
    return png_of(figure)


def chains_with_radiation(study: ThermalStudy) -> bytes:
    """Draw Fig. 7: temperatures along the chains with radiation, and their distribution over ten poses; PNG."""
    figure = new_figure(10.0, 4.0)
    legs, all_poses = figure.subplots(1, 2)
    draw_legs(legs, study.radiation[0])
    legs.set_title("first pose", fontsize=10)
    elements = np.concatenate([f.leg_elements_degC[f.between_joints > 0.0] for f in study.radiation])
    all_poses.hist(elements, bins=np.arange(100.0, 560.0, 20.0), color=STEEL, alpha=0.7)
    for value in (300.0, 500.0):
        all_poses.axvline(value, color=BRICK, linewidth=1.0, linestyle="--")
    all_poses.set_xlabel("°C; dashed: the paper's 300 and 500")
    all_poses.set_ylabel("leg elements, ten poses")
    for panel in (legs, all_poses):
        tidy(panel)
    figure.suptitle(f"Fig. 7: conduction and radiation, melt at {study.melts_degC[-1]:g} °C", fontsize=11)
    return png_of(figure)


def deformation(study: ThermalStudy) -> bytes:
    """Draw Fig. 8: how far heat moves o and the lip all over the workspace; PNG."""
    figure = new_figure(10.0, 4.0)
    arrows, sizes = figure.subplots(1, 2)
    places = np.array([pose.position_m for pose in study.poses]) / MM
    moved = study.hottest_melt / MM
    for k, (place, step) in enumerate(zip(places, moved, strict=True)):
        arrows.annotate(
            "", place[[1, 2]] + 20.0 * step[[1, 2]], place[[1, 2]], arrowprops={"arrowstyle": "->", "color": BRICK}
        )
        arrows.annotate(f"P{k + 1}", place[[1, 2]], (3, 3), textcoords="offset points", fontsize=8)
    arrows.plot(places[:, 1], places[:, 2], "o", color=STEEL, markersize=4)
    # Arrows do not count when the panel's limits are found; their ends do.
    arrows.plot(places[:, 1] + 20.0 * moved[:, 1], places[:, 2] + 20.0 * moved[:, 2], ",", alpha=0.0)
    arrows.set_xlabel("Y, mm")
    arrows.set_ylabel("Z, mm")
    arrows.set_title("ten poses; moves of o drawn 20 times larger", fontsize=10)
    arrows.margins(0.2)
    bins = np.arange(0.0, 10.0, 0.25)
    hot = f"any part, ladle steel at {LADLE_STEEL_DEGC:g} °C"
    for key, colour, name in (("o_m", STEEL, "o"), ("hot_largest_m", BRICK, hot)):
        sizes.hist(
            np.array([getattr(pose, key) for pose in study.box]) / MM, bins=bins, color=colour, alpha=0.55, label=name
        )
    for value, name in ((3.0, "mean"), (9.0, "largest")):
        sizes.axvline(value, color=ASH, linewidth=1.0, linestyle="--")
        sizes.text(value, sizes.get_ylim()[1], f" paper's {name}", fontsize=8, color=ASH, va="top")
    sizes.set_xlabel("moved by heat, mm")
    sizes.set_ylabel(f"poses of {len(study.box)} in the workspace")
    sizes.legend(fontsize=9, frameon=False, ncols=2, loc="lower center", bbox_to_anchor=(0.5, 0.99))
    for panel in (arrows, sizes):
        tidy(panel)
    figure.suptitle("Fig. 8: deformation", fontsize=11)
    return png_of(figure)


def errors_over_temperature(study: ThermalStudy) -> bytes:
    """Draw Fig. 9: errors of ten poses against the melt's temperature, axis by axis; PNG."""
    figure = new_figure(10.0, 3.9)
    for panel, (axis, table) in zip(figure.subplots(1, 3), study.tables.items(), strict=True):
        for k, name in enumerate(table.names):
            colour = (0.15 + 0.07 * k, 0.4, 0.85 - 0.07 * k)
            panel.plot(study.melts_degC, table.errors[:, k] / MM, ".-", color=colour, linewidth=1.0, label=name)
        panel.set_title(f"Δ{axis} of o", fontsize=11)
        panel.set_xlabel("melt, °C")
        tidy(panel)
        if axis == "X":
            panel.set_ylabel("mm")
            panel.legend(fontsize=7, frameon=False, ncols=2)
    figure.suptitle("Fig. 9: steady error over the melt's temperature", fontsize=11)
    return png_of(figure)


def choice_of_sets(study: ThermalStudy) -> bytes:
    """Draw the clustering's dendrogram and Fig. 10: grey relational degree and VIF of every set, X direction; PNG."""
    table = study.tables["X"]
    selector = joint_of(table).selector_
    figure = new_figure(10.0, 4.0)
    tree, degrees = figure.subplots(1, 2)
    dendrogram(selector.clustering_.linkage_, labels=list(table.names), ax=tree)
    tree.set_ylabel("1 − λ")
    tree.set_title("fuzzy clustering", fontsize=10)
    chosen = set(selector.sensitive_.tolist())
    for k, name in enumerate(table.names):
        colour = BRICK if k in chosen else STEEL
        degrees.plot(selector.grey_degrees_[k], selector.vif_[k], "o", color=colour, markersize=6)
        degrees.annotate(
            name, (selector.grey_degrees_[k], selector.vif_[k]), (5, 4), textcoords="offset points", fontsize=8
        )
    degrees.axhline(10.0, color=ASH, linewidth=1.0, linestyle="--")
    degrees.set_yscale("log")
    degrees.yaxis.set_major_formatter("{x:g}")
    degrees.yaxis.set_minor_formatter("")
    degrees.set_xlabel("grey relational degree to temperature")
    degrees.set_ylabel("VIF against the set chosen first; dashed: 10")
    degrees.set_title("red: chosen", fontsize=10)
    for panel in (tree, degrees):
        tidy(panel)
    figure.suptitle("Fig. 10: which sets stand for their groups (X)", fontsize=11)
    return png_of(figure)


def contest_picture(study: ThermalStudy, figure_number: int) -> bytes:
    """Draw Fig. 11 (mean) or Fig. 12 (spread) of what each prediction leaves, X direction; PNG."""
    which = 0 if figure_number == 11 else 1
    figure = new_figure(10.0, 3.6)
    rows = (
        ("the table's other poses, as in the paper", compare(study.tables["X"])),
        ("unseen poses", study.unseen("X")),
    )
    for panel, (title, found) in zip(figure.subplots(1, 2, sharey=True), rows, strict=True):
        singles = dict(zip(("single 1", "single 2"), (f"{name} alone" for name in study.sensitive("X")), strict=True))
        labels = singles | {
            "paper": "P_end,\neq. 21",
            "components": "P_end,\ncomponents",
            "mean": "mean of all\n(ours)",
        }
        values = [(found[name].spread if which else found[name].mean) / MM for name in labels]
        bars = panel.bar(list(labels.values()), values, 0.6, color=[STEEL, STEEL, BRICK, BRICK, ASH])
        panel.bar_label(bars, fmt="%.4f", fontsize=8, padding=2)
        panel.axhline(0.0, color=ASH, linewidth=0.8)
        panel.set_title(title, fontsize=10)
        panel.margins(y=0.15)
        tidy(panel)
        if panel.get_subplotspec().colspan.start == 0:
            panel.set_ylabel(f"{'spread' if which else 'mean'} of what is left, mm")
    figure.suptitle(f"Fig. {figure_number}: {'spread' if which else 'mean'} of predicted errors (X)", fontsize=11)
    return png_of(figure)
