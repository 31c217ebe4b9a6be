from .drives import DriveCompensation as DriveCompensation
from .drives import compensate_drives as compensate_drives
from .result import Compensation as Compensation
from .search import compensate as compensate
