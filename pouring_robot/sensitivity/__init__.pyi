from .analysis import sensitivity as sensitivity
from .report import SensitivityReport as SensitivityReport
from .request import Request as Request
from .samples import ErrorSamples as ErrorSamples
