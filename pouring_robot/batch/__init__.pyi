from .engine import BatchEngine as BatchEngine
from .samples import STATUS_NAMES as STATUS_NAMES
from .samples import BatchClosure as BatchClosure
from .samples import BatchCommand as BatchCommand
from .samples import BatchStart as BatchStart
from .samples import BatchTransfer as BatchTransfer
from .samples import SiteErrors as SiteErrors
from .structure import StarStructure as StarStructure
