from .path import CompensatedPath as CompensatedPath
from .path import compensate_path as compensate_path
from .pose import Compensation as Compensation
from .pose import DriveCompensation as DriveCompensation
from .pose import compensate as compensate
from .pose import compensate_drives as compensate_drives
