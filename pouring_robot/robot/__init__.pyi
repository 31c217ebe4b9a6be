from .model import DriveOffset as DriveOffset
from .model import JointPlacement as JointPlacement
from .model import RobotModel as RobotModel
from .pose_table import read_poses as read_poses
from .pouring.poses import PlatformPose as PlatformPose
from .robot import LadleLocation as LadleLocation
from .robot import PouringRobot as PouringRobot
from .robot import load_robot as load_robot
