"""The results of a sensitivity study: a row per error, and the axes to control; its tables, pictures and page."""

import functools
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pouring_robot.exceptions import BadInputError, counted
from pouring_robot.io.argument_checks import Options, as_tuple, whole
from pouring_robot.io.figures import json_text
from pouring_robot.io.files import write_together
from pouring_robot.io.seeds import SENSITIVITY_SEED
from pouring_robot.io.tables import rows_csv
from pouring_robot.io.units import DEG, MM, MRAD, shown_in
from pouring_robot.mechanism.arrays import FloatArray, finite, numbers
from pouring_robot.report.page import Block, Heading, Lines, Paragraph, Plot, Table, html_page
from pouring_robot.report.result import Result
from pouring_robot.robot.dh.table import DHParameter
from pouring_robot.robot.parameter_catalogue import Parameter
from pouring_robot.sensitivity.samples import AXES, ErrorSamples, median_place, peak, uniform_gap

Range = tuple[float, float]
Box = tuple[Range | None, Range | None, Range | None, Range | None]
_SHOWN_IN = (("x", MM, "mm"), ("y", MM, "mm"), ("z", MM, "mm"), ("tilt", DEG, "deg"))
_EVEN, _PILED, _DRAWN = 0.1, 2.0, 12
_NOTHING_MM, _NOTHING_RAD = 1e-3, 1e-5
"""Below it an error counts as without influence."""
_ALIKE_MM = 1e-6
"""Legs are alike, and closures are found to a nanometre: what differs by less keeps the order of the parameters."""


@dataclass(frozen=True)
class Request(Options):
    """What to study; a number that is out of its range, or is no number, raises BadInputError."""

    poses: int = 10_000  # how many; for a robot without a workspace box at most so many, those that close
    seed: int = SENSITIVITY_SEED  # for drawing them from the workspace box; other robots' drives are spread evenly
    length_m: float = 0.2 * MM  # size of an error; the default is the paper's, here and below
    angle_rad: float = 4.0 * MRAD
    # limits of x, y, z (m) and tilt (rad) instead of the workspace's; the pouring robot only
    box: Box = (None, None, None, None)
    # sets, groups, names or patterns; by default the DH table, or all places, axes and drives
    parameters: tuple[str, ...] = ()
    frame: str | None = None  # whose displacement counts; by default the end frame
    limit_m: float = MM  # errors that exceed it in a coordinate are those to control

    def __post_init__(self) -> None:
        whole(self.poses, 2, "give two poses or more")
        whole(self.seed, 0, "the seed is a whole number from 0 on")
        said = "errors and limit must be positive, errors below 100 mm and 500 mrad"
        length, angle, limit = finite((self.length_m, self.angle_rad, self.limit_m), (3,), said)
        if not (0.0 < length < 0.1 and 0.0 < angle < 0.5 and limit > 0.0):
            raise BadInputError(said)
        said, given = "a box is four ranges or None: of x, y, z in m and of the tilt in rad", as_tuple(self.box)
        if len(given) != len(_SHOWN_IN):
            raise BadInputError(said)
        box = tuple(limits if limits is None else tuple(numbers(limits, (2,), said).tolist()) for limits in given)
        object.__setattr__(self, "box", box)
        object.__setattr__(self, "parameters", as_tuple(self.parameters))
        super().__post_init__()
        for limits, said in zip(filter(None, self.box), ranges(self.box), strict=True):
            if not -math.inf < limits[0] <= limits[1] < math.inf:
                raise BadInputError(f"a range must run upwards and be finite, unlike {said}")


def ranges(box: Box) -> list[str]:
    """Return a box's limits of x, y, z (m) and tilt (rad) in words: ``x from -100 to 100 mm``."""
    given = ((limits, *shown) for limits, shown in zip(box, _SHOWN_IN, strict=True) if limits is not None)
    return [f"{name} from {low / one:g} to {high / one:g} {unit}" for (low, high), name, one, unit in given]


