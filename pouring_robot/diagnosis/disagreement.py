"""Where the given model and a campaign disagree: from its residuals with only the frames fitted."""

from pouring_robot.diagnosis.diagnoser import Diagnoser, LinearState
from pouring_robot.diagnosis.rows import CampaignRows
from pouring_robot.diagnosis.where.free_residuals import FreeResiduals
from pouring_robot.diagnosis.where.where import Where, disagreements
from pouring_robot.inference.gaussian_processes.processes import sums_of
from pouring_robot.inference.problem import Nuisance


def where_of(diagnoser: Diagnoser) -> Where:
    """Return where the given model and the data disagree; raises as :func:`~.where.where.disagreements`."""
    rows = diagnoser.rows
    return disagreements(free_residuals(diagnoser.at_rest(), rows), rows.conditions, diagnoser.asked.false_names)


def free_residuals(before: LinearState, rows: CampaignRows) -> FreeResiduals:
    """Return the given model's residuals of all rows; raises BadInputError where the frames absorb all of them."""
    linear = before.every_row
    return FreeResiduals(
        linear.residual,
        linear.row,
        linear.component,
        linear.sigma,
        Nuisance.of(linear.free),
        before.frames.T_tracker_base.rotation,
        rows.moving_drives(linear, sums_of(linear.row, len(rows))),
        rows.noise,
    )
