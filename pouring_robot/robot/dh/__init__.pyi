from .chain import NotUPUError as NotUPUError
from .table import DHParameter as DHParameter
from .table import DHTable as DHTable
from .table import UnknownParameterError as UnknownParameterError
