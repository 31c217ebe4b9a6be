from .chain import NotUPUError as NotUPUError
from .parameters import DHParameter as DHParameter
from .parameters import UnknownParameterError as UnknownParameterError
from .table import DHTable as DHTable
