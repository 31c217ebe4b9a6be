"""The paper's section 5 computed: ten poses, twelve melt temperatures, and poses that no model has seen.

The paper's Tables 4 and 5, which list its ten poses, are lost: ours are drawn from the workspace at its tilt of 10°.
Nothing else is chosen. Properties are those of ``thermal.yaml`` and sizes those of the layout.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.io.temperatures import ZERO_CELSIUS_K
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring.layout import Layout
from pouring_robot.robot.pouring.poses import PlatformPose
from pouring_robot.robot.robot import PouringRobot
from pouring_robot.thermal.expansion.growth import ThermalExpansion
from pouring_robot.thermal.expansion.warm_robot import WarmRobot
from pouring_robot.thermal.network.assembly import ThermalNetwork
from pouring_robot.thermal.network.field import TemperatureField
from pouring_robot.thermal.regression.joint_model import JointRegression
from pouring_robot.thermal.regression.table import ErrorTable
from scripts.paper.thermal.regression import residual_figures

AXES = ("X", "Y", "Z")
TILT_RAD = float(np.radians(10.0))
POSES = 10
MELTS_DEGC = tuple(np.linspace(600.0, 1700.0, 12).tolist())
LEFT_OUT = 40
BOX_POSES = 200


def draw_poses(layout: Layout, count: int, random: np.random.Generator) -> list[PlatformPose]:
    """Return poses at the paper's tilt, spread evenly over the workspace."""
    places = random.uniform(layout.position_lower_m, layout.position_upper_m, size=(count, 3))
    return [PlatformPose((float(x), float(y), float(z)), TILT_RAD) for x, y, z in places]


def error_sets(network: ThermalNetwork, poses: Sequence[PlatformPose], melts_degC: Sequence[float]) -> FloatArray:
    """Return by how much heat alone moves the platform's origin o, shape (melts, poses, 3), in m.

    Args:
        network: of the drawing.
        poses: commanded poses.
        melts_degC: melt temperatures.

    Raises:
        NoSolutionError: the warm drawing cannot take a pose, or no temperatures are found.
    """
    robot = network.robot
    moved = np.empty((len(melts_degC), len(poses), 3))
    for k, pose in enumerate(poses):
        for j, melt in enumerate(melts_degC):
            warm = WarmRobot(robot, ThermalExpansion.from_field(network.steady(pose, melt)), pose).solve()
            moved[j, k] = warm.pose_base_to_end.translation - np.array(pose.position_m)
    return moved


def tables_of(moved: FloatArray, melts_degC: Sequence[float], letter: str) -> dict[str, ErrorTable]:
    """Return the error sets axis by axis; a set is named by its pose, such as P1."""
    kelvin = np.array(melts_degC) + ZERO_CELSIUS_K
    names = tuple(f"{letter}{k + 1}" for k in range(moved.shape[1]))
    return {axis: ErrorTable(kelvin, moved[:, :, a], names) for a, axis in enumerate(AXES)}


@dataclass(frozen=True)
class Contest:
    """How well three lines predict poses, as mean and spread of what they leave, in m.

    Attributes:
        sensitive: names of the sensitive sets, that of the smallest group first.
        single: mean and spread of the simple line of each.
        joint: of the joint model, by weighting; "coefficients" is the paper's own.
    """

    sensitive: tuple[str, ...]
    single: tuple[tuple[float, float], ...]
    joint: dict[str, tuple[float, float]]

    def beats(self, weighting: str, figure: int) -> bool:
        """Return whether a joint model beats every single line in mean (figure 0, by size) or in spread (1)."""
        return all(abs(self.joint[weighting][figure]) < abs(one[figure]) for one in self.single)


def contest(table: ErrorTable, judged: ErrorTable | None = None) -> Contest:
    """Fit the models to a table and judge them on other poses; None: the table's own sets that are not sensitive."""
    single: tuple[tuple[float, float], ...] = ()
    names: tuple[str, ...] = ()
    joint = {}
    for weighting in ("coefficients", "table"):
        model = JointRegression(weighting).fit(table.temperature_column, table.errors)
        names = tuple(table.names[i] for i in model.selector_.sensitive_)
        poses = judged or table.without(names)
        lines = model.predict_single(poses.temperature_column)
        single = tuple(residual_figures(poses.errors, line) for line in lines.T)
        joint[weighting] = residual_figures(poses.errors, model.predict(poses.temperature_column))
    return Contest(names, single, joint)


@dataclass(frozen=True)
class Draw:
    """What came of one drawing of ten poses, X direction.

    Attributes:
        seed: of the drawing.
        groups: sizes of the two groups, the smaller first.
        first_share: share of the first component of the two sensitive sets.
        contest: on poses left out.
    """

    seed: int
    groups: tuple[int, ...]
    first_share: float
    contest: Contest


