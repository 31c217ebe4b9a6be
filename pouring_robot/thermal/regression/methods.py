r"""All methods to predict an error, side by side: no compensation, single sets, the paper's P_end, and ours.

Each is an :class:`ErrorLine`, so that all are judged, written to a file and used in the same way. They are judged by
leave-one-out cross-validation over the sets, clustering included (:func:`left_out`). Too few sets raise TableError.

**How to be better than a single set.** With m a line's slope and s_T the temperatures' spread, its residuals' spread is

.. math:: \text{spread}^2 = \text{what no line removes} + s_T^2 \, (m - \bar m_{left})^2

so only the distance of m from the mean slope of the left-out poses counts. The sensitive sets show the slopes of two
poses, not of the others, and no weights from equation 21 alone contain these; the table's other sets do. If each
P_g^PCR, which is a line, is scaled to the mean of its group and weighted by the group's number of sets, its own slope
drops out, and their sum is the mean line of all sets. For a pose drawn like those of the table this has the smallest
expected spread of all weighted means of the sets' lines; the sensitive sets do not make it more accurate.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from sklearn.linear_model import LinearRegression

from pouring_robot.exceptions import TableError
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.thermal.regression.joint_model import JointRegression
from pouring_robot.thermal.regression.sensitive_sets import SensitiveSetSelector
from pouring_robot.thermal.regression.table import ErrorTable
from pouring_robot.thermal.regression.thermal_model import ErrorLine, Positions, ResidualStatistics

NONE, PAPER, COMPONENTS, MEAN, POSE = "none", "paper", "components", "mean", "pose"
METHODS = {
    NONE: "no compensation",
    PAPER: "P_end, weighed by equation 21 (the paper's 5.2)",
    COMPONENTS: "P_end, weighed by component contribution (the paper's 7)",
    MEAN: "mean line of all sets (ours)",
    POSE: "line that depends on the pose (ours)",
}
"""Methods in a thermal-model file, with descriptions. Single sets are judged along with them as ``single 1``, …"""
_WEIGHTINGS = {PAPER: "coefficients", COMPONENTS: "components"}
HELPS_BELOW = 0.9
"""A method helps if its held-out error is below this share of that without compensation."""


def fit_lines(table: ErrorTable, positions: Positions | None = None, **selector: Any) -> dict[str, ErrorLine]:
    """Return every method fitted to a table: ``none``, the single sets, the paper's two, ours.

    Without positions no line depends on the pose. ``selector``: settings of :class:`SensitiveSetSelector`.
    """
    column, middle = table.temperature_column, float(table.temperatures_K.mean())
    models = {
        name: JointRegression(weighting, selector=SensitiveSetSelector(**selector)).fit(column, table.frame())
        for name, weighting in _WEIGHTINGS.items()
    }
    mean = LinearRegression().fit(column, table.errors.mean(axis=1))
    singles = zip(models[PAPER].single_intercept_, models[PAPER].single_coef_, strict=True)
    straight = {NONE: (0.0, 0.0)} | {f"single {g}": one for g, one in enumerate(singles, 1)}
    straight |= {name: (model.intercept_, model.coef_) for name, model in models.items()}
    straight[MEAN] = mean.intercept_, mean.coef_[0]
    lines = {name: ErrorLine.straight(float(a), float(b), middle) for name, (a, b) in straight.items()}
    if positions is not None:
        lines[POSE] = ErrorLine.of_pose(table, positions)
    return lines


def judge(
    lines: Mapping[str, ErrorLine], judged: ErrorTable, positions: Positions | None = None
) -> dict[str, ResidualStatistics]:
    """Return the residuals of a table's errors after each line."""
    where = None if positions is None else positions.values
    return {
        name: ResidualStatistics.of(judged.errors - line.predict(judged.temperatures_K, where))
        for name, line in lines.items()
    }


def left_out(table: ErrorTable, positions: Positions | None = None, **selector: Any) -> dict[str, ResidualStatistics]:
    """Return the held-out residuals of each method: each set is left out once."""
    count, inputs = len(table.names), positions.names if positions is not None else ()
    if count < 3 + len(inputs):
        raise TableError(
            table.source,
            f"has too few error sets ({count}) to leave out each in turn{' and fit a line over ' if inputs else ''}"
            f"{', '.join(inputs)}; give {3 + len(inputs)} or more{', or no --poses' if inputs and count > 2 else ''}",
        )
    residuals: dict[str, list[FloatArray]] = {}
    for k, name in enumerate(table.names):
        others = [i for i in range(count) if i != k]
        lines = fit_lines(table.without([name]), None if positions is None else positions.rows(others), **selector)
        position = None if positions is None else positions.values[[k]]
        for method, line in lines.items():
            residuals.setdefault(method, []).append(table.errors[:, [k]] - line.predict(table.temperatures_K, position))
    return {method: ResidualStatistics.of(np.concatenate(found, axis=1)) for method, found in residuals.items()}
