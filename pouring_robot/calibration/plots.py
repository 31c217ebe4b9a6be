"""Pictures of a calibration: residuals before and after, what moved, correlation, how well the ladle is known."""

import numpy as np

from pouring_robot.calibration.findings import CalibrationFindings, parameter_lines
from pouring_robot.calibration.metrics import length_columns, row_lengths, values_a_row
from pouring_robot.estimation.frames.outer import FRAMES
from pouring_robot.estimation.intervals import Z95
from pouring_robot.io.units import MM, MRAD
from pouring_robot.report.plots import AFTER, BEFORE, GREY, HELD_OUT, new_figure, own_look, svg_of, tell

_MOST_NAMES = 60


@own_look()
def plots(calibration: CalibrationFindings) -> list[tuple[str, str]]:
    """Return titles and SVG."""
    _, point = calibration.present.definition.tool_words
    drawn = [
        ("Error of every row before and after; the held-out block is shaded", _residuals(calibration)),
        (f"How well the calibrated model knows {point} (95 % half width)", _ladle(calibration)),
    ]
    if calibration.changed:
        drawn.insert(1, ("Parameters with 95 % intervals against their tolerances", _parameters(calibration)))
        drawn.append(("Correlation of the parameters", _correlation(calibration)))
    return drawn


def _residuals(calibration: CalibrationFindings) -> str:
    from matplotlib.ticker import FuncFormatter, NullFormatter

    figure = new_figure(10.0, 5.6)
    floor, columns = calibration.floor(np.arange(len(calibration.before))), length_columns(calibration.before)
    parts = [(f"{calibration.noise.length_kind} error [mm]", columns, MM, floor["rms_mm"])]
    if calibration.noise.turned:
        parts.append(("rotation error [mrad]", slice(3, 6), MRAD, floor["rms_mrad"]))
    kept = np.setdiff1d(np.arange(len(calibration.before)), calibration.left_out)
    for axes, (label, columns, unit, noise) in zip(
        np.atleast_1d(figure.subplots(len(parts), 1, sharex=True)), parts, strict=True
    ):
        for values, colour, name in ((calibration.before, BEFORE, "before"), (calibration.after, AFTER, "after")):
            length = row_lengths(values[kept, columns]) / unit
            (dots,) = axes.semilogy(kept, np.maximum(length, 1e-6), ".", color=colour, markersize=4, label=name)
            lines = calibration.campaign.lines[kept][np.isfinite(length)]
            found = zip(lines, length[np.isfinite(length)], strict=True)
            tell(dots, [f"line {line}: {value:.4f} {label.split()[-1].strip('[]')} {name}" for line, value in found])
        for row in calibration.split.test:
            axes.axvspan(row - 0.5, row + 0.5, color=HELD_OUT, alpha=0.12, linewidth=0)
        count = values_a_row(calibration.before[kept, columns])
        axes.axhline(np.sqrt(count) * noise, color=GREY, linestyle="--", label="noise")
        axes.set_ylabel(label)
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.grid(alpha=0.25)
    axes.set_xlabel("row of the campaign")
    figure.legend(*axes.get_legend_handles_labels(), ncols=3, loc="outside upper right")
    return svg_of(figure)


def _parameters(calibration: CalibrationFindings) -> str:
    lines = parameter_lines(calibration)
    lines = [line for line in lines if line.seen] or lines
    order = sorted(lines, key=lambda line: -line.surprise)[:_MOST_NAMES]
    figure = new_figure(9.0, 1.2 + 0.19 * len(order))
    axes = figure.subplots()
    place = np.arange(len(order))
    prior = np.array([line.prior_std for line in order])
    value = np.array([line.value for line in order]) / prior
    half = np.array([line.half_width for line in order]) / prior
    axes.barh(place, 2 * np.full(len(order), Z95), left=-Z95, color=GREY, alpha=0.2, label="95 % by tolerance")
    axes.errorbar(value, place, xerr=half, fmt="o", color=AFTER, markersize=3, label="found, 95 %")
    axes.set_yticks(place, [f"{line.name}  {line.value:+z.3f} {line.unit}" for line in order], fontsize=7)
    axes.set_ylim(len(order) - 0.5, -0.5)
    axes.axvline(0.0, color="black", linewidth=0.6)
    axes.set_xlabel("in standard deviations of the tolerance")
    axes.grid(axis="x", alpha=0.25)
    axes.legend(loc="lower right", fontsize=8)
    return svg_of(figure)


def _correlation(calibration: CalibrationFindings) -> str:
    matrix = calibration.correlation[FRAMES:, FRAMES:]
    names = calibration.base.names[FRAMES:]
    figure = new_figure(8.0, 7.2)
    axes = figure.subplots()
    image = axes.imshow(matrix, cmap="RdBu_r", vmin=-1.0, vmax=1.0)
    if len(names) <= _MOST_NAMES:
        axes.set_xticks(range(len(names)), names, rotation=90, fontsize=5)
        axes.set_yticks(range(len(names)), names, fontsize=5)
    else:
        axes.set_xlabel("parameter of calibration.json, the first is 0")
    figure.colorbar(image, ax=axes, shrink=0.8, label="correlation")
    return svg_of(figure)


def _ladle(calibration: CalibrationFindings) -> str:
    figure = new_figure(9.0, 3.8)
    left, right = figure.subplots(1, 2)
    ladle = calibration.ladle
    half = ladle.half_width_m / MM
    if half.size:
        places, index = np.unique(ladle.position_m[:, [0, 2]].round(6), axis=0, return_inverse=True)
        worst = np.array([half[index.ravel() == k].max() for k in range(len(places))])
        shown = left.scatter(places[:, 0] / MM, places[:, 1] / MM, c=worst, s=60, cmap="viridis")
        figure.colorbar(shown, ax=left, label="± mm, the worst pose there")
        left.margins(0.2)
        across = np.arange(half.size) if ladle.tilt_rad is None else np.degrees(ladle.tilt_rad)
        dots = right.scatter(across, half, s=8, color=AFTER)
        at = zip(ladle.position_m / MM, half, strict=True)
        tell(dots, [f"x {x:z.0f}, y {y:z.0f}, z {z:z.0f} mm: ± {h:.4f} mm" for (x, y, z), h in at])
        tell(shown, [f"x {x:z.0f}, z {z:z.0f} mm: ± {w:.4f} mm" for (x, z), w in zip(places / MM, worst, strict=True)])
    left.set(xlabel="x [mm]", ylabel="z [mm]")
    right.set(xlabel="pose" if ladle.tilt_rad is None else "tilt [°]", ylabel="± mm")
    for axes in (left, right):
        axes.grid(alpha=0.25)
    return svg_of(figure)
