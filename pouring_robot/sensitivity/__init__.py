"""What each geometric error does alone, for any robot: sizes, classes, main directions, and which axes to control.

The analysis of the paper's section 4 for one layout, with the transfer matrix G at any number of poses:
``sensitivity("examples/robots/delta/robot.yaml")`` or ``pouring-robot sensitivity``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
