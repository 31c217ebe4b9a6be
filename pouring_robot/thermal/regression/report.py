"""Results from a table of error sets: groups, degrees, components, formulas, residuals of each method; and their page.

TableError is raised for a table of errors or positions that is wrong, has too few sets or lacks some directions.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from pouring_robot.exceptions import BadInputError, TableError
from pouring_robot.io.tables import read_table
from pouring_robot.io.temperatures import ZERO_CELSIUS_K
from pouring_robot.io.units import to_inner
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.report.page import Block, Heading, Lines, Paragraph, Plot, Table, html_page
from pouring_robot.report.plots import ASH, COLOURS, new_figure, own_look, svg_of, tell, tidy
from pouring_robot.report.result import Result
from pouring_robot.thermal.regression.joint_model import JointRegression
from pouring_robot.thermal.regression.methods import HELPS_BELOW, METHODS, NONE, PAPER, POSE, fit_lines, judge, left_out
from pouring_robot.thermal.regression.sensitive_sets import SensitiveSetSelector
from pouring_robot.thermal.regression.table import KINDS, ErrorTable
from pouring_robot.thermal.regression.thermal_model import (
    AXES,
    POSE_INPUTS,
    AxisModel,
    ErrorLine,
    Positions,
    ResidualStatistics,
    ThermalModel,
)

_TIED = 1e-9  # of the poses' spread: smaller is rounding


@dataclass(frozen=True, eq=False)
class AxisRegression:
    """One direction of a table."""

    table: ErrorTable  # its error sets
    model: JointRegression  # the paper's, weighted by equation 21
    lines: dict[str, ErrorLine]  # every method
    fitted: dict[str, ResidualStatistics]  # residuals of each on the table it was fitted to
    unseen: dict[str, ResidualStatistics]  # residuals of each on sets left out one at a time
    method: str  # the method to use

    @classmethod
    def of(cls, table: ErrorTable, positions: Positions | None, method: str | None, selector: dict[str, Any]) -> Self:
        """Fit and judge all methods; ``method`` None: the one with the smallest held-out error."""
        judged = left_out(table, positions, **selector)  # refuses too few sets before anything is fitted
        count, groups = len(table.names), selector.get("n_clusters", 1)
        if groups > count and selector.get("lambda_cut") is None:
            raise TableError(table.source, f"{count} sets cannot make {groups} groups; give --groups {count} or fewer")
        paper = JointRegression("coefficients", selector=SensitiveSetSelector(**selector))
        model = paper.fit(table.temperature_column, table.errors)
        if positions is not None:
            _refuse_tied(table.source, positions)
        lines = fit_lines(table, positions, **selector)
        # With a set left out there may be more groups than with all sets; for these there is no single set.
        unseen = {name: left for name, left in judged.items() if name in lines}
        if method is not None and method not in lines:
            raise BadInputError(f"method '{method}' needs the poses of the sets: --poses FILE")
        best = method or min((name for name in METHODS if name in lines), key=lambda name: unseen[name].rms)
        return cls(table, model, lines, judge(lines, table, positions), unseen, best)

    @property
    def helps(self) -> bool:
        """Whether the method's held-out error is clearly smaller than without compensation."""
        return self.unseen[self.method].rms < HELPS_BELOW * self.unseen[NONE].rms

    @property
    def sensitive(self) -> list[str]:
        """Names of the sensitive sets, that of the smallest group first."""
        return [self.table.names[i] for i in self.model.selector_.sensitive_]

    @property
    def unit(self) -> str:
        """Unit of its printed errors."""
        return "mm" if self.table.kind == "length" else "mrad"

    def words(self, method: str) -> str:
        """Return the description of a method."""
        number = method.removeprefix("single ")
        return METHODS[method] if number == method else f"{self.sensitive[int(number) - 1]} alone"

    def formulas(self) -> Iterator[str]:
        """Return equations 19 to 22 with their values; errors in mm or mrad, TEMP in °C, * for standardised."""
        regression, names = self.model.component_regression_, self.sensitive
        starred, components = [f"{name}*" for name in names], [f"Z{j + 1}" for j in range(regression.n_components_)]
        rows = zip(components, regression.components_, strict=True)
        gamma = regression.regression_.coef_ / float(np.std(self.table.temperatures_K))
        yield "(18) " + "; ".join(f"{z} = {_sum(row, starred)}" for z, row in rows)
        yield f"(19) TEMP* = {_sum(gamma, components)}"
        yield f"(20) TEMP* = {_sum(regression.standardised_coef_, starred)}"
        slopes = _sum(regression.coef_ / 1e3, names)
        yield f"(21) TEMP = {regression.intercept_ - ZERO_CELSIUS_K:.5g} + {slopes}".replace("+ -", "-")
        weights = _sum(self.model.weights_, [f"{name}_PCR" for name in names])
        slope, offset = self.model.coef_ * 1e3, (self.model.intercept_ + self.model.coef_ * ZERO_CELSIUS_K) * 1e3
        yield f"(22) P_end = {weights} = {offset:.5g} {slope:+.5g} TEMP"

    def figures(self) -> dict[str, Any]:
        """Return everything, ready for JSON; errors in mm or mrad."""
        selector, regression, names = self.model.selector_, self.model.component_regression_, self.table.names

        def remains(found: dict[str, ResidualStatistics]) -> dict[str, dict[str, float]]:
            return {name: {k: v * 1e3 for k, v in vars(left).items()} for name, left in found.items()}

        return {
            "unit": self.unit,
            "sets": list(names),
            "groups": [[names[i] for i in group] for group in selector.groups_],
            "lambda": list(selector.clustering_.lambda_range_),
            "grey_degree": dict(zip(names, selector.grey_degrees_.tolist(), strict=True)),
            "vif": {n: v if np.isfinite(v) else None for n, v in zip(names, selector.vif_, strict=True)},
            "sensitive": self.sensitive,
            "guard_held": selector.guard_held_.tolist(),
            "eigenvalues": regression.eigenvalues_.tolist(),
            "eigenvectors": regression.components_.tolist(),
            "cumulative": regression.cumulative_.tolist(),
            "formulas": list(self.formulas()),
            "fitted": remains(self.fitted),
            "left_out": remains(self.unseen),
            "method": self.method,
            "helps": self.helps,
        }


