"""Says where the ladle of a hybrid truss pouring robot really is: closed-chain error modelling on Pinocchio."""

from __future__ import annotations

from pouring_robot.closure import ClosureOptions, ClosureResult, ClosureSolver
from pouring_robot.energy import Loads
from pouring_robot.exceptions import BadInputError, NoSolutionError, PouringRobotError
from pouring_robot.loops import LoopsFile, load_loops
from pouring_robot.mechanism import ClosedChainMechanism
from pouring_robot.model import JointPlacement, RobotModel
from pouring_robot.poses import PlatformPose, PoseDifference
from pouring_robot.robot import LadleLocation, PouringRobot, load_robot

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
