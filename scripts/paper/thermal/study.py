"""The paper's section 5 computed: ten poses, twelve melt temperatures, and held-out poses.

The paper's Tables 4 and 5, which list its ten poses, are lost: ours are drawn from the workspace at its tilt of 10°.
Nothing else is chosen. Properties are those of ``thermal.yaml`` and sizes those of the layout.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.io.temperatures import ZERO_CELSIUS_K
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring.layout_schema import Layout
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.thermal.expansion.displacement import DisplacementField
from pouring_robot.thermal.expansion.leg_growth import ThermalExpansion
from pouring_robot.thermal.expansion.truss import TrussMotion
from pouring_robot.thermal.expansion.warm_pouring_robot import HeatedRobot, WarmRobot, WarmState
from pouring_robot.thermal.network.temperature_field import TemperatureField
from pouring_robot.thermal.network.thermal_network import ThermalNetwork
from pouring_robot.thermal.regression.joint_model import JointRegression
from pouring_robot.thermal.regression.methods import COMPONENTS, MEAN, PAPER, fit_lines, judge
from pouring_robot.thermal.regression.table import ErrorTable
from pouring_robot.thermal.regression.thermal_model import Positions, ResidualStatistics
from scripts.paper.tables import load_tables
from scripts.paper.thermal.regression import joint_of

AXES = ("X", "Y", "Z")
TILT_RAD = float(np.radians(10.0))
POSES = 10
MELTS_DEGC = tuple(np.linspace(600.0, 1700.0, 12).tolist())
LEFT_OUT = 40
BOX_POSES = 200
LADLE_STEEL_DEGC = 500.0
"""The paper's Fig. 7: "the local temperature near the pouring is nearly 500 °C"."""


def draw_poses(layout: Layout, count: int, random: np.random.Generator, tilt_sign: float = 1.0) -> list[PlatformPose]:
    """Return poses at the paper's tilt, spread evenly over the workspace."""
    lower, upper = layout.box
    places = random.uniform(lower[:3], upper[:3], size=(count, 3))
    return [PlatformPose((float(x), float(y), float(z)), tilt_sign * TILT_RAD) for x, y, z in places]


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


def positions_of(poses: Sequence[PlatformPose]) -> Positions:
    """Return where poses are, as inputs of a line that depends on the pose; their tilt is one and the same."""
    return Positions(("x", "y", "z"), ("m", "m", "m"), np.array([pose.position_m for pose in poses]))


@dataclass(frozen=True)
class BoxPose:
    """What heat does at a pose of the workspace, in m.

    Attributes:
        o_m: how far the platform's origin moves.
        mean_m, largest_m: over all parts, the ladle's steel as warm as the network has it behind its lining.
        hung_largest_m: with the ladle's steel at the paper's hottest local temperature.
        hot_mean_m, hot_largest_m: the same, growing from o, which the paper takes for the ladle's centre.
        hall_largest_m: ``largest_m`` seen from the hall, on a truss that warms, too.
    """

    o_m: float
    mean_m: float
    largest_m: float
    hung_largest_m: float
    hot_mean_m: float
    hot_largest_m: float
    hall_largest_m: float


@dataclass(frozen=True)
class Draw:
    """What came of one drawing of ten poses, X direction.

    Attributes:
        seed: of the drawing.
        groups: sizes of the two groups, the smaller first.
        first_share: share of the first component of the two sensitive sets.
        vif: of the pair.
        beaten: by method, whether it leaves less spread than each single set, on poses left out; and in the mean.
    """

    seed: int
    groups: tuple[int, ...]
    first_share: float
    vif: float
    beaten: dict[str, tuple[bool, bool]]


def beaten(found: Mapping[str, ResidualStatistics]) -> dict[str, tuple[bool, bool]]:
    """Return by method whether it leaves less spread, and a mean nearer zero, than every single set."""
    singles = [left for name, left in found.items() if name.startswith("single")]
    return {
        name: (
            all(left.spread < one.spread for one in singles),
            all(abs(left.mean) < abs(one.mean) for one in singles),
        )
        for name, left in found.items()
        if name in (PAPER, COMPONENTS, MEAN)
    }


@dataclass(frozen=True, eq=False)
class ThermalStudy:
    """Everything computed.

    Attributes:
        layout: name of the layout.
        seed: of all drawings.
        poses: the ten poses.
        melts_degC: the melt temperatures.
        conduction: temperatures at the ten poses at 1700 °C, without radiation.
        radiation: with it.
        moved: of o, shape (melts, 10, 3), in m.
        others: poses in no table.
        left_out: of o at these, shape (melts, n, 3), in m.
        box: poses all over the workspace, tilt included.
        lining_m: thickness of the ladle's lining.
        draws: other drawings of ten poses.
        other_draws: drawings in the other layout (``wide``, or ``paper`` for another than that).
    """

    layout: str
    seed: int
    poses: list[PlatformPose]
    melts_degC: tuple[float, ...]
    conduction: list[TemperatureField]
    radiation: list[TemperatureField]
    moved: FloatArray
    others: list[PlatformPose]
    left_out: FloatArray
    box: list[BoxPose]
    lining_m: float
    draws: list[Draw]
    other_draws: list[Draw]

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

    def unseen(self, axis: str) -> dict[str, ResidualStatistics]:
        """Return what every method leaves of the poses left out."""
        lines = fit_lines(self.tables[axis], positions_of(self.poses))
        return judge(lines, self.judged[axis], positions_of(self.others))

    def sensitive(self, axis: str) -> tuple[str, ...]:
        """Return the names of the sensitive sets, that of the smallest group first."""
        return tuple(self.tables[axis].names[i] for i in joint_of(self.tables[axis]).selector_.sensitive_)