@dataclass(frozen=True, eq=False, repr=False)
class SensitivityReport(Result):
    """The effect of each error alone."""

    robot: str  # its name
    frame: str  # whose displacement counts
    request: Request  # what was studied
    parameters: tuple[Parameter, ...]  # the errors, P of them
    samples: tuple[ErrorSamples[Parameter], ...]  # displacements by model, the closed chain first
    # largest error of first order against exact closures, and how far the robot moves there
    missed_m: tuple[float, float]
    # the DH table, chain by chain and transform by transform a, α, d, θ; empty for another robot
    dh: tuple[DHParameter, ...] = ()
    unsolved: int = 0  # exact closures for comparison that have no solution

    @functools.cached_property
    def rows(self) -> list[dict[str, Any]]:
        """A row per error and model, model by model, with units in the names.

        ``main_direction`` is the coordinate with the largest mean, X, Y, Z or none; ``spread`` and the quantiles
        ``main_p…`` describe its distribution over the poses.
        """
        return [self._row(samples, k) for samples in self.samples for k in range(len(self.parameters))]

    def of_model(self, kind: str) -> list[dict[str, Any]]:
        """Return the rows of one model, ``closed chain`` or ``open branch``, the strongest error first."""
        return sorted((row for row in self.rows if row["model"] == kind), key=_strongest)

    @functools.cached_property
    def controls(self) -> list[dict[str, Any]]:
        """What to control in manufacture: parts whose errors exceed the limit in a coordinate of the closed robot.

        The strongest part and the strongest of its errors first; ``directions`` are the main ones, ``largest_mm`` is
        the largest coordinate.
        """
        parts: dict[str, list[dict[str, Any]]] = {}
        for row in self.of_model(self.samples[0].kind):
            if _largest_mm(row) > self.request.limit_m / MM:
                parts.setdefault(row["part"], []).append(row)
        found = [
            {
                "part": part,
                "errors": [row["parameter"] for row in rows],
                "directions": "".join(sorted({row["main_direction"] for row in rows})),
                "largest_mm": max(map(_largest_mm, rows)),
            }
            for part, rows in parts.items()
        ]
        return sorted(found, key=_strongest)

    @property
    def poses(self) -> int:
        """How many poses were studied."""
        return int(self.samples[0].translation_m.shape[1])

    @property
    def headline(self) -> str:
        """How many errors exceed the limit, and which is the strongest."""
        first = self.of_model(self.samples[0].kind)[0]
        over = sum(len(control["errors"]) for control in self.controls)
        asked = "" if self.poses == self.request.poses else f" of {self.request.poses}"  # the others are out of reach
        return (
            f"{self.robot}, {self.poses}{asked} poses: {over} of {len(self.parameters)} errors move '{self.frame}' by "
            f"more than {self.request.limit_m / MM:g} mm in a coordinate; strongest: {first['parameter']}, "
            f"{first['largest_mm']:.3f} mm, mainly in {first['main_direction']}"
        )

    def _table(self) -> Any:
        """One row per error and model."""
        return self.rows

    def figures(self) -> dict[str, Any]:
        """Return everything, ready for JSON; mm and mrad."""
        return {
            "robot": self.robot,
            "frame": self.frame,
            "poses": self.poses,
            "seed": self.request.seed,
            "box": ranges(self.request.box),  # where it is not the workspace's
            "errors": {"length_mm": self.request.length_m / MM, "angle_mrad": self.request.angle_rad / MRAD},
            "limit_mm": self.request.limit_m / MM,
            "control": [dict(one) for one in self.controls],
            "first_order_misses_mm": {
                "by": self.missed_m[0] / MM,
                "where_it_moves": self.missed_m[1] / MM,
                "without_solution": self.unsolved,
            },
            "parameters": [dict(row) for row in self.rows],
        } | ({"dh_table": self.dh_rows()} if self.dh else {})

    def dh_rows(self) -> list[dict[str, Any]]:
        """Return the nominal DH table, a row per transform: numbers, joint whose value is added, what drops out."""
        rows = []
        for first in range(0, len(self.dh), 4):
            a, alpha, d, theta = transform = self.dh[first : first + 4]
            rows.append(
                {"chain": a.chain, "transform": a.transform, "part": a.part}
                | {"a_mm": a.nominal / MM, "alpha_deg": math.degrees(alpha.nominal)}
                | {"d_mm": d.nominal / MM, "theta_deg": math.degrees(theta.nominal)}
                | {"joint": d.moves_with or theta.moves_with or ""}
                | {"drops_out": " ".join(one.symbol for one in transform if one.drops_out)}
            )
        return rows

    def _row(self, samples: ErrorSamples[Parameter], k: int) -> dict[str, Any]:
        parameter, moved, main = self.parameters[k], samples.translation_m[k], samples.main_axis(k)
        along = moved[:, AXES.find(main)] if main in AXES else np.zeros(len(moved))
        distance_mm, angle = float(samples.distance_m[k].max()) / MM, float(samples.angle_rad[k].max())
        mean, largest = samples.mean_m[k].tolist(), samples.peak_m[k].tolist()
        unit, size = shown_in(parameter.unit)
        return {
            "parameter": parameter.name,
            "part": parameter.part,
            "model": samples.kind,
            "error": (self.request.length_m if parameter.unit == "m" else self.request.angle_rad) / size,
            "unit": unit,
            **{f"mean_{axis}_mm": value / MM for axis, value in zip("xyz", mean, strict=True)},
            **{f"largest_{axis}_mm": value / MM for axis, value in zip("xyz", largest, strict=True)},
            "largest_mm": distance_mm,
            "largest_mrad": angle / MRAD,
            "main_direction": main,
            **{f"main_p{q}_mm": float(np.quantile(along, q / 100.0)) / MM for q in (5, 50, 95)},
            "one_sign": bool(abs(np.sign(along).sum()) == len(along)),
            "spread": _shape(along),
            "class_mm": _class(distance_mm, _NOTHING_MM),
            "class_rad": _class(angle, _NOTHING_RAD),
        }

    def save(self, folder: Path | str, *, overwrite: bool = False) -> list[Path]:
        """Write ``sensitivity.csv``, ``.json``, pictures and ``report.html`` into a folder, which is created.

        Raises:
            OutputError: the folder cannot be written to, or a file exists and ``overwrite`` is not set.
        """
        from pouring_robot.report.plots import png_of, svg_of
        from pouring_robot.sensitivity.samples import box_plots, distributions

        folder = Path(folder)
        files: dict[Path, str | bytes] = {
            folder / "sensitivity.csv": rows_csv(self.rows),
            folder / "sensitivity.json": json_text(self.figures()),
        }
        plots: list[Plot] = []
        for samples in self.samples:
            names = [row["parameter"] for row in self.of_model(samples.kind)[:_DRAWN]]
            strongest = samples.subset([parameter for parameter in self.parameters if parameter.name in names])
            title = f"{self.robot}, {samples.kind}: the {len(strongest.labels)} strongest errors, {self.poses} poses"
            drawn = {
                "sizes": box_plots(strongest, title, self.request.limit_m),
                "spread": distributions(strongest, strongest.labels, title),
            }
            for name, figure in drawn.items():
                files[folder / f"{name}_{samples.kind.replace(' ', '_')}.png"] = png_of(figure)
                plots.append(Plot(f"{samples.kind}: {name} over the poses", svg_of(figure)))
        blocks: list[Block] = [
            Paragraph(self.headline, "headline"),
            Paragraph(missed_line(self)),
            Heading("What to control"),
            Lines(control_lines(self) or ["nothing exceeds the limit"]),
            Heading("Pictures"),
            *plots,
            Heading("Each error alone"),
            errors_table(self),
        ]
        if self.dh:
            blocks += [Heading("The DH table"), dh_table(self)]
        links = {"one row per error": "sensitivity.csv", "all figures": "sensitivity.json"}
        title = f"Sensitivity of {self.robot}"
        files[folder / "report.html"] = html_page(title, blocks, links=links)
        return list(write_together(files, overwrite=overwrite))


