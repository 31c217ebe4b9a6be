from .result import Compensation as Compensation
from .search import compensate as compensate