def _sum(factors: FloatArray, names: Sequence[str]) -> str:
    return " ".join(f"{value:+.5g} {name}" for value, name in zip(factors, names, strict=True)).removeprefix("+")


@dataclass(frozen=True, eq=False, repr=False)
class RegressionReport(Result):
    """Every direction of a table, ``x`` to ``z``, or ""; the positions where its sets were measured, if known."""

    source: str
    positions: Positions | None
    axes: dict[str, AxisRegression]

    @property
    def headline(self) -> str:
        """Held-out errors of the methods, axis by axis."""
        words = []
        for axis, one in self.axes.items():
            before, after = (one.unseen[name].rms * 1e3 for name in (NONE, one.method))
            words.append(f"{axis or 'error'} {before:.3f} → {after:.3f} ({one.method})")
        return f"rms on sets left out, {next(iter(self.axes.values())).unit}: " + ", ".join(words)

    def _table(self) -> Any:
        """One row per axis and method."""
        return [
            {
                "axis": axis,
                "method": name,
                f"fitted_rms_{one.unit}": one.fitted[name].rms * 1e3,
                f"left_out_rms_{one.unit}": residuals.rms * 1e3,
            }
            for axis, one in self.axes.items()
            for name, residuals in one.unseen.items()
        ]

    def figures(self) -> dict[str, Any]:
        """Return everything, ready for JSON."""
        return {"source": self.source, "axes": {axis: one.figures() for axis, one in self.axes.items()}}

    @property
    def foreign_inputs(self) -> list[str]:
        """Inputs of its thermal model that a pose of the pouring robot does not have, each with its unit."""
        places = zip(self.positions.names, self.positions.units, strict=True) if self.positions else ()
        return [f"{name} ({unit})" for name, unit in places if POSE_INPUTS.get(name) != unit]

    def model(self) -> ThermalModel:
        """Return the content of a thermal-model file.

        Raises:
            BadInputError: the table holds angles, or its direction is unknown.
        """
        first = next(iter(self.axes.values())).table
        if first.kind != "length" or "" in self.axes:
            raise BadInputError("a thermal model holds lengths along x, y, z: name sets P1_x_mm …, or give --axis")
        celsius, places = first.temperatures_K - ZERO_CELSIUS_K, self.positions
        rows: dict[Any, AxisModel] = {}
        for axis, one in self.axes.items():
            offset, slope = (tuple(row) for row in one.lines[one.method].coefficients.tolist())
            rows[axis] = AxisModel(method=one.method, coefficients=(offset, slope))
        return ThermalModel(
            source=Path(self.source).name,
            temperature_degC=float(celsius.mean()),
            melt_degC=(float(celsius.min()), float(celsius.max())),
            inputs=places.names if places else (),
            centre=tuple(places.values.mean(axis=0).tolist()) if places else (),
            ranges=dict(places.ranges) if places else {},
            axes=rows,
        )


