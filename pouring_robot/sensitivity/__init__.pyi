from .analysis import sensitivity as sensitivity
from .report import Request as Request
from .report import SensitivityReport as SensitivityReport
from .samples import ErrorSamples as ErrorSamples
