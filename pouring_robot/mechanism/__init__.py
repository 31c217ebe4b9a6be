"""Any closed-chain robot in Pinocchio: a URDF tree and the loops that close it.

Energy of the loops, weight, closure, Jacobians, local parameters, and the error-transfer matrix G that maps each of
them to the end frame. One pose at a time; :mod:`pouring_robot.batch` does the same over arrays.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