def regress(
    table: ErrorTable, positions: Positions | None = None, *, axis: str = "", method: str | None = None, **selector: Any
) -> RegressionReport:
    """Regress a table on temperature, direction by direction.

    The sets are named ``P1_x`` … where the table holds several directions. ``axis``: the direction of a table whose
    names do not state it; of other tables only this direction is used. ``positions``: where the sets were measured, one
    row per set in the table's order (of each direction). ``method``: one of :data:`METHODS`, by default the one with
    the smallest held-out error; one that is unknown or lacks positions raises BadInputError. ``selector``: settings of
    :class:`SensitiveSetSelector`; more groups than sets raise TableError.
    """
    if method is not None and method not in METHODS:
        raise BadInputError(f"method '{method}' is not known; give one of {', '.join(METHODS)}")
    parts = by_axis(table, axis)
    return RegressionReport(
        table.source, positions, {a: AxisRegression.of(part, positions, method, selector) for a, part in parts.items()}
    )


def _refuse_tied(source: str, positions: Positions) -> None:
    """Raise a TableError where inputs are linearly dependent over the poses: many lines over them fit equally well."""
    varied = np.flatnonzero(np.ptp(positions.values, axis=0) > 0.0)
    about = positions.values[:, varied] - positions.values[:, varied].mean(axis=0)
    _, sizes, ways = np.linalg.svd(about / np.ptp(about, axis=0), full_matrices=False)
    for way in ways[sizes < _TIED * sizes.max(initial=0.0)]:
        tied = ", ".join(positions.names[k] for k in varied[np.abs(way) > _TIED])
        raise TableError(
            source, f"{tied} of --poses are linearly dependent over all sets; leave one of these columns out"
        )


def by_axis(table: ErrorTable, axis: str = "") -> dict[str, ErrorTable]:
    """Return a table split by direction: sets named ``P1_x``, ``P1_y`` … are P1 in x, in y.

    ``axis``: the direction of a table whose names state none, or the only one wanted of those stated. Names that are
    inconsistent, with each other or with ``axis``, raise TableError.
    """
    directions = {name: name.rpartition("_")[2] for name in table.names if name.rpartition("_")[2] in AXES}
    if not directions:
        return {axis: table}
    if len(directions) < len(table.names):
        raise TableError(table.source, "some sets name a direction (P1_x) and others do not; name all or none")
    if axis and axis not in directions.values():
        there = ", ".join(dict.fromkeys(directions.values()))
        raise TableError(table.source, f"has no direction {axis}, only {there}; give --axis one of these")
    parts = {}
    for a in [axis] if axis else dict.fromkeys(directions.values()):
        own = table.select([name for name in table.names if directions[name] == a])
        names = tuple(name.removesuffix(f"_{a}") for name in own.names)
        parts[a] = ErrorTable(own.temperatures_K, own.errors, names, own.kind, own.source)
    if len({part.names for part in parts.values()}) > 1:
        raise TableError(table.source, "the directions have other sets; give each set in each direction, in one order")
    return parts


def read_positions(path: Path | str, names: tuple[str, ...]) -> Positions:
    """Read where the sets were measured: a column ``set`` and columns with units, such as x_mm, tilt_deg, or drives."""
    table = read_table(path, "set,x_mm,y_mm,z_mm")
    if "set" not in table.headings:
        raise table.heading_fault("one column must be 'set', with the names of the error sets")
    table.refuse_doubled()
    labels = table.labels(table.headings.index("set"))
    missing = [name for name in names if name not in labels]
    if missing:
        raise TableError(path, f"has no row for the sets {', '.join(missing)}")
    for name in names:
        lines = [str(line) for line, label in zip(table.lines, labels, strict=True) if label == name]
        if len(lines) > 1:
            raise TableError(path, f"set {name} occurs more than once, in lines {', '.join(lines)}; keep one")
    inputs, units, columns = [], [], []
    for k, heading in enumerate(table.headings):
        if heading == "set":
            continue
        name, _, unit = heading.rpartition("_")
        if not name or unit not in KINDS:
            raise table.heading_fault(f"column '{heading}' has no unit of length or angle")
        if name in inputs:
            raise table.heading_fault(f"'{name}' occurs twice, in two units; keep one of the two columns")
        inputs.append(name)
        units.append("m" if KINDS[unit] == "length" else "rad")
        columns.append(to_inner(table.numbers(k, empty="a position is missing; fill it"), unit))
    if not columns:
        raise table.heading_fault("no column says where the sets were measured; add x_mm, y_mm … or drives")
    values = np.column_stack(columns)[[labels.index(name) for name in names]]
    varied = np.flatnonzero(np.ptp(values, axis=0) > 0.0)
    ranges = {name: (float(own.min()), float(own.max())) for name, own in zip(inputs, values.T, strict=True)}
    return Positions(tuple(inputs[k] for k in varied), tuple(units[k] for k in varied), values[:, varied], ranges)


