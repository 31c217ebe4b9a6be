"""Measured data, one static pose a row: what was commanded, under which conditions, and what was measured.

Reading and writing the two files of a campaign, plans of poses, and measuring a virtual robot.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
