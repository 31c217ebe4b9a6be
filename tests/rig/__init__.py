"""An independent machine for blind tests: it imports nothing from the package and formulates the mechanism separately.

``python -m tests.rig --out DIR --cases N --seed S`` writes campaigns with something hidden in each.
"""

from .campaign import KINDS, Campaign, Wanted, make_campaign, write_case
from .effects import LIBRARY, OUTSIDE

__all__ = ["KINDS", "LIBRARY", "OUTSIDE", "Campaign", "Wanted", "make_campaign", "write_case"]