@dataclass(frozen=True, eq=False)
class ThermalStudy:
    """Everything computed.

    Attributes:
        layout: workspace and sizes.
        seed: of all drawings.
        poses: the ten poses.
        melts_degC: the melt temperatures.
        conduction: temperatures at the ten poses at 1700 °C, without radiation.
        radiation: with it.
        moved: of o, shape (melts, 10, 3), in m.
        left_out: of o at poses in no table, shape (melts, LEFT_OUT, 3), in m.
        box_o_m: distance o is moved by at poses all over the workspace, tilt included, shape (BOX_POSES,).
        box_lip_m: the same of the lip.
        lining_m: thickness of the ladle's lining.
        draws: other drawings of ten poses.
    """

    layout: Layout
    seed: int
    poses: list[PlatformPose]
    melts_degC: tuple[float, ...]  # noqa: N815
    conduction: list[TemperatureField]
    radiation: list[TemperatureField]
    moved: FloatArray
    left_out: FloatArray
    box_o_m: FloatArray
    box_lip_m: FloatArray
    lining_m: float
    draws: list[Draw]

    @property
    def tables(self) -> dict[str, ErrorTable]:
        """The ten error sets, by axis."""
        return tables_of(self.moved, self.melts_degC, "P")

    @property
    def judged(self) -> dict[str, ErrorTable]:
        """The poses left out, by axis."""
        return tables_of(self.left_out, self.melts_degC, "L")

    @property
    def hottest_melt(self) -> FloatArray:
        """How o is moved at the hottest melt, shape (10, 3), in m."""
        return np.asarray(self.moved[-1])


def joint_of(table: ErrorTable) -> JointRegression:
    """Return the paper's model of a table."""
    return JointRegression("coefficients").fit(table.temperature_column, table.errors)


def first_share(model: JointRegression) -> float:
    """Return the share of variance of the first component of the sensitive sets."""
    return float(model.component_regression_.cumulative_[0])


def _box(network: ThermalNetwork, random: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return how far o and the lip are moved all over the workspace, at the melt's own temperature, in m."""
    robot, layout = network.robot, network.robot.layout
    loops = robot.nominal_solver.mechanism.loops
    frames = (loops.end_frame or "", loops.working_frame)
    found: list[list[float]] = []
    for x, y, z, tilt in random.uniform(*layout.box, size=(BOX_POSES, 4)).tolist():
        pose = PlatformPose((x, y, z), tilt)
        warm = WarmRobot(robot, ThermalExpansion.from_field(network.steady(pose)), pose).solve()
        cold = robot.nominal_solver.solve(robot.kinematics.inverse(pose), robot.kinematics.configuration(pose))
        places = [[r.pose(loops.base_frame, frame).translation for frame in frames] for r in (cold, warm)]
        found.append(np.linalg.norm(np.subtract(places[1], places[0]), axis=1).tolist())
    distances = np.array(found)
    return distances[:, 0], distances[:, 1]


def _draw(network: ThermalNetwork, seed: int) -> Draw:
    random = np.random.default_rng(seed)
    layout = network.robot.layout
    table, judged = (
        tables_of(error_sets(network, draw_poses(layout, count, random), MELTS_DEGC), MELTS_DEGC, letter)["X"]
        for count, letter in ((POSES, "P"), (2 * POSES, "L"))
    )
    model = joint_of(table)
    sizes = tuple(sorted(len(group) for group in model.selector_.groups_))
    return Draw(seed, sizes, first_share(model), contest(table, judged))


def run_thermal_study(layout: str, seed: int, draws: int, progress: Progress = say_nothing) -> ThermalStudy:
    """Compute everything the claims need.

    Args:
        layout: name of the layout.
        seed: of the drawing of poses; further drawings take the numbers after it.
        draws: how many further drawings of ten poses.
        progress: told of every step.

    Raises:
        UnknownLayoutError: there is no such layout.
        NoSolutionError: a pose is out of reach, or no temperatures are found.
    """
    robot = PouringRobot(RobotModel(layout=layout))
    network, bare = ThermalNetwork(robot), ThermalNetwork(robot, radiation=False)
    random = np.random.default_rng(seed)
    poses, others = (draw_poses(robot.layout, count, random) for count in (POSES, LEFT_OUT))
    steps = 2 + LEFT_OUT // POSES + draws
    done = 0

    def step() -> None:
        nonlocal done
        done += 1
        progress("heating the robot", done, steps)

    progress("heating the robot", 0, steps)
    moved = error_sets(network, poses, MELTS_DEGC)
    step()
    parts = []
    for start in range(0, LEFT_OUT, POSES):
        parts.append(error_sets(network, others[start : start + POSES], MELTS_DEGC))
        step()
    box_o, box_lip = _box(network, random)
    step()
    drawn = []
    for number in range(seed + 1, seed + 1 + draws):
        drawn.append(_draw(network, number))
        step()
    return ThermalStudy(
        robot.layout,
        seed,
        poses,
        MELTS_DEGC,
        [bare.steady(pose) for pose in poses],
        [network.steady(pose) for pose in poses],
        moved,
        np.concatenate(parts, axis=1),
        box_o,
        box_lip,
        network.lining_m,
        drawn,
    )
