__version__: str

from .calibration.calibrate import Calibration as Calibration
from .calibration.calibrate import CalibrationOptions as CalibrationOptions
from .calibration.calibrate import calibrate as calibrate
from .campaign.data import Campaign as Campaign
from .campaign.simulate import simulate_campaign as simulate_campaign
from .compensation.compensate import compensate as compensate
from .diagnosis.diagnose import DiagnosisOptions as DiagnosisOptions
from .diagnosis.diagnose import diagnose as diagnose
from .diagnosis.result import Diagnosis as Diagnosis
from .exceptions import BadInputError as BadInputError
from .exceptions import NoSolutionError as NoSolutionError
from .exceptions import PouringRobotError as PouringRobotError
from .mechanism.closed_chain import ClosedChainMechanism as ClosedChainMechanism
from .mechanism.closure import ClosureOptions as ClosureOptions
from .mechanism.closure import ClosureResult as ClosureResult
from .mechanism.closure import ClosureSolver as ClosureSolver
from .mechanism.energy import Loads as Loads
from .mechanism.loops import LoopsFile as LoopsFile
from .mechanism.loops import load_loops as load_loops
from .mechanism.poses import PoseDifference as PoseDifference
from .robot.model import JointPlacement as JointPlacement
from .robot.model import RobotModel as RobotModel
from .robot.pouring.poses import PlatformPose as PlatformPose
from .robot.robot import LadleLocation as LadleLocation
from .robot.robot import PouringRobot as PouringRobot
from .robot.robot import load_robot as load_robot