def html_report(found: RegressionReport) -> str:
    """Return the report as one page without external files."""
    source = Path(found.source)
    plot = Plot("Error that each method leaves on sets left out (RMS), by direction", svg_of(_figure(found)))
    title = f"Regression of {source.name}"
    return html_page(title, [Paragraph(found.headline, "headline"), plot, *blocks(found)], data=[source])


def blocks(found: RegressionReport) -> list[Block]:
    """Return groups, degrees, formulas and residuals of each method for every direction, then warnings."""
    parts = [block for direction, one in found.axes.items() for block in _axis(direction, one)]
    return [*parts, *(Paragraph(f"note: {note}") for note in _warnings(found.axes))]


def _axis(direction: str, one: AxisRegression) -> list[Block]:
    selector, names, regression = one.model.selector_, one.table.names, one.model.component_regression_
    low, high = selector.clustering_.lambda_range_
    parts = "  ".join("{" + " ".join(names[i] for i in group) + "}" for group in selector.groups_)
    degrees = [
        (name, f"{degree:.4f}", f"{vif:.4g}", "chosen" if name in one.sensitive else "")
        for name, degree, vif in zip(names, selector.grey_degrees_, selector.vif_, strict=True)
    ]
    values = ", ".join(f"{value:.4f}" for value in regression.eigenvalues_)
    rows = []
    for method, remains in one.unseen.items():
        figures = (one.fitted[method].rms, remains.rms, remains.mean, remains.spread)
        mark = "in the file" if method == one.method else ""
        rows.append((one.words(method), *(f"{value * 1e3:z.4f}" for value in figures), mark))
    return [
        Heading(f"direction {direction}" if direction else "errors"),
        Lines([f"groups {parts} for λ above {low:.7f}, up to {high:.7f}"]),
        Table(("set", "grey degree", "VIF against those chosen before", ""), degrees),
        Lines([f"eigenvalues {values}; the first carries {regression.cumulative_[0]:.2%}", *one.formulas()]),
        Table((f"what is left, {one.unit}", "fitted rms", "left-out rms", "mean", "spread", ""), rows),
    ]


@own_look()
def _figure(found: RegressionReport) -> object:
    figure = new_figure(10.0, 2.4 * len(found.axes))
    panels = figure.subplots(len(found.axes), 1, squeeze=False)[:, 0]
    for panel, (direction, one) in zip(panels, found.axes.items(), strict=True):
        words = [one.words(method) for method in one.unseen]
        values = [residuals.rms * 1e3 for residuals in one.unseen.values()]
        colours = [COLOURS[0] if method == one.method else ASH for method in one.unseen]
        for bar, word, value in zip(panel.barh(words, values, color=colours), words, values, strict=True):
            tell(bar, [f"{word}: {value:.4f} {one.unit}"])
        panel.invert_yaxis()
        panel.set(title=direction or "error", xlabel=f"{one.unit}; blue: in the file")
        tidy(panel)
    return figure


_UNLIKE = "poses err in opposite directions or too differently for one line"


def _warnings(axes: dict[str, AxisRegression]) -> list[str]:
    """Return warnings where the regression does not help, and where the paper's would not."""
    notes = []
    for direction, one in axes.items():
        where = f"direction {direction}: " if direction else ""
        if not one.helps:
            after, before = (one.unseen[name].rms * 1e3 for name in (one.method, NONE))
            notes.append(
                f"{where}no method helps: on sets left out '{one.method}' leaves {after:.3f} of {before:.3f} "
                f"{one.unit}: {_UNLIKE}; "
                + ("do not compensate" if POSE in one.unseen else "give --poses, or do not compensate")
            )
        elif one.unseen[PAPER].rms > HELPS_BELOW * one.unseen[NONE].rms:
            notes.append(f"{where}the paper's P_end does not help here: {_UNLIKE}")
        selector = one.model.selector_
        notes += [
            f"{where}no set of the group of {name} is free of collinearity (VIF {vif:.4g}); principal "
            "components allow for it"
            for name, vif, held in zip(
                one.sensitive, selector.vif_[selector.sensitive_], selector.guard_held_, strict=True
            )
            if not held
        ]
    return notes
