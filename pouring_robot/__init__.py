"""Says where the ladle of a hybrid truss pouring robot really is: closed-chain error modelling on Pinocchio."""

from __future__ import annotations

from pouring_robot.exceptions import BadInputError, NoSolutionError, PouringRobotError
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure import ClosureOptions, ClosureResult, ClosureSolver
from pouring_robot.mechanism.energy import Loads
from pouring_robot.mechanism.loops import LoopsFile, load_loops
from pouring_robot.mechanism.poses import PoseDifference
from pouring_robot.robot.model import JointPlacement, RobotModel
from pouring_robot.robot.pouring.poses import PlatformPose
from pouring_robot.robot.robot import LadleLocation, PouringRobot, load_robot

__version__ = "0.1.0"

__all__ = [
    "BadInputError",
    "ClosedChainMechanism",
    "ClosureOptions",
    "ClosureResult",
    "ClosureSolver",
    "JointPlacement",
    "LadleLocation",
    "Loads",
    "LoopsFile",
    "NoSolutionError",
    "PlatformPose",
    "PoseDifference",
    "PouringRobot",
    "PouringRobotError",
    "RobotModel",
    "load_loops",
    "load_robot",
]
