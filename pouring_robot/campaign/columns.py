"""The columns of a campaign: which there are and what they measure. Units ride on their names.

Which drives, travels and thermometers there are says the robot. Inside, values are in m, rad, kg and s, and
temperatures in °C, as the names of the fields say.
"""

from pouring_robot.io.quantities import Quantity, QuantityTable
from pouring_robot.robot.description import robot_file
from pouring_robot.robot.description.definition import RobotDefinition

POSITION, ROTATION = robot_file.POSITION, robot_file.ROTATION
DISTANCE, DISTANCE_FROM = robot_file.DISTANCE
MEASURED, AMBIENT = robot_file.MEASURED, robot_file.AMBIENT


def drive_names(robot: RobotDefinition) -> tuple[str, ...]:
    """Return what a campaign calls the drives."""
    return tuple(drive.column for drive in robot.drives)


def approach_names(robot: RobotDefinition) -> tuple[str, ...]:
    """Return the columns that say from which side a drive came: +1 rising, -1 falling."""
    return tuple(drive.approach_column for drive in robot.drives)


def force_names(robot: RobotDefinition) -> tuple[str, ...]:
    """Return the columns that say what a drive carries: tension or the moment along its motion is positive."""
    return tuple(drive.force_column for drive in robot.drives)


def condition_headings(robot: RobotDefinition) -> tuple[str, ...]:
    """Return the headings that columns of conditions may have."""
    return tuple(heading for quantity in robot.condition_columns for heading in quantity.headings)


def condition_names(robot: RobotDefinition) -> tuple[str, ...]:
    """Return the conditions that are one number a row: neither names nor sides of approach."""
    return tuple(q.name for q in robot.condition_columns if q.kind not in ("label", "sign", "force", "moment"))


def campaign_columns(robot: RobotDefinition) -> tuple[Quantity, ...]:
    """Return the columns of a campaign file: what was measured are places, poses, distances, or redundant drives."""
    session, time, *others = robot.condition_columns
    placed = not robot.loops.redundant_drives
    return (
        Quantity("sample", "label"),
        session,
        time,
        *robot.drive_columns,
        *others,
        *(Quantity(name, "length", required=placed, unless=DISTANCE) for name in POSITION),
        *(Quantity(name, "angle", part_of="a rotation vector") for name in ROTATION),
        Quantity(DISTANCE, "length"),
        Quantity(DISTANCE_FROM, "label"),
    )


def array_names(robot: RobotDefinition) -> dict[str, tuple[str, ...]]:
    """Return the quantities that stand side by side in each array (n, k) of a campaign, by the name of its field."""
    return {
        "drives": drive_names(robot),
        "approach": approach_names(robot),
        "position_m": POSITION,
        "rotation_vector_rad": ROTATION,
        "distance_m": (DISTANCE,),
        "force": force_names(robot),
    }


def sessions_of(table: QuantityTable) -> tuple[str, ...]:
    """Return the session of each row, all "1" without a column; raises CampaignError where a cell of it is empty."""
    sessions = table.labels.get("session", ("1",) * len(table))
    if "" in sessions:
        problem = "the session is missing; name one in every row, or leave the column out"
        raise table.fault(problem, sessions.index(""), "session")
    return sessions
