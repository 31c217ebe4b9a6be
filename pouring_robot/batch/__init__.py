"""Closures and error-transfer matrices of many samples at once: the mathematics of :mod:`pouring_robot.mechanism`.

``CompiledEngine(mechanism)`` takes and returns arrays; compiled kernels compute them on all cores.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