def first_share(model: JointRegression) -> float:
    """Return the share of variance of the first component of the sensitive sets."""
    return float(model.component_regression_.cumulative_[0])


def pair_vif(model: JointRegression) -> float:
    """Return the VIF of the sensitive pair."""
    return float(model.selector_.vif_[model.selector_.sensitive_[-1]])


def _box(network: ThermalNetwork, random: np.random.Generator, count: int, tilt_sign: float) -> list[BoxPose]:
    """Return what moves all over the workspace, at the melt's own temperature."""
    robot = network.robot
    heated = HeatedRobot(robot, HeatSection(), network)
    found = []
    for x, y, z, tilt in random.uniform(*robot.layout.box, size=(count, 4)).tolist():
        pose = PlatformPose((x, y, z), tilt_sign * tilt)
        warm = WarmRobot(robot, heated.expansion(field := network.steady(pose)), pose)
        state = WarmState(field, warm, warm.solve(), 1, 0.0)
        o = float(np.linalg.norm(state.result.pose_base_to_end.translation - np.array(pose.position_m)))
        own, hung = (DisplacementField.of(state, degC) for degC in (None, LADLE_STEEL_DEGC))
        hot = DisplacementField.of(state, LADLE_STEEL_DEGC, ladle_from_o=True)
        truss = heated.truss(state)
        assert truss is not None  # it is warm
        hall = own.on(TrussMotion.under_heat(robot.layout, truss, heated.network.properties))
        of_parts = own.mean_m, own.largest_m, hung.largest_m, hot.mean_m, hot.largest_m, hall.largest_m
        found.append(BoxPose(o, *of_parts))
    return found


def _draw(network: ThermalNetwork, seed: int, *, left_out: bool) -> Draw:
    random = np.random.default_rng(seed)
    layout = network.robot.layout

    def sets(count: int, letter: str) -> ErrorTable:
        moved = error_sets(network, draw_poses(layout, count, random), MELTS_DEGC)
        return tables_of(moved, MELTS_DEGC, letter)["X"]

    table = sets(POSES, "P")
    model = joint_of(table)
    sizes = tuple(sorted(len(group) for group in model.selector_.groups_))
    against = beaten(judge(fit_lines(table), sets(2 * POSES, "L"))) if left_out else {}
    return Draw(seed, sizes, first_share(model), pair_vif(model), against)


def run_thermal_study(
    layout: str | RobotModel,
    seed: int,
    draws: int,
    progress: Progress = say_nothing,
    *,
    left_out: int = LEFT_OUT,
    box_poses: int = BOX_POSES,
    tilt_sign: float = 1.0,
) -> ThermalStudy:
    """Compute everything the claims need.

    Args:
        layout: name of the layout, or a model for its layout.
        seed: of the drawing of poses; further drawings take the numbers after it.
        draws: how many further drawings of ten poses.
        progress: told of every step.
        left_out: poses in no table, some tens.
        box_poses: poses all over the workspace.
        tilt_sign: −1 reads the paper's tilt r the other way round.

    Raises:
        UnknownLayoutError: there is no such layout.
        NoSolutionError: a pose is out of reach, or no temperatures are found.
    """
    model = RobotModel(layout=layout) if isinstance(layout, str) else layout
    robot = PouringRobot(model)
    network, bare = ThermalNetwork(robot), ThermalNetwork(robot, radiation=False)
    random = np.random.default_rng(seed)
    poses, others = (draw_poses(robot.layout, count, random, tilt_sign) for count in (POSES, left_out))
    if given := load_tables().poses_mm:
        poses = [PlatformPose.from_mm_deg(*place, tilt_sign * float(np.degrees(TILT_RAD))) for place in given]
    beside = ThermalNetwork(PouringRobot(RobotModel(layout="paper" if model.layout == "wide" else "wide")))
    steps = 2 + -(-left_out // POSES) + 2 * draws
    done = 0

    def step() -> None:
        nonlocal done
        done += 1
        progress("heating the robot", done, steps)

    progress("heating the robot", 0, steps)
    moved = error_sets(network, poses, MELTS_DEGC)
    step()
    parts = []
    for start in range(0, left_out, POSES):
        parts.append(error_sets(network, others[start : start + POSES], MELTS_DEGC))
        step()
    box = _box(network, random, box_poses, tilt_sign)
    step()
    drawn: dict[bool, list[Draw]] = {True: [], False: []}
    for number in range(seed + 1, seed + 1 + draws):
        for own in (True, False):
            drawn[own].append(_draw(network if own else beside, number, left_out=own))
            step()
    return ThermalStudy(
        model.layout,
        seed,
        poses,
        MELTS_DEGC,
        [bare.steady(pose) for pose in poses],
        [network.steady(pose) for pose in poses],
        moved,
        others,
        np.concatenate(parts, axis=1),
        box,
        network.bodies.lining_m,
        drawn[True],
        drawn[False],
    )
