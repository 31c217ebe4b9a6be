"""Closures and error-transfer matrices of many samples at once: the mathematics of :mod:`pouring_robot.mechanism`.

``BatchEngine(mechanism)`` takes arrays and gives arrays; compiled kernels do the work, on all cores.
"""

from pouring_robot.batch.engine import BatchEngine, BatchTransfer
from pouring_robot.batch.samples import STATUS_NAMES, BatchClosure, BatchCommand, BatchStart, SiteErrors
from pouring_robot.batch.structure import StarStructure

__all__ = [
    "STATUS_NAMES",
    "BatchClosure",
    "BatchCommand",
    "BatchEngine",
    "BatchStart",
    "BatchTransfer",
    "SiteErrors",
    "StarStructure",
]