def _strongest(row: dict[str, Any]) -> int:
    return -round(float(row["largest_mm"]) / _ALIKE_MM)


def _largest_mm(row: dict[str, Any]) -> float:
    """Return the largest coordinate."""
    return max(float(row[f"largest_{axis}_mm"]) for axis in "xyz")


def _class(value: float, nothing: float) -> str:
    """Return the power of ten of a value."""
    # A value on a power of ten must not fall below it by round-off.
    return "none" if value < nothing else f"1e{math.floor(math.log10(value) + 1e-9)}"


def _shape(along: FloatArray) -> str:
    """Return the shape of a distribution in words: even, piled up at a value, or neither."""
    if np.ptp(along) <= 0.01 * max(float(np.abs(along).max()), 1e-12):
        return "constant"
    if uniform_gap(along) <= _EVEN:
        return "even"
    place, share, times = peak(along)
    if times > _PILED and share > 0.5:
        return f"piled at {place / MM:+z.3f} mm"
    return "near its upper end" if median_place(along) > 0.75 else "uneven"


def missed_line(found: SensitivityReport) -> str:
    """Return the error of first order, in words."""
    missed, moved = (value / MM for value in found.missed_m)
    said = f"first order differs from exact closures by {missed:.2g} mm at most, where the robot moves {moved:.3g} mm"
    return said + (f"; {counted(found.unsolved, 'closure')} had no solution" if found.unsolved else "")


def control_lines(found: SensitivityReport) -> list[str]:
    """Return what to control, a line per part."""
    return [
        f"control {control['part']}: {' '.join(control['errors'])} (main direction {control['directions']}, up to "
        f"{control['largest_mm']:.3f} mm)"
        for control in found.controls
    ]


def errors_table(found: SensitivityReport) -> Table:
    """Return the errors of the closed robot, the strongest first, with those of the open branch if there is one."""
    opened = {row["parameter"]: row for row in found.of_model("open branch")}
    rows = []
    for row in found.of_model("closed chain"):
        branch = _cells(opened[row["parameter"]]) if opened else []
        rows.append([row["parameter"], row["part"], *_cells(row), row["spread"], *branch])
    head = ["error", "part", "largest mm", "class", "mrad", "main", "spread"]
    return Table(head + (["open mm", "class", "mrad", "main"] if opened else []), rows)


def dh_table(found: SensitivityReport) -> Table:
    """Return the nominal DH table, a row per transform."""
    rows = found.dh_rows()
    cells = [[f"{v:.4g}" if isinstance(v, float) else str(v) for v in row.values()] for row in rows]
    return Table([name.replace("_", " ") for name in rows[0]], cells)


def _cells(row: dict[str, Any]) -> list[str]:
    return [f"{row['largest_mm']:.3f}", row["class_mm"], f"{row['largest_mrad']:.2f}", row["main_direction"]]
